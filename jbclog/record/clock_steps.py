"""Steps of the host's clock during a run, and conversion between that clock and the run's own.

All times of a run are by its own clock: the host's at the start, plus the time elapsed since. An
event `clock.step` has the run's time, in `value` the size in s, and in `raw` the host's time after
it. The manifest lists the steps: host's time = run's time + `offset_s`, from each step on.

Records of earlier versions follow the host's clock: their `clock.step` has no `raw`, and the
manifest no list. Their times are left as they are.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.core.clock import utc_micros
from jbclog.core.rows import EventRow
from jbclog.core.text import count_text
from jbclog.record.manifest import ClockStep, iso

if TYPE_CHECKING:
    import pyarrow as pa

# pyarrow is loaded where rows are read: `runs` reads only manifests

KIND: Final = "clock.step"
COLUMNS: Final = ["time", "kind", "value", "raw"]
EARLIEST_START: Final = datetime(2020, 1, 1, tzinfo=UTC)
LARGE_S: Final = 86_400.0
MOST_LISTED: Final = 1000  # steps in a manifest; the events have all of them


def is_inside(event: EventRow) -> bool:
    """Return True for a step that the times of the record follow: one of an earlier version."""
    return event.kind == KIND and bool(event.value) and event.raw is None


def steps_of(folder: Path) -> list[ClockStep]:
    """Return the steps of a run from its sealed events; none for a run of an earlier version."""
    from jbclog.record.parts import row_groups

    return steps_in(row_groups(folder, "events", COLUMNS))


def listed_steps(folder: Path) -> list[ClockStep]:
    """Return the steps of a run that its manifest lists."""
    return steps_of(folder)[:MOST_LISTED]


def steps_in(events: Iterable[pa.Table]) -> list[ClockStep]:
    """Return the steps in `events`, which have `COLUMNS`, oldest first."""
    import pyarrow as pa
    import pyarrow.compute as pc

    steps: list[ClockStep] = []
    offset_s = 0.0
    for group in events:
        rows = group.filter(pc.and_(pc.equal(group["kind"], KIND), pc.is_valid(group["raw"])))
        times = rows["time"].cast(pa.int64()).to_pylist()
        for time, step_s in zip(times, rows["value"].to_pylist(), strict=True):
            offset_s = round(offset_s + (step_s or 0.0), 6)
            steps.append(ClockStep(iso(time), step_s or 0.0, offset_s))
    return steps


class HostClock:
    """Converts between a run's clock and its host's, UTC in µs, by the steps of the host's.

    `from_us`: the run's times from which the offsets after the first apply, of `offsets_us`, host's
    less run's. A step that corrects a wrong start (`correction_of`) counts from the start, if that
    is given.
    """

    def __init__(self, steps: Sequence[ClockStep], started: str | None = None) -> None:
        self.from_us = [utc_micros(step.time) for step in steps]
        self.offsets_us = [0, *(round(step.offset_s * 1e6) for step in steps)]
        correction = correction_of(started, steps)
        if correction is not None:
            place = steps.index(correction) + 1
            self.offsets_us[:place] = [self.offsets_us[place]] * place

    def corrected(self, run_us: int) -> int:
        """Return the host's time at a moment of the run."""
        return run_us + self.offsets_us[bisect_right(self.from_us, run_us)]

    def corrected_text(self, run_text: str | None) -> str | None:
        """Return `corrected` of a time of a manifest, in its format; None for None."""
        if run_text is None or not self.from_us:
            return run_text
        return iso(self.corrected(utc_micros(run_text)))

    def run_time(self, host_us: int) -> int:
        """Return the run's time of a moment that is `host_us` by the host's clock.

        Times that the host's clock had twice, because it was set back, are taken for the later
        ones; times that it skipped for the moment of the step.
        """
        run_us = host_us
        until_us = None
        for from_us, offset_us in zip(
            (*reversed(self.from_us), None), reversed(self.offsets_us), strict=True
        ):
            run_us = host_us - offset_us
            if until_us is not None:
                run_us = min(run_us, until_us)
            if from_us is None or run_us >= from_us:
                break
            until_us = from_us
        return run_us


def correction_of(started: str | None, steps: Sequence[ClockStep]) -> ClockStep | None:
    """Return the step that corrected a clock which was wrong at the start: from before 2020 to
    later, or a first one of more than a day. None if there is none.
    """
    if started is None or not steps:
        return None
    began = datetime.fromisoformat(started)
    if began >= EARLIEST_START:
        return steps[0] if abs(steps[0].step_s) > LARGE_S else None
    enough_s = (EARLIEST_START - began).total_seconds()
    return next((step for step in steps if step.offset_s >= enough_s), None)


def start_doubt(started: str | None, steps: Sequence[ClockStep]) -> str | None:
    """Return what is wrong with the times of a run whose host had a wrong clock at its start; None
    if nothing is known to be wrong.
    """
    if started is None:
        return None
    began = datetime.fromisoformat(started)
    correction = correction_of(started, steps)
    if correction is not None:
        true = began + timedelta(seconds=correction.offset_s)
        size = count_text(round(abs(correction.offset_s) / LARGE_S), "day")
        way = "ahead" if correction.offset_s > 0 else "back"
        return (
            f"The host's clock was wrong at the start and was set {size} {way} during the run. The"
            f" times of this run count from {_minute(began)}; by the corrected clock it began at"
            f" {_minute(true)}."
        )
    if began < EARLIEST_START:
        return (
            f"The run began at {_minute(began)} by the host's clock, before 2020: that clock was"
            " wrong. When the run took place is not known."
        )
    return None


def _minute(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d %H:%M} UTC"
