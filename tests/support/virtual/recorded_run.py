"""A run as `jbclog run` makes it, recorded, sealed and judged, but of virtual stations on a clock
that jumps: no time passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from support.product import (
    EventRow,
    Exit,
    FolderLock,
    Goal,
    Head,
    Observer,
    RunOptions,
    RunPlan,
    RunRecord,
    RunResult,
    SessionContext,
    VirtualClock,
    VirtualDriver,
    VirtualOmega,
    VirtualStation,
    WireRecorder,
    captured_steps,
    make_plan,
    patch,
    run_station,
    seal,
    virtual_station,
)
from support.virtual.captured_run import TapedCable
from support.virtual.virtual_run import RECIPE


class Nobody:
    """An observer that does not look."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None: ...

    def sealing(self) -> None: ...


class RecordedRun:
    """What is left of it: the run's folder with everything in it, and the stations' own memory.

    `meanwhile` may plan what happens during the run, `cut_short` is how it is then cut short.
    """

    def __init__(
        self,
        plan: RunPlan,
        out: Path,
        clock: VirtualClock | None = None,
        meanwhile: Callable[[RunRecord, VirtualDriver], None] = lambda _record, _driver: None,
        observer: Observer | None = None,
        cut_short: Exit | None = None,
    ) -> None:
        clock = clock or VirtualClock()
        papers = RunRecord(plan, out, observer or Nobody(), clock, seal_every_s=None)
        driver = VirtualDriver(clock)
        self.stations: dict[str, VirtualStation | VirtualOmega] = {}
        papers.begin()
        wire = WireRecorder(papers.folder) if plan.wanted.wire else None
        for station, context in zip(plan.stations, papers.contexts, strict=True):
            virtual = virtual_station(station.spec, now=clock.monotonic())
            self.stations[station.spec.name] = virtual
            if wire is None:
                driver.add(run_station(context), virtual)
            else:
                order = context.order
                given = order.duration_s, order.rate, order.allow_omega_write, order.may_be_missing
                begin = order.name, order.url, order.recipe_file, order.t0, clock.utc()
                taped = TapedCable(virtual, wire.begin(Head(*begin, *given)))
                driver.add(captured_steps(run_station(context), taped.told, clock.monotonic), taped)
        meanwhile(papers, driver)
        driver.run()
        if wire is not None:
            wire.close()
            papers.manifest.wire = wire.trouble or "whole"
        self.result: RunResult = papers.conclude(_sealed_here(papers), cut_short)


def plan_in(
    home: Path, line: str, recipe: str = RECIPE, duration_s: float | None = None, **options: Any
) -> RunPlan:
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
    with pytest.MonkeyPatch.context() as monkeypatch:
        patch(monkeypatch, "run_record.seal_in_child", _seal)
        return papers.close()


def _seal(folder: Path, _lock: FolderLock) -> None:
    seal(folder)
