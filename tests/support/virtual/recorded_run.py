"""A run as `jbclog run` makes it, recorded, sealed and judged, but of virtual stations on a clock
that jumps: no time passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from jbclog.app.run import run_record
from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import Plan, make_plan
from jbclog.app.run.run_record import Result, RunRecord
from jbclog.core.clock import VirtualClock
from jbclog.core.goal import Goal
from jbclog.core.locks import FolderLock
from jbclog.core.rows import EventRow
from jbclog.record.seal import seal_rows
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.omega import VirtualOmega
from jbclog.sim.setup import virtual_station
from jbclog.sim.virtual import VirtualStation
from jbclog.transport.virtual import VirtualDriver
from support.virtual.virtual_run import RECIPE


class Nobody:
    """An observer that does not look."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None: ...

    def sealing(self) -> None: ...


class RecordedRun:
    """What is left of it: the run's folder with everything in it, and the stations' own memory.

    `meanwhile` may plan what happens during the run.
    """

    def __init__(
        self,
        plan: Plan,
        out: Path,
        clock: VirtualClock | None = None,
        meanwhile: Callable[[RunRecord, VirtualDriver], None] = lambda _record, _driver: None,
    ) -> None:
        clock = clock or VirtualClock()
        papers, driver = (
            RunRecord(plan, out, Nobody(), clock, seal_every_s=None),
            VirtualDriver(clock),
        )
        self.stations: dict[str, VirtualStation | VirtualOmega] = {}
        papers.begin()
        for station, context in zip(plan.stations, papers.contexts, strict=True):
            virtual = virtual_station(station.spec, now=clock.monotonic())
            self.stations[station.spec.name] = virtual
            driver.add(run_station(context), virtual)
        meanwhile(papers, driver)
        driver.run()
        self.result: Result = papers.conclude(_sealed_here(papers))


def plan_in(
    home: Path, line: str, recipe: str = RECIPE, duration_s: float | None = None, **options: Any
) -> Plan:
    """The plan of a run by these texts, written into `home`; `options` of `RunOptions`."""
    (home / "line.toml").write_text(line, encoding="utf-8")
    (home / "recipe.toml").write_text(recipe, encoding="utf-8")
    return make_plan(
        RunOptions(home / "line.toml", home / "recipe.toml", duration_s=duration_s, **options)
    )


def run_in(
    home: Path, line: str, recipe: str = RECIPE, duration_s: float | None = None, **options: Any
) -> Path:
    """The folder of such a run, below `home`."""
    plan = plan_in(home, line, recipe, duration_s, **options)
    return RecordedRun(plan, home / "runs").result.folder


def _sealed_here(papers: RunRecord) -> str | None:
    """Closed and sealed; a child process would take a second for it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_record, "seal_in_child", _seal)
        return papers.close()


def _seal(folder: Path, _lock: FolderLock) -> None:
    seal_rows(folder)
