"""A recorded run of a virtual station on a host whose clock is stepped, looked at each second as by
the recorder, while serials of units are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from support.product import EventRow, RunRecord, RunRecorder, Severity, VirtualClock, VirtualDriver
from support.virtual.recorded_run import RecordedRun, plan_in
from support.virtual.virtual_run import RECIPE, line_text

SECONDS = 60
ERROR_AT = 45.0
JOINTS = "joints_per_minute = 12\nseed = 3"


class SteppedClock(VirtualClock):
    """A virtual clock whose wall clock a test can set; it does not drift, as a sum of intervals
    would.
    """

    def __init__(self, utc: float) -> None:
        super().__init__(utc=utc)
        self._offset = utc - self.monotonic()

    def utc(self) -> float:
        return self._monotonic + self._offset

    def step(self, seconds: float) -> None:
        self._offset += seconds


def stepped_run(
    home: Path,
    steps: Mapping[float, float],
    units: Mapping[float, str],
    start_utc: float = 1_790_000_000.0,
    recipe: str = RECIPE,
    **options: Any,
) -> Path:
    """The folder of a run of 60 s with an error of its station at 45 s. `steps`: second -> size in
    s; `units`: second -> serial.
    """
    clock = SteppedClock(utc=start_utc)

    def meanwhile(record: RunRecord, driver: VirtualDriver) -> None:
        begin = clock.monotonic()
        recorder = object.__new__(RunRecorder)
        recorder.__dict__.update(_clock=clock, _run_record=record, _note=record.note)
        for second, size in steps.items():
            driver.at(begin + second, partial(clock.step, size))
        for second in range(SECONDS):
            driver.at(begin + second + 0.5, recorder._look_at_clock)
        for second, serial in units.items():
            driver.at(begin + second, partial(_begin_unit, record, serial))
        driver.at(begin + ERROR_AT, partial(_note_error, record))

    line = line_text(JOINTS, "ports = [1, 2]")
    plan = plan_in(home, line, recipe, SECONDS, **options)
    return RecordedRun(plan, home / "runs", clock, meanwhile).result.folder


def _begin_unit(record: RunRecord, serial: str) -> None:
    time = record.utc.micros(record.clock.monotonic())
    record.journal.event(
        EventRow(time, "unit.begin", Severity.INFO, f"Unit {serial}.", raw=serial), at_once=True
    )


def _note_error(record: RunRecord) -> None:
    time = record.utc.micros(record.clock.monotonic())
    record.journal.event(EventRow(time, "station.error", Severity.ERROR, "Error 7.", "dde-1"))
