"""The ledger: due = ok + each reason, from the tables alone, and it knows when the session counted
otherwise.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import (
    COLUMN,
    CounterRow,
    RunStore,
    SampleRow,
    StationFacts,
    disagreements,
    ledger_of,
    quality_of,
    reasons_text,
    seal,
    seal_part,
)
from support.records import few_rows


def row(tick: int, port: int, reasons: dict[str, str] | None = None, **values: object) -> SampleRow:
    made = few_rows.sample(1, "a", port)
    for column in ("temperature_c", "power_permille"):
        made[COLUMN[column]] = None
    made[COLUMN["tick"]] = tick
    for column, value in values.items():
        made[COLUMN[column]] = value
    made[COLUMN["quality"]], made[COLUMN["reasons"]] = (
        quality_of(reasons or {}),
        reasons_text(reasons or {}),
    )
    return made


@pytest.fixture
def store(tmp_path: Path) -> RunStore:
    return few_rows.begun(tmp_path)


def sealed(store: RunStore) -> Path:
    store.close()
    seal(store.folder)
    store.release()
    return store.folder


def test_each_reading_is_due_and_ok_or_has_its_reason(store: RunStore) -> None:
    flags = {"alarm_high": "timeout", "alarm_low": "timeout"}
    store.sample(
        row(
            0,
            1,
            temperature_c=350,
            status="working",
            cooling=False,
            alarm_high=False,
            alarm_low=True,
        )
    )
    store.sample(row(1, 1, {"temperature_c": "timeout", **flags}, status="working", cooling=False))
    store.sample(row(2, 1, {"temperature_c": "nak3", "status": "bcc", "cooling": "bcc"}))
    store.sample(
        row(3, 1, {"delay_s": "not_counting"}, temperature_c=350, status="stand", cooling=False)
    )
    store.sample(row(0, 2, temperature_c=330))
    assert ledger_of(sealed(store)) == {
        "a": {
            "1": {
                "temperature_c": {"due": 4, "ok": 2, "nak3": 1, "timeout": 1},
                "status": {"due": 4, "ok": 3, "bcc": 1},
                "alarm_high": {"due": 2, "ok": 1, "timeout": 1},
                "delay_s": {"due": 1, "ok": 0, "not_counting": 1},
            },
            "2": {"temperature_c": {"due": 1, "ok": 1}},
        }
    }


def test_counters_by_their_names_and_a_failed_one_by_its_reason(store: RunStore) -> None:
    for value, raw in ((1.0, "00001"), (None, "<timeout>"), (None, "<nak4>"), (2.0, "00002")):
        store.counter(CounterRow(few_rows.T0, "a", 1, "work_h", value, "h", raw))
    store.counter(CounterRow(few_rows.T0, "a", None, "on_h", 1.0, "h", "00001"))
    assert ledger_of(sealed(store)) == {
        "a": {
            "1": {"work_h": {"due": 4, "ok": 2, "nak4": 1, "timeout": 1}},
            "station": {"on_h": {"due": 1, "ok": 1}},
        }
    }


def test_ticks_without_rows_were_due_for_what_is_read_every_tick(store: RunStore) -> None:
    store.sample(row(0, 1, temperature_c=350, setpoint_c=350))
    store.sample(row(1, 1, {"temperature_c": "skipped"}))
    facts = StationFacts(
        "a", "", "dde", skipped=50, due={"1": {"temperature_c": 2, "setpoint_c": 1}}
    )
    ledger = ledger_of(sealed(store), [facts])
    assert ledger["a"]["1"]["temperature_c"] == {"due": 52, "ok": 1, "skipped": 51}
    assert ledger["a"]["1"]["setpoint_c"] == {"due": 1, "ok": 1}
    assert list(disagreements(ledger, facts)) == []


def test_watched_settings_stand_in_it_as_the_session_counted_them(store: RunStore) -> None:
    facts = StationFacts(
        "a", "", "dde", watched={"1": {"alarm_high_limit": {"due": 3, "ok": 2, "timeout": 1}}}
    )
    assert ledger_of(sealed(store), [facts]) == {
        "a": {"1": {"alarm_high_limit": {"due": 3, "ok": 2, "timeout": 1}}}
    }


def test_it_says_where_the_session_counted_otherwise(store: RunStore) -> None:
    store.sample(row(0, 1, temperature_c=350, tool=2))
    store.counter(few_rows.counter(1))
    store.counter(few_rows.counter(2))
    due = {"temperature_c": 2, "tool": 1, "work_h": 1, "status": 1}
    facts = StationFacts("a", "", "dde", due={"1": due, "2": {"tool": 5}})
    found = list(disagreements(ledger_of(sealed(store)), facts))
    assert found == [
        "a port 1: temperature_c: 1 reading in the record, 2 were due",
        "a port 1: status: 0 readings in the record, 1 were due",
        "a port 2: tool: 0 readings in the record, 5 were due",
    ]
    facts.due = {"1": {"temperature_c": 0}}
    assert list(disagreements(ledger_of(store.folder), facts)) == [
        "a port 1: temperature_c: 1 reading in the record, 0 were due"
    ]


def test_it_is_the_same_in_many_parts(tmp_path: Path) -> None:
    store = few_rows.begun(tmp_path)
    for first in range(0, 300, 100):
        few_rows.hand_over(store, range(first, first + 100))
        store.commit_now()
        seal_part(store.folder)
    whole = few_rows.begun(tmp_path)
    few_rows.hand_over(whole, range(300))
    assert ledger_of(sealed(store)) == ledger_of(sealed(whole))
