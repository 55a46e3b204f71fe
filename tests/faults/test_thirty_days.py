"""A run of thirty days (docs/reference/faults.md, F-45): no more memory and no more open files at
the end than after the first day.

``pytest -n0 -s -m campaign tests/faults/test_thirty_days.py`` runs thirty days on the virtual clock
in a few minutes, on a real disk, sealed each day, with a cable that is unplugged now and then; a
default run does a quarter of a day.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from support.product import (
    RunPlan,
    RunRecord,
    VirtualClock,
    VirtualDriver,
    check_run,
    read_manifest,
    run_station,
    seal_as_hourly,
    virtual_station,
)
from support.virtual.lines import fault
from support.virtual.recorded_run import Nobody, _sealed_here, plan_in
from support.virtual.virtual_run import RECIPE, line_text

DAY_S, HOUR_S = 86400.0, 3600.0
OUT_EVERY_S, OUT_S = 5 * HOUR_S, 60.0
PAGE_MB = 4096 / 2**20
MOST_MB_A_DAY = 0.3  # half a day's rows would take as much
PERIOD_S = 15.0  # the longest that a recipe may set
SPARSE = f"""{RECIPE}on_difference = "continue"

[sampling]
rate_hz = {1 / PERIOD_S:.9f}
alarms_every_s = 15
counters_every_s = 3600
"""


@dataclass
class Lived:
    """The result of a long run: memory in MB and open files each hour; its duration."""

    folder: Path
    memory_mb: list[float] = field(default_factory=list)
    files: list[int] = field(default_factory=list)
    parts: int = 0
    seconds: float = 0.0


def outages(days: float) -> list[float]:
    """Return when the cable is unplugged: every five hours, if it comes back before the end."""
    begins = (
        OUT_EVERY_S * number + 100.5 for number in range(1, int(days * DAY_S / OUT_EVERY_S) + 1)
    )
    return [begin for begin in begins if begin + 2 * OUT_S < days * DAY_S]


def plan_for(folder: Path, days: float) -> RunPlan:
    outs = "".join(fault("dropout", at_s=at_s, for_s=OUT_S) for at_s in outages(days))
    line = line_text("noise_c = 2.0\njoints_per_minute = 2\n" + outs, "ports = [1]")
    return plan_in(folder, line, SPARSE, days * DAY_S)


def live(folder: Path, days: float, seal_s: float = DAY_S) -> Lived:
    """Run for that many days and seal every `seal_s`."""
    plan, clock, began = plan_for(folder, days), VirtualClock(), time.monotonic()
    papers, driver = (
        RunRecord(plan, folder / "runs", Nobody(), clock, seal_every_s=None),
        VirtualDriver(clock),
    )
    lived = Lived(papers.folder)
    papers.begin()
    for station, context in zip(plan.stations, papers.contexts, strict=True):
        driver.add(run_station(context), virtual_station(station.spec, now=clock.monotonic()))
    _each(driver, HOUR_S, lambda: _look(lived))
    _each(driver, seal_s, lambda: _seal(papers, lived))
    driver.run()
    papers.conclude(_sealed_here(papers))
    lived.seconds = time.monotonic() - began
    return lived


def _each(driver: VirtualDriver, period_s: float, do: Callable[[], object]) -> None:
    def again() -> None:
        do()
        driver.at(driver.clock.monotonic() + period_s, again)

    driver.at(driver.clock.monotonic() + period_s, again)


def _look(lived: Lived) -> None:
    lived.memory_mb.append(int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB)
    lived.files.append(len(list(Path("/proc/self/fd").iterdir())))


def _seal(papers: RunRecord, lived: Lived) -> None:
    """Seal as the hourly child does, and wait for it: real time is short here."""
    seal_as_hourly(papers)
    lived.parts += 1


def slope(values: list[float]) -> float:
    """Return the gain from one value to the next, by least squares."""
    middle, mean = (len(values) - 1) / 2, sum(values) / len(values)
    return sum((n - middle) * (value - mean) for n, value in enumerate(values)) / sum(
        (n - middle) ** 2 for n in range(len(values))
    )


def assert_whole(lived: Lived, days: float) -> None:
    assert check_run(lived.folder) == []
    (facts,) = read_manifest(lived.folder).stations
    assert facts.outcome == "completed", facts.reason
    assert facts.outages == len(outages(days)) > 0
    rows = sum(
        file.rows or 0
        for file in read_manifest(lived.folder).files
        if file.path.startswith("samples/")
    )
    assert rows == pytest.approx(days * DAY_S / PERIOD_S, abs=2)


def test_a_quarter_of_a_day(tmp_path: Path) -> None:
    lived = live(tmp_path, 0.25, seal_s=2 * HOUR_S)
    assert_whole(lived, 0.25)
    assert lived.parts >= 2
    # a part in progress, the pipe of its child
    assert max(lived.files) - min(lived.files) <= 3


def test_a_slope_is_seen() -> None:
    assert slope([1.0, 2.0, 3.0]) == pytest.approx(1.0)
    assert slope([5.0] * 10) == 0


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_thirty_days(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], counted: Callable[..., None]
) -> None:
    lived = live(tmp_path, 30)
    gained = 24 * slope(lived.memory_mb[24:])
    first, last = lived.memory_mb[24], lived.memory_mb[-1]
    with capsys.disabled():
        print(
            f"\n30 days in {lived.seconds / 60:.1f} min, {lived.parts} parts; {min(lived.files)} to"
            f" {max(lived.files)} open files;"
        )
        print(
            f"{first:.0f} MB after the first day, {last:.0f} MB at the end, {1000 * gained:+.0f} kB"
            " a day"
        )
    assert_whole(lived, 30)
    assert gained < MOST_MB_A_DAY
    assert max(lived.files) - min(lived.files) <= 3
    counted(
        virtual_days=30,
        rows_lost=0,
        kB_a_day=round(1000 * gained),
        files_more=max(lived.files) - min(lived.files),
    )
