"""How an audit ends, and what of it CSV, JSON and terminal say."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from math import inf

import pytest

from jbclog.cli.audit_end import End, lines
from jbclog.maintenance.counter_totals.observed import Count, Standing
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.due import State
from jbclog.maintenance.fleet import USUAL, Finding, FleetAudit, StationAudit, exit_code, findings
from jbclog.report.audit.files import COLUMNS, SCHEMA, plain_audit, sheet_of
from jbclog.report.audit.overview import overview_of
from support.faults.hostile_names import HOSTILE
from support.fleets import fleets

every_fleet = pytest.mark.parametrize("make", fleets.ALL.values(), ids=fleets.ALL)


def rows(audit: FleetAudit) -> list[dict[str, str]]:
    text = sheet_of(audit)
    assert text.startswith("\ufeff")
    return list(csv.DictReader(io.StringIO(text.removeprefix("\ufeff"))))


def read_as(one: StationAudit, standing: Standing, why: str = "") -> StationAudit:
    """The station with its first counter read so."""
    first, *others = one.meters
    return replace(
        one,
        meters=(
            replace(first, read=Count(1, first.counter, "h", None, standing, (1, 2, 3), why)),
            *others,
        ),
    )


FINE = fleets.station("fine", 1, tasks=(fleets.task(0, 20),))


@pytest.mark.parametrize(
    ("station", "found", "code"),
    [
        (FINE, set(), 0),
        (replace(FINE, tasks=(fleets.task(0, 85),)), {Finding.SOON}, 0),
        (
            replace(FINE, tasks=(fleets.task(0, 104), fleets.task(1, 85))),
            {Finding.DUE, Finding.SOON},
            1,
        ),
        (replace(FINE, tasks=(fleets.task(0, 130),)), {Finding.OVERDUE}, 1),
        (replace(FINE, tasks=(fleets.unknown_task(0),)), set(), 0),
        (replace(FINE, seen=False), {Finding.UNSEEN}, 3),
        (
            replace(FINE, seen=False, tasks=(fleets.task(0, 130),)),
            {Finding.UNSEEN, Finding.OVERDUE},
            3,
        ),
        (read_as(FINE, Standing.MOVING), {Finding.SUSPECT}, 1),
        (read_as(FINE, Standing.UNREAD, "timeout"), {Finding.UNSEEN}, 3),
        (read_as(FINE, Standing.UNREAD, "nak4"), set(), 0),
    ],
)
def test_the_exit_code_follows_from_what_is_found(
    station: StationAudit, found: set[Finding], code: int
) -> None:
    assert findings(station) == found
    assert exit_code(fleets.fleet(FINE, station)) == code


def test_doubt_and_drift_are_found_where_they_are() -> None:
    by_name = {one.station: findings(one) for one in fleets.trouble().stations}
    assert Finding.SUSPECT in by_name["line3-dme"]
    assert Finding.SUSPECT not in by_name["line3-dde-a"]  # a reset is known for what it is
    assert Finding.DRIFT in by_name["line3-nae"]


@pytest.mark.parametrize(
    ("named", "code"), [(USUAL, 3), ((Finding.DUE,), 1), ((Finding.SUSPECT,), 1), ((), 0)]
)
def test_what_is_not_named_does_not_count(named: tuple[Finding, ...], code: int) -> None:
    assert exit_code(fleets.trouble(), named) == code


@pytest.mark.parametrize(("trouble", "code"), [([], 0), (["a run cannot be read"], 4)])
def test_trouble_is_printed_and_is_exit_code_4(
    trouble: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    end = End(fleets.fleet(FINE), trouble, USUAL)
    assert end.code == code
    end.show(as_json=False)
    assert capsys.readouterr().err.splitlines() == [f"error: {text}" for text in trouble]
    end.show(as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert (told["trouble"], told["exit_code"]) == (trouble, code)


def test_a_question_is_printed_first_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    asked = "port 1 work_h 900, now 3: reset, exchanged, or rolled over between A and B."
    end = End(fleets.fleet(replace(FINE, question=asked)), [], USUAL)
    assert end.code == 1
    end.show(as_json=False)
    assert "suspect" in capsys.readouterr().out.partition(asked)[0]
    assert asked in sheet_of(end.audit)
    assert f"{FINE.station}: {asked}" in overview_of(end.audit).reasons


# -- CSV -------------------------------------------------------------------------------------------


def test_the_columns_are_those_that_were_promised() -> None:
    """Whoever reads these files has them by name: a change is a new SCHEMA and a line in the change
    log.
    """
    assert SCHEMA == 1
    assert (
        ",".join(COLUMNS)
        == "schema,audit,line,station,url,family,model,software,seen,source,last_seen,"
        "kind,port,name,uom,value,low,high,standing,state,since,due_p10,due_p50,due_p90,part,text"
    )


@every_fleet
def test_every_row_says_of_what_it_is(make: Callable[[], FleetAudit]) -> None:
    audit = make()
    for row in rows(audit):
        assert list(row) == list(COLUMNS)
        assert (row["schema"], row["audit"], bool(row["station"])) == ("1", audit.audit, True)
        assert row["kind"] in ("station", "counter", "task", "use", "error", "parameter", "note")
        assert all(
            "inf" not in row[name] and "nan" not in row[name] for name in ("value", "low", "high")
        )
    assert sum(row["kind"] == "station" for row in rows(audit)) == len(audit.stations)


def test_tasks_and_counters_are_in_it_as_numbers() -> None:
    found = rows(fleets.three())
    (tip,) = [
        row
        for row in found
        if row["kind"] == "task" and row["station"] == "ale-1" and row["name"] == "tip-change"
    ]
    assert (tip["value"], tip["uom"], tip["state"], tip["port"], tip["part"]) == (
        "400.0",
        "h",
        "overdue",
        "1",
        "T-0231",
    )
    assert float(tip["low"]) < 131 < float(tip["high"])
    (soon,) = [row for row in found if row["name"] == "rollers" and row["state"] == "soon"]
    assert soon["due_p10"] < soon["due_p50"] < soon["due_p90"]
    (worked,) = [
        row
        for row in found
        if (row["station"], row["kind"], row["name"]) == ("dde-2", "counter", "work_h")
    ]
    assert (worked["standing"], float(worked["value"]).is_integer()) == ("ok", True)


def test_what_has_no_end_leaves_it_empty() -> None:
    audit = fleets.fleet(replace(FINE, tasks=(fleets.unknown_task(0),)))
    (task,) = [row for row in rows(audit) if row["kind"] == "task"]
    assert (task["low"], task["high"], task["text"]) == ("30", "", "a reset lost hours")


@pytest.mark.parametrize("text", ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3"])
def test_no_text_becomes_a_formula(text: str) -> None:
    audit = fleets.fleet(replace(FINE, notes=(text,), why=text))
    assert {row["text"] for row in rows(audit) if row["kind"] in ("note", "station")} == {
        f"'{text}"
    }


# -- JSON and terminal -----------------------------------------------------------------------------


@every_fleet
def test_json_has_no_infinity_and_each_stations_findings(make: Callable[[], FleetAudit]) -> None:
    told = json.loads(json.dumps(plain_audit(make()), allow_nan=False))
    assert {one["state"] for one in told["stations"]} <= {state.value for state in State}
    assert [one["station"] for one in told["stations"]] == [one.station for one in make().stations]


def test_json_says_null_where_there_is_no_end() -> None:
    told = plain_audit(
        fleets.fleet(replace(FINE, tasks=(replace(fleets.task(0, 20), used=Interval(3, inf)),)))
    )
    assert '"used": {"low": 3, "high": null}' in json.dumps(told)


def test_the_table_has_the_worst_first_and_says_what_to_do() -> None:
    told = lines(fleets.trouble())
    assert told[0] == "✕ 1 OVERDUE"
    assert told[1].startswith("OVERDUE    line3-ale    ALE 0203456  worked ")
    assert told[2].startswith(
        "           overdue      port 1 Tip change (T-0231): 141 to 142 %, 566 to 570 of 400 h; "
    )
    seen = "\n".join(told)
    for text in (
        "NOT SEEN   line3-dde-c  Robot mode is off",
        "DUE SOON   line3-dde-b  did not answer within 2 s (last seen: ",
        "suspect      port 1 plugged_h: 820 h more in 168 h",
        "error        port 2 short circuit",
        "drift        1.sleep_delay: off, 6 of 7 others have 5",
    ):
        assert text in seen


def test_the_table_tells_what_was_not_read() -> None:
    moving, unread = (
        "\n".join(lines(fleets.fleet(one)))
        for one in (read_as(FINE, Standing.MOVING), read_as(FINE, Standing.UNREAD, "timeout"))
    )
    assert "unread  port 1 plugged_h: moving, 1, 2, 3" in moving
    assert "unread  port 1 plugged_h: timeout" in unread


def test_what_is_not_known_has_no_number() -> None:
    why = "last service date unknown"
    told = replace(
        fleets.task(5, 20), used=None, percent=None, state=State.UNKNOWN, due=None, why=why
    )
    seen = "\n".join(lines(fleets.fleet(replace(FINE, tasks=(told,)))))
    assert f"not known  Tip temperature verified: {why} (interval: 90 d)" in seen


def test_names_from_outside_stay_on_their_line() -> None:
    one = replace(FINE, notes=tuple(HOSTILE))
    told = list(lines(fleets.fleet(one)))
    assert len(told) == len(list(lines(fleets.fleet(FINE)))) + len(HOSTILE)
    assert [line for line in told if "\n" in line or not line.isprintable()] == []
