"""How much memory the recorder takes with 64 stations, and whether that grows with time.

First comes a real run of 64 stations: its process reports its peak memory before sealing and at the
end. Then comes an hour in a minute: the same sessions on a virtual clock, which jumps from one
answer to the next, with the real live store, committed each virtual second and sealed into Parquet
every tenth virtual minute. The memory of the process is measured each minute; the slope of a line
through the values shows growth. The first minutes do not count, because caches fill and allocations
settle.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import linear_regression

from common import (
    RECIPE,
    Claim,
    at_most,
    in_own_process,
    is_short,
    judge,
    line_text,
    show,
    virtual_stations,
)
from recorder import Recorded, record

from jbclog.app.run.options import RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.app.run.tasks import station_tasks
from jbclog.core.clock import UtcOffset, VirtualClock
from jbclog.record.folder import create_run
from jbclog.record.run_journal import RunJournal
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.virtual import VirtualStation
from jbclog.transport.virtual import VirtualDriver

STATIONS = 64
STATIONS_OF_THE_HOUR = 8
MOST_RECORDING_MB = 110.0
MOST_MB = 150.0  # at the end, when the run is judged
MOST_GROWTH = 0.01  # an hour, of what it holds
COMMIT_S, LOOK_S, SEAL_S = 1.0, 60.0, 600.0


@dataclass(slots=True)
class Hour:
    """A run on a virtual clock: memory of the process in MB, at each minute that counts."""

    minutes: list[float] = field(default_factory=list)
    held_mb: list[float] = field(default_factory=list)
    seals: int = 0
    exchanges: int = 0
    seconds: float = 0.0

    @property
    def growth_mb(self) -> float:
        """Return the slope in MB an hour."""
        return linear_regression(self.minutes, self.held_mb).slope * 60


def main() -> int:
    short = is_short(__doc__)
    with virtual_stations(STATIONS) as stations:
        recipe = stations.recipe(alarms_every_s=0.2)
        real = in_own_process(
            record, stations.line, recipe, stations.folder, 6.0 if short else 60.0
        )
        hour = in_own_process(compressed, stations.folder, 30.0 if short else 60.0)
    _show(real, hour)
    growth = hour.growth_mb / hour.held_mb[-1]
    return judge(
        [
            at_most(
                f"the recorder of {STATIONS} stations while it records",
                real.recording_mb,
                MOST_RECORDING_MB,
                " MB",
            ),
            at_most("the same at its end, which judges the run", real.peak_mb, MOST_MB, " MB"),
            Claim(
                "its size over an hour is flat",
                abs(growth) <= MOST_GROWTH,
                f"{hour.growth_mb:+.2f} MB an hour, {growth:+.1%} of at most ±{MOST_GROWTH:.0%}",
            ),
        ]
    )


def _show(real: Recorded, hour: Hour) -> None:
    rows = [
        [f"{STATIONS} stations, recording", real.exchanges, "", real.recording_mb],
        ["and judged at the end", "", "", real.peak_mb],
        [
            f"{STATIONS_OF_THE_HOUR} stations, {hour.minutes[0]:g} to {hour.minutes[-1]:g} min",
            hour.exchanges,
            hour.seals,
            max(hour.held_mb),
        ],
    ]
    show(
        f"memory; {hour.minutes[-1]:g} virtual minutes took {hour.seconds:.0f} s",
        ("", "exchanges", "seals", "most MB"),
        rows,
    )


def compressed(folder: Path, minutes: float) -> Hour:
    """Record `minutes` of virtual time below `folder`."""
    began = time.monotonic()
    clock, found = VirtualClock(), Hour()
    driver = VirtualDriver(clock)
    store = RunJournal(create_run(folder, "hour", clock.utc()), seal_every_s=None)
    store.start()
    contexts = _put_to_work(driver, clock, store, folder, minutes * 60)
    _every(driver, COMMIT_S, lambda _: store.commit_now())
    _every(driver, SEAL_S, lambda _: _seal(store, found))
    _every(driver, LOOK_S, lambda elapsed_s: _look(found, elapsed_s / 60, minutes / 3))
    driver.run()
    store.close()
    store.release()
    found.exchanges = sum(context.station.exchanges for context in contexts)
    found.seconds = time.monotonic() - began
    return found


def _put_to_work(
    driver: VirtualDriver, clock: VirtualClock, store: RunJournal, folder: Path, seconds: float
) -> list[SessionContext]:
    line, recipe = folder / "hour-line.toml", folder / "hour.toml"
    line.write_text(line_text([f"dde-{number}" for number in range(1, STATIONS_OF_THE_HOUR + 1)]))
    recipe.write_text(RECIPE.format(hz=10, alarms_every_s=0.2))
    plan = make_plan(RunOptions(line, recipe, duration_s=seconds))
    contexts = [
        SessionContext.of(order, store, UtcOffset(clock))
        for order in station_tasks(plan, clock.monotonic())
    ]
    for context, station in zip(contexts, plan.stations, strict=True):
        driver.add(run_station(context), VirtualStation(station.spec, now=clock.monotonic()))
    return contexts


def _every(driver: VirtualDriver, seconds: float, call: Callable[[float], None]) -> None:
    """Call `call` every `seconds` of virtual time with the seconds so far."""
    began = driver.clock.monotonic()

    def again() -> None:
        call(driver.clock.monotonic() - began)
        driver.at(driver.clock.monotonic() + seconds, again)

    driver.at(began + seconds, again)


def _seal(store: RunJournal, found: Hour) -> None:
    """Seal, and let the child end: it may need more than ten minutes of this clock."""
    store.seal_now()
    found.seals += 1
    while store._child:
        time.sleep(0.05)


def _look(found: Hour, minute: float, from_minute: float) -> None:
    if minute > from_minute:
        found.minutes.append(round(minute))
        found.held_mb.append(held_mb())


def held_mb() -> float:
    """Return the memory of this process now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


if __name__ == "__main__":
    sys.exit(main())
