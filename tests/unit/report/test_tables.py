"""The report's tables: nothing is left out without a word, nothing unknown becomes a number."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError
from jbclog.core.rows import CounterRow, EventRow, Severity
from jbclog.report import tables
from jbclog.report.tables import (
    COUNTER_COLUMNS,
    MOST_EVENTS,
    by_station,
    counter_rows,
    event_rows,
    ledger_rows,
    setting_rows,
)
from support.records.sealed_run import limit, micros, samples, seal, station, table


def test_of_too_many_events_the_gravest_are_kept_in_order_and_the_rest_is_counted(
    tmp_path: Path,
) -> None:
    told = [
        EventRow(micros(i), "read.timeout", Severity.WARNING, "x", "dde-1", 1)
        for i in range(MOST_EVENTS + 50)
    ]
    told.append(EventRow(micros(5000), "link.lost", Severity.CRITICAL, "x", "dde-1"))
    rows, left = event_rows(open_run(seal(tmp_path, [station()], table(), told)).events())
    assert len(rows) == MOST_EVENTS
    assert rows[-1]["kind"] == "link.lost"
    assert left is not None
    assert left.rows == 51
    assert rows == sorted(rows, key=lambda row: str(row["time"]))


def test_of_a_severity_that_is_not_known_it_is_shown_as_a_warning(tmp_path: Path) -> None:
    """As of a newer jbclog, or of a forged part."""
    told = [
        EventRow(micros(i), "x", severity, "x", "dde-1")
        for i, severity in enumerate([Severity.INFO] * MOST_EVENTS + [Severity.ERROR] * 2)
    ]
    events = open_run(seal(tmp_path, [station()], table(), told)).events()
    events["severity"] = ["info"] * (MOST_EVENTS - 1) + ["grave", "info", "error"]
    rows, left = event_rows(events)
    assert left is not None
    assert [row["severity"] for row in rows[-3:]] == ["info", "grave", "error"]


def test_events_keep_what_is_missing_missing(tmp_path: Path) -> None:
    rows, left = event_rows(
        open_run(
            seal(
                tmp_path,
                [station()],
                table(),
                [EventRow(micros(1), "run.start", Severity.INFO, "x")],
            )
        ).events()
    )
    assert left is None
    assert rows == [
        {
            "seq": 0,
            "time": "2026-09-21T14:13:21.000000Z",
            "earliest": None,
            "station": None,
            "port": None,
            "kind": "run.start",
            "severity": "info",
            "code": None,
            "text": "x",
            "value": None,
            "limit_value": None,
            "raw": None,
        }
    ]


def test_a_setting_read_again_and_found_the_same_is_not_repeated(tmp_path: Path) -> None:
    again = limit("high", "380")._replace(outcome="read", requested=None, written=None)
    other = again._replace(readback="390", time=micros(40))
    found = open_run(
        seal(
            tmp_path,
            [station()],
            table(),
            settings=[limit("high", "380"), again, again, other, other],
        )
    )
    rows, left = setting_rows(found.settings())
    assert [(row["outcome"], row["readback"]) for row in rows] == [
        ("confirmed", "380"),
        ("read", "390"),
    ]
    assert left is not None
    assert left.rows == 3


def test_of_too_many_settings_those_that_decide_are_shown_and_the_rest_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In their order: a setting that differs from the recipe is never cut off by readings."""
    monkeypatch.setattr(tables, "MOST_SETTINGS", 3)
    outcomes = ["read", "confirmed", "read", "mismatch", "grave", "unchanged"]
    told = [
        limit("high", f"{380 + number}")._replace(outcome=outcome)
        for number, outcome in enumerate(outcomes)
    ]
    rows, left = setting_rows(
        open_run(seal(tmp_path, [station()], table(), settings=told)).settings()
    )
    assert [row["outcome"] for row in rows] == ["confirmed", "mismatch", "grave"]
    assert left is not None
    assert (left.rows, left.text) == (
        3,
        "further readings, none graver than these, are in settings/.",
    )


def test_too_many_counters_are_no_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "MOST_COUNTERS", 2)
    told = [counter(name, 1.0) for name in ("work_h", "plugged_h", "sleep_h", "work_h")]
    with pytest.raises(RecordError, match="has more than 2 counters"):
        counted(tmp_path, told)
    assert len(counted(tmp_path / "other", [one for one in told if one.counter != "sleep_h"])) == 2


