"""docs/explanation/plant-sizes.md: what plants of growing sizes cost, extrapolated from what was measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jbclog.app.publish.commits import BATCHES, GROUP_ROWS
from support.pages.md_table import MADE, table

STATIONS = (250, 1_000, 10_000, 100_000)
RUN_STATIONS = 250  # of one run, on one host
READS, RATE_HZ = 4, 10.0  # of each tick of a station with one port
SHIFT_S = 8 * 3600
SHIFTS_A_YEAR, SHIFTS_A_MONTH = 250, 21
COMMIT_ROWS = BATCHES * GROUP_ROWS
OTHER_COMMITS = 8  # of a run, beside those of its samples
ANSWER_S = 60.0

# what was measured
EXCHANGE_S = 42e-6
SEALED_BYTES, STORED_BYTES = 5.9, 16.3  # of a row
PUBLISH_ROW_S, PUBLISH_RUN_S = 5.7e-6, 0.2
OPEN_FILE_S = 1e-3
READ_ROWS_A_S = 4.7e6  # by a worker

TEXT = """
This page extrapolates the measured costs of one station, one run and one file to a plant, and shows which limit comes first. **Nothing on it
was tried at these sizes**: the largest run had 250 stations, the largest store that was read {largest} rows.
[How cost grows](../reference/growth.md) has the sizes that were tried. A test makes the page from its figures
(`tests/support/pages/plant_sizes.py`).

## Measured

{measured}

Two cores of a virtual machine that did other work, 23 and 24 November 2026: `tests/bench/bench_many_stations.py`, `bench_fleet.py` and, by
hand, published runs of 300 to 1 million rows of one port.

## Extrapolated

Assumptions:

- A station has one port at 10 Hz with four reads a tick.
- One run has {run} stations, on one host with two cores.
- A shift has eight hours, a month {month} shifts, a year {year}.

{follows}

## Which limit comes first

| stations | limit | remedy |
| --- | --- | --- |
| 250 | the recorder: its loop takes {busy} of a core, and 99 % of its ticks are 5 to 11 ms late | none; record more stations as several runs, on several hosts |
| 1 000 | files: after a year without upkeep a reader of all data would open {files_1000} files of samples, at 1 ms each | `jbclog store compact` each week joins them; filters on line and time skip whole partitions |
| 10 000 | reading: a column of a month takes a worker {read_10000} | trends, rankings and capability read `metrics` and `joints`, some rows for each port and run; for samples, let the workers of a scheduler compute `statistics` of a line or a week |
| 100 000 | the table's log: {files_100000} files of samples a year, and each reader and each commit needs their list; and {stored_100000} a shift | a store for each site or year, of at most some ten thousand stations, queried one after another. jbclog does not join stores |

Commits are no limit before that. Each host publishes its own run: {commits_100000} commits a shift in all at 100 000 stations, one every {pause}.
Commits exclude each other only while a version gets its number; the one that comes second tries again.

## Not known

