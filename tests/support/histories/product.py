"""One run as `jbclog run` makes it, recorded, sealed and judged, but on a clock that jumps and with
peers from elsewhere at the ends of its links.

`.ci/oracle` runs each version of jbclog with this file of that version's tree: what is renamed or
rebuilt inside jbclog is followed here, while the histories, their stations and what is written of
a run stay the same. It imports nothing but jbclog.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from signal import Signals
from typing import Any, Protocol
from unittest.mock import patch

from jbclog.app.run import run_record
from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.run_record import RunRecord
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import JbclogError
from jbclog.core.locks import FolderLock
from jbclog.core.outcome import CUT_SHORT, Exit
from jbclog.record.seal import seal_journal
from jbclog.session.run.station_run import run_station
from jbclog.transport.virtual import VirtualDriver

Refused = JbclogError
"""What is raised if the run is refused before it begins."""


class Peer(Protocol):
    """The far end of a link."""

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]: ...

    def is_unplugged(self, now: float) -> bool: ...


class _Observer:
    """Looks at nothing."""

    def begun(self, *_: object) -> None: ...

    def happened(self, *_: object) -> None: ...

    def second(self, *_: object) -> None: ...

    def sealing(self, *_: object) -> None: ...


def record(
    home: Path,
    peers: Mapping[str, Peer],
    options: Mapping[str, Any],
    unasked: Sequence[tuple[float, str, bytes]] = (),
    end: tuple[float, str] | None = None,
) -> tuple[Path, int]:
    """Record a run of ``line.toml`` in `home`; return its folder and exit code.

    `options` are those of `RunOptions`. `unasked`: second, station and bytes that come without a
    question. `end`: second and name of a signal, or a sentence for a goal that is reached. Raises
    `Refused`.
    """
    plan = make_plan(RunOptions(home / "line.toml", **options))
    clock = VirtualClock()
    papers = RunRecord(plan, home / "runs", _Observer(), clock, seal_every_s=None)
    driver = VirtualDriver(clock, allow_missing=plan.starts_without_missing)
    papers.begin()
    for context in papers.contexts:
        driver.add(run_station(context), peers[context.name], context.name)
    zero = clock.monotonic()
    for second, station, data in unasked:
        driver.at(zero + second, lambda station=station, data=data: driver.say(station, data))
    cut_short: list[Exit] = []

    def stop(why: str) -> None:
        if why not in Signals.__members__:
            papers.note("run.goal", f"{why}; the run ends.")
            driver.end(why)
            return
        if plan.wanted.states_an_end:
            cut_short.append(CUT_SHORT[Signals[why]])
        papers.note("run.signal", f"{why} received.")
        driver.end(f"ended by {why}")

    if end is not None:
        driver.at(zero + end[0], lambda: stop(end[1]))
    driver.run()
    # a child process would take a second to seal it
    with patch.object(run_record, "seal_in_child", _seal):
        lacking = papers.close()
    result = papers.conclude(lacking, cut_short[0] if cut_short else None)
    return result.folder, int(result.exit_code)


def _seal(folder: Path, _lock: FolderLock) -> None:
    seal_journal(folder)


ZERO_UTC_S = VirtualClock().utc()
"""When such a run begins, in seconds since 1970."""
ZERO_S = VirtualClock().monotonic()
"""The same on the clock of its peers."""