def counted(out: Path, told: list[CounterRow]) -> list[dict[str, object]]:
    run = open_run(seal(out, [station()], table(), counters=told))
    return counter_rows(run.groups("counters", [*COUNTER_COLUMNS]), out)


def test_counters_are_read_in_pieces(tmp_path: Path) -> None:
    """A week of 32 ports has more than two million rows."""
    told = [counter("work_h", value) for value in (3.0, 4.0, None, 9.0)]
    told += [counter("sleep_h", value, "<timeout>") for value in (None, 2.0)]
    run = open_run(seal(tmp_path, [station()], table(), counters=told))
    (rows,) = run.groups("counters", [*COUNTER_COLUMNS])
    pieces = [rows.slice(number, 1) for number in range(len(rows))]
    assert counter_rows(pieces, tmp_path) == counter_rows([rows], tmp_path)
    assert [
        (row["counter"], row["first"], row["last"], row["difference"], row["readings"], row["note"])
        for row in counter_rows(pieces, tmp_path)
    ] == [
        ("work_h", 3.0, 9.0, 6.0, 4, ""),
        ("sleep_h", None, 2.0, None, 2, "Not read: <timeout>."),
    ]


def counter(name: str, value: float | None, raw: str = "00001", second: float = 0) -> CounterRow:
    return CounterRow(micros(second), "dde-1", 1, name, value, "h", raw)


def test_counters_at_start_and_end(tmp_path: Path) -> None:
    told = [
        *(counter("work_h", value) for value in (811.0, 811.0, 813.0)),
        *(counter("plugged_h", value) for value in (99_990.0, 5.0)),
        *(counter("sleep_h", value, raw) for value, raw in ((4.0, "00004"), (None, "<timeout>"))),
        counter("hibernation_h", 7.0),
    ]
    rows = {str(row["counter"]): row for row in counted(tmp_path, told)}
    assert (rows["work_h"]["first"], rows["work_h"]["last"], rows["work_h"]["difference"]) == (
        811,
        813,
        2,
    )
    assert rows["plugged_h"]["difference"] is None
    assert "Decreased" in str(rows["plugged_h"]["note"])
    assert (rows["sleep_h"]["last"], rows["sleep_h"]["difference"]) == (None, None)
    assert rows["sleep_h"]["note"] == "Not read: <timeout>."
    assert (rows["hibernation_h"]["last"], rows["hibernation_h"]["difference"]) == (None, None)


def test_the_ledger_has_every_reason_the_commonest_first(tmp_path: Path) -> None:
    ledger = {
        "dde-1": {
            "1": {
                "temperature_c": {"due": 10, "ok": 7, "timeout": 2, "bcc": 1},
                "work_h": {"due": 2, "ok": 2},
            },
            "station": {"maximum_temperature": {"due": 4, "ok": 0, "timeout": 4}},
        }
    }
    rows, reasons = ledger_rows(ledger)
    assert reasons == ["timeout", "bcc"]
    assert rows[0] == {
        "station": "dde-1",
        "port": 1,
        "signal": "temperature_c",
        "due": 10,
        "ok": 7,
        "reasons": {"timeout": 2, "bcc": 1},
    }
    assert rows[2]["port"] is None
    assert all(row["due"] == row["ok"] + sum(row["reasons"].values()) for row in rows)  # type: ignore[operator,attr-defined]


def test_samples_of_a_real_run_are_in_its_ledger(tmp_path: Path) -> None:
    rows, _ = ledger_rows(
        open_run(seal(tmp_path, [station(rows=600)], table(samples(600)))).manifest.ledger
    )
    assert {
        "station": "dde-1",
        "port": 1,
        "signal": "temperature_c",
        "due": 600,
        "ok": 600,
        "reasons": {},
    } in rows


def test_rows_stand_in_the_line_files_order() -> None:
    rows: list[dict[str, object]] = [
        {"station": station, "port": port, "n": n}
        for n in (1, 2)
        for station in ("b", "x", "a")
        for port in (None, 2, 1)
    ]
    found = [(row["station"], row["port"], row["n"]) for row in by_station(rows, ["b", "a"])]
    assert found[:6] == [
        ("b", 1, 1),
        ("b", 1, 2),
        ("b", 2, 1),
        ("b", 2, 2),
        ("b", None, 1),
        ("b", None, 2),
    ]
    assert [station for station, _, _ in found[::6]] == ["b", "a", "x"]