- the time of a commit on S3, and on a share over a real network;
- the memory of a recorder of 250 stations over a shift;
- joints and metrics of real lines (publishing them costs as much as a report, some 8 µs a row);
- a scheduler with more than three workers.
"""


@dataclass(frozen=True)
class Plant:
    """What a plant of so many stations costs."""

    stations: int

    @property
    def runs(self) -> int:
        return math.ceil(self.stations / RUN_STATIONS)

    @property
    def busy(self) -> float:
        """The share of a core that the recorder of a full run takes."""
        return min(self.stations, RUN_STATIONS) * READS * RATE_HZ * EXCHANGE_S

    @property
    def rows(self) -> float:
        """Of a shift."""
        return self.stations * RATE_HZ * SHIFT_S

    @property
    def publish_s(self) -> float:
        """Of a shift, by the processor of each host."""
        return PUBLISH_RUN_S + PUBLISH_ROW_S * self.rows / self.runs

    @property
    def commits(self) -> int:
        """Of a shift."""
        return self.runs * (OTHER_COMMITS + math.ceil(self.rows / self.runs / COMMIT_ROWS))

    @property
    def files(self) -> int:
        """Of samples, of a year, where nobody joins them."""
        return SHIFTS_A_YEAR * self.runs * math.ceil(self.rows / self.runs / COMMIT_ROWS)

    @property
    def read_s(self) -> float:
        """Of a column of a month, by one worker."""
        return SHIFTS_A_MONTH * self.rows / READ_ROWS_A_S


def page() -> str:
    """The whole page."""
    plants = {one: Plant(one) for one in STATIONS}
    measured = table(
        ("what", "measured"),
        [
            ("an exchange of a recorder of 64 to 250 stations", f"{EXCHANGE_S * 1e6:g} µs of CPU"),
            ("a row of samples, sealed", f"{SEALED_BYTES:g} bytes"),
            ("a row of samples in a store", f"{STORED_BYTES:g} bytes"),
            (
                "publishing, without joints",
                f"{PUBLISH_ROW_S * 1e6:g} µs of CPU a row, {PUBLISH_RUN_S:g} s a run",
            ),
            ("opening a table of a store", f"{OPEN_FILE_S * 1e3:g} ms a file"),
            (
                "statistics of a column of samples",
                f"{READ_ROWS_A_S / 1e6:g} million rows a second by a worker with one thread",
            ),
        ],
    )
    rows = [
        ("hosts that record", *(f"{one.runs}" for one in plants.values())),
        ("rows a shift", *(_count(one.rows) for one in plants.values())),
        ("sealed a shift", *(_bytes(SEALED_BYTES * one.rows) for one in plants.values())),
        ("stored a shift", *(_bytes(STORED_BYTES * one.rows) for one in plants.values())),
        (
            "stored a year",
            *(_bytes(SHIFTS_A_YEAR * STORED_BYTES * one.rows) for one in plants.values()),
        ),
        (
            "publishing a shift, CPU of each host",
            *(_time(one.publish_s) for one in plants.values()),
        ),
        ("commits a shift", *(_count(one.commits) for one in plants.values())),
        ("files of samples a year, not joined", *(_count(one.files) for one in plants.values())),
        ("a column of a month, by one worker", *(_time(one.read_s) for one in plants.values())),
        (
            "workers for that in a minute",
            *(_count(math.ceil(one.read_s / ANSWER_S)) for one in plants.values()),
        ),
    ]
    follows = table(("stations", *(f"{one:,}".replace(",", " ") for one in STATIONS)), rows)
    most = plants[100_000]
    text = TEXT.format(
        largest="100 million",
        measured=measured,
        run=RUN_STATIONS,
        month=SHIFTS_A_MONTH,
        year=SHIFTS_A_YEAR,
        follows=follows,
        busy=f"{100 * plants[250].busy:.0f} %",
        files_1000=_count(plants[1_000].files),
        read_10000=_time(plants[10_000].read_s),
        files_100000=_count(most.files),
        stored_100000=_bytes(STORED_BYTES * most.rows),
        commits_100000=_count(most.commits),
        pause=_time(SHIFT_S / most.commits),
    )
    return f"{MADE}\n\n# Plant sizes: 250 to 100 000 stations\n{text}"


def _two(value: float) -> str:
    """Two digits that count."""
    digits = 1 - math.floor(math.log10(value))
    return f"{round(value, digits):.{max(digits, 0)}f}"


def _count(value: float) -> str:
    for size, word in ((1e9, "thousand million"), (1e6, "million")):
        if value >= size:
            return f"{_two(value / size)} {word}"
    return f"{float(_two(value)):,.0f}".replace(",", " ")


def _bytes(value: float) -> str:
    for size, unit in ((1e15, "PB"), (1e12, "TB"), (1e9, "GB")):
        if value >= size:
            return f"{_two(value / size)} {unit}"
    return f"{_two(value / 1e6)} MB"


def _time(seconds: float) -> str:
    for size, unit in ((86_400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{_two(seconds / size)} {unit}"
    return f"{_two(seconds)} s"
