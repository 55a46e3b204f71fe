"""When a job that waits for a time of day begins: around midnight, a time just past, and the two
nights of summer time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import pytest

from jbclog.config.job_order import At, Turn, due, due_times, read_at
from support.faults.batch_world import Fate, World

ROME = "Europe/Rome"  # in 2026: 02:00 becomes 03:00 on 29 March, 03:00 becomes 02:00 on 25 October


@pytest.fixture(params=["by name", "of the system"])
def rome(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[ZoneInfo | None]:
    if request.param == "by name":
        yield ZoneInfo(ROME)
        return
    monkeypatch.setenv("TZ", ROME)
    time.tzset()
    yield None
    monkeypatch.undo()
    time.tzset()


def utc(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


def at(text: str) -> At:
    found = read_at(text)
    assert found is not None
    return found


def begins(rome: ZoneInfo | None, wanted: str, started: str) -> str | None:
    """When a job at `wanted` (local) begins, in UTC, if its batch is started at `started` (UTC)."""
    moment = due_times([Turn("job", frozenset(), at=at(wanted))], utc(started), rome)["job"]
    return (
        None if moment is None else datetime.fromtimestamp(moment, UTC).strftime("%m-%d %H:%M:%S")
    )


@pytest.mark.parametrize(
    ("wanted", "started", "utc_time"),
    [
        ("22:00", "2026-11-20 17:00", "11-20 21:00:00"),
        ("22:00", "2026-11-20 21:00:20", "11-20 21:00:00"),  # twenty seconds late: now
        ("22:00", "2026-11-20 21:09:59", "11-20 21:00:00"),
        ("22:00", "2026-11-20 21:10:01", "11-21 21:00:00"),  # missed: the next one
        ("00:00", "2026-11-20 22:59:59", "11-20 23:00:00"),  # midnight, in a second
        ("00:00", "2026-11-20 23:00:01", "11-20 23:00:00"),
        ("23:59", "2026-11-20 23:05:00", "11-20 22:59:00"),  # of the day before, and just past
        ("00:05", "2026-12-31 22:30", "12-31 23:05:00"),  # and so next year, local
        ("2026-11-22 02:30", "2026-11-20 17:00", "11-22 01:30:00"),
        ("2026-11-20 22:00", "2026-11-20 21:05", "11-20 21:00:00"),
        ("2026-11-20 22:00", "2026-11-20 21:11", None),  # over
        ("06:00:30", "2026-11-20 17:00", "11-21 05:00:30"),
    ],
)
def test_the_next_time_that_the_clock_shows_it(
    rome: ZoneInfo | None, wanted: str, started: str, utc_time: str | None
) -> None:
    assert begins(rome, wanted, started) == utc_time


@pytest.mark.parametrize(
    ("wanted", "started", "utc_time"),
    [
        # the night of 29 March: 01:00 UTC is 02:00 and at once 03:00 local
        ("02:30", "2026-03-28 21:00", "03-29 01:00:00"),  # there is none: at the skip
        ("02:00", "2026-03-28 21:00", "03-29 01:00:00"),
        ("03:00", "2026-03-28 21:00", "03-29 01:00:00"),
        ("01:59", "2026-03-28 21:00", "03-29 00:59:00"),
        ("03:30", "2026-03-28 21:00", "03-29 01:30:00"),
        ("02:30", "2026-03-29 01:20", "03-30 00:30:00"),  # the skip is past
        ("22:00", "2026-03-28 22:00", "03-29 20:00:00"),  # 22 hours later, not 23
        # the night of 25 October: 02:00 to 03:00 local comes twice, from 00:00 and from 01:00 UTC
        ("02:30", "2026-10-24 21:00", "10-25 00:30:00"),  # the first
        ("02:30", "2026-10-25 00:35", "10-25 00:30:00"),  # just past
        ("02:30", "2026-10-25 00:45", "10-25 01:30:00"),  # the clock shows it once more
        ("02:30", "2026-10-25 01:45", "10-26 01:30:00"),
        ("03:00", "2026-10-24 21:00", "10-25 02:00:00"),
        ("22:00", "2026-10-24 21:00", "10-25 21:00:00"),
    ],
)
def test_the_two_nights_of_summer_time(
    rome: ZoneInfo | None, wanted: str, started: str, utc_time: str
) -> None:
    assert begins(rome, wanted, started) == utc_time


def test_jobs_behind_each_other_are_a_timetable_also_across_midnight(rome: ZoneInfo | None) -> None:
    turns = [
        Turn("evening", frozenset({"s1"}), at=at("22:00")),
        Turn("night", frozenset({"s1"}), at=at("02:00")),
        Turn("elsewhere", frozenset({"s2"}), at=at("02:00")),
        Turn("follows", frozenset({"s2"}), ("evening",), at=at("01:00")),
        Turn("second night", frozenset({"s1"}), at=at("02:00:00")),
    ]
    found = due_times(turns, utc("2026-11-20 23:30"), rome)  # 00:30 local
    told = {
        name: datetime.fromtimestamp(moment or 0, UTC).strftime("%d %H:%M")
        for name, moment in found.items()
    }
    assert told == {
        "evening": "21 21:00",
        "night": "22 01:00",
        "elsewhere": "21 01:00",
        "follows": "22 00:00",
        "second night": "22 01:00",
    }


@pytest.mark.parametrize(
    "text",
    ["", "22", "24:00", "22:60", "2026-02-30 22:00", "22:00Z", "٢٢:٠٠", "10 pm", "2026-11-22"],
)
def test_what_is_no_time(text: str) -> None:
    assert read_at(text) is None


def test_a_date_that_is_over_is_due_never() -> None:
    assert due(at("2020-01-01 00:00"), utc("2026-01-01 00:00")) is None


def test_gone_on_with_after_midnight_a_job_keeps_its_moment() -> None:
    """What it waits for was written down when the batch began: no other day's 15:00."""
    bench = World([Turn("a", frozenset({"s1"}), at=at("15:00"))], lambda name, attempt: Fate())
    began = bench.now = bench.now + 86_400.0  # killed at once, started again the day after
    bench.executor().work()
    assert [process.began for process in bench.processes] == [began]
