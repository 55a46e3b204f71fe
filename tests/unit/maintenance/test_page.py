"""The page of an audit: what it says first, that it opens offline, and that nothing from outside
can act in it.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from itertools import cycle

import msgspec
import pytest
from matplotlib import rc_context

from jbclog.cli.audit_end import lines
from jbclog.core.chain import CUT_OFF
from jbclog.maintenance.due import State, TaskState
from jbclog.maintenance.fleet import FleetAudit
from jbclog.report.audit.overview import overview_of
from jbclog.report.audit.page import page_of
from support.faults.hostile_names import HOSTILE, Acting
from support.fleets import fleets

every_fleet = pytest.mark.parametrize("make", fleets.ALL.values(), ids=fleets.ALL)


@functools.cache
def drawn(make: Callable[[], FleetAudit]) -> str:
    """The page of an audit, drawn once for all that is looked for in it."""
    return page_of(make())


def first(*tasks: TaskState) -> FleetAudit:
    """One station, read for the first time."""
    return fleets.fleet(replace(fleets.station("a", 1, tasks=tasks), audits=1))


def words(page: str) -> str:
    """What a reader sees."""
    seen = re.sub(r"<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", seen)


@every_fleet
def test_the_same_audit_gives_the_same_bytes(make: Callable[[], FleetAudit]) -> None:
    assert page_of(make()) == drawn(make)


def test_what_a_user_has_set_for_figures_does_not_change_it() -> None:
    known = drawn(fleets.trouble)
    with rc_context({"lines.solid_capstyle": "round", "font.size": 30, "lines.antialiased": False}):
        assert page_of(fleets.trouble()) == known


@every_fleet
def test_the_page_needs_nothing_but_itself(make: Callable[[], FleetAudit]) -> None:
    page = drawn(make)
    assert (
        "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'" in page
    )
    # the drawings are ours, of numbers only
    assert Acting(re.sub(r"</?svg[^>]*>", "", page)).found == []
    assert not re.search(r"url\(|@import|<img|<script|href=", page)


def test_the_worst_station_stands_first_and_the_headline_says_how_many() -> None:
    seen = words(drawn(fleets.trouble))
    assert "✕ 1 OVERDUE" in seen
    assert "of 8 stations, of which 2 did not answer" in seen
    order = [row.station.station for row in overview_of(fleets.trouble()).rows]
    assert order[:4] == ["line3-ale", "line3-dme", "line3-hde", "line3-dde-b"]
    assert order[4] == "line3-dde-c"  # never seen, before those of which something is not known
    assert order[-2:] == ["line3-jtse", "line3-nae"]


def test_of_what_is_not_used_up_the_soonest_stands_first() -> None:
    late, soon = fleets.task(0, 70, pace=0.1), fleets.task(0, 40, pace=4.0)
    rows = overview_of(
        fleets.fleet(fleets.station("a", 1, tasks=(late,)), fleets.station("b", 1, tasks=(soon,)))
    ).rows
    assert [row.station.station for row in rows] == ["b", "a"]


@pytest.mark.parametrize(
    ("make", "headline"),
    [
        (fleets.three, "✕ 1 OVERDUE"),
        (fleets.empty, "? NO STATION AUDITED"),
        (fleets.first_ever, "✓ BASELINE RECORDED"),
        (lambda: first(fleets.unknown_task(0)), "✓ BASELINE RECORDED"),
        (lambda: first(), "✓ BASELINE RECORDED"),
        (lambda: first(fleets.task(0, 101)), "✕ 1 DUE"),  # by the calendar
        (
            lambda: replace(first(fleets.unknown_task(0)), wrong=("line 1 was changed",)),
            "? 1 NOT KNOWN",
        ),
        (
            lambda: replace(
                fleets.fleet(fleets.station("a", 1, tasks=(fleets.task(0, 9),))),
                wrong=("c.jsonl: line 1 is no line of a ledger, or was changed",),
            ),
            "? NOT KNOWN: THE LEDGER IS DAMAGED",
        ),
        (
            lambda: replace(
                fleets.fleet(fleets.station("a", 1, tasks=(fleets.task(0, 9),))),
                wrong=(f"c.jsonl: line 4 {CUT_OFF}",),
            ),
            "✓ NOTHING IS DUE",
        ),
        (
            lambda: replace(first(), not_kept=("c.jsonl cannot be read: is a pipe, not a file",)),
            "? NOT KEPT IN THE LEDGER",
        ),
        (
            lambda: fleets.fleet(
                *first().stations, replace(*first().stations, station="b", seen=False)
            ),
            "– 1 NOT SEEN",
        ),
        (lambda: fleets.fleet(fleets.station("a", 1, tasks=(fleets.task(0, 85),))), "△ 1 DUE SOON"),
        (
            lambda: fleets.fleet(fleets.station("a", 1, tasks=(fleets.unknown_task(0),))),
            "? 1 NOT KNOWN",
        ),
        (lambda: fleets.fleet(fleets.station("a", 1, tasks=())), "– NO TASK DEFINED"),
        (
            lambda: fleets.fleet(
                replace(fleets.station("a", 1, tasks=(fleets.task(0, 9),)), seen=False)
            ),
            "– 1 NOT SEEN",
        ),
    ],
)
def test_the_headline_is_the_worst_that_there_is(
    make: Callable[[], FleetAudit], headline: str
) -> None:
    assert f" {headline} " in words(drawn(make))


def test_a_due_range_is_a_range_and_never_one_day() -> None:
    page = words(drawn(fleets.three))
    assert re.search(
        r"83 to 84 %, 334 to 338 of 400 h due 2026-12-18 to 2026-12-29", page.replace("\u00a0", " ")
    )
    far = replace(fleets.task(0, 5, pace=0.2), state=State.FINE)
    assert "or later" in words(page_of(fleets.fleet(fleets.station("a", 1, tasks=(far,)))))


def test_the_first_audit_ever_promises_nothing() -> None:
    page = words(drawn(fleets.first_ever))
    assert (
        "First audit: 3 stations read; their use counts from here. Next: audit daily. Due dates"
        " need at least 4 audits." in page
    )
    assert "not enough data: 1 of 4 audits" in page
    assert "Not counted here, or not read twice yet." in page


def test_a_first_audit_says_once_what_no_station_knows_and_what_is_not_defined() -> None:
    unknown = replace(
        fleets.unknown_task(5), title="Verify the tip", why="no verification", port=None
    )
    both = fleets.fleet(
        *(replace(fleets.station(name, 0, tasks=(unknown,)), audits=1) for name in ("a", "b"))
    )
    assert list(overview_of(both).reasons[2:]) == ["a and b: Verify the tip, no verification"]
    assert "No task is defined: --tasks names a file of tasks" in words(page_of(first()))
    headline, did, following, *_ = lines(both)
    assert headline == "✓ BASELINE RECORDED"
    assert (did, following) == overview_of(both).reasons[:2]


@every_fleet
def test_a_phone_where_headings_are_hidden_shows_the_name_of_each_figure(
    make: Callable[[], FleetAudit],
) -> None:
    page = drawn(make)
    assert re.findall(r'<td class="(?:n|used|when|wide)">(?!<small class="k">).{40}', page) == []
    hidden, phone = (
        page.index(".rows small.k { display: none; }"),
        page.index("@media screen and (max-width: 640px)"),
    )
    assert (
        hidden
        < phone
        < page.index(
            ".rows small.k, .overview td.used small.k, .overview td.when small.k { display: inline;"
        )
    )


def test_what_is_not_known_is_a_dash_with_its_reason_and_never_zero() -> None:
    page = words(drawn(fleets.three))
    assert "–¹" in page
    assert "No run was recorded." in page


def test_marks_stand_with_their_rule_and_what_was_worked_at_least_and_at_most() -> None:
    page = words(drawn(fleets.trouble))
    found = page[
        page.index("Counter changes that are not explained", page.index("Not seen Station")) :
    ]
    for said in (
        "working: 941, 12; 12 to 121 h",
        "fell together",
        "impossible",
        "31 or more",
        "nothing tells why",
    ):
        assert said in found, said
    assert "Rolled over as expected: line3-ale · port 1, feeds, 1 time." in found
    assert "line 41 is no observation or fact, or was changed" in page


def test_of_what_a_ledger_can_have_without_end_the_page_has_a_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    audit = fleets.three()
    (one,) = audit.facts
    told = [
        replace(
            one, time=f"2026-{day // 28 + 1:02d}-{day % 28 + 1:02d}T06:00:00+00:00", part=f"T-{day}"
        )
        for day in range(260)
    ]
    long = replace(told[-1], text="x" * 300_000)
    page = page_of(replace(audit, facts=(long, *told[:-1])))  # in any order
    shown = words(page)
    assert "60 older ones are in the JSON file" in shown
    assert ("T-259 " in shown, "T-60 " in shown, "T-59 " in shown) == (True, True, False)
    assert shown.index("T-259 ") < shown.index("T-258 ")
    assert "x… (290000 characters are left out)" in shown
    whole = words(drawn(fleets.three))
    rows = whole.count("known", whole.index("Counters and totals"))
    assert (rows > 1, "more are in the CSV" in whole) == (True, False)
    monkeypatch.setattr("jbclog.report.audit.page.MOST_METERS", 1)
    assert re.search(r" \d+ more are in the CSV and JSON files", words(page_of(audit)))


def test_drift_says_from_how_many() -> None:
    page = words(drawn(fleets.trouble))
    assert "port 1: sleep delay ≠ off, 6 of 7 others have 5 line3-hde and line3-nae" in page
    assert "0203457, was 0203456 at the last audit" in page


def test_errors_now_and_since() -> None:
    page = words(drawn(fleets.trouble))
    assert "line3-dme · port 2 now short circuit" in page
    assert "line3-dme since the previous audit port.error: 3" in page


def test_a_hall_of_a_hundred_is_drawn_small_and_whole() -> None:
    page = drawn(fleets.hundred)
    assert len(page) < 1_000_000
    for number in range(1, 101):
        assert page.count(f"<b>hall-{number:03}</b>") >= 2  # what is due, and use


def spoilt(value: object, texts: object) -> object:
    """The same value with a hostile text in the place of every text that is not a time or a word of
    ours.
    """
    if isinstance(value, msgspec.Struct) or (is_dataclass(value) and not isinstance(value, type)):
        kept = {
            "time",
            "told",
            "audit",
            "start",
            "stop",
            "since",
            "last_seen",
            "p10",
            "p50",
            "p90",
            "than",
            "kind",
            "name",
        }
        names = (
            [one.name for one in fields(value) if one.init]
            if is_dataclass(value)
            else value.__struct_fields__
        )
        changed = {name: spoilt(getattr(value, name), texts) for name in names if name not in kept}
        return (
            replace(value, **changed)
            if is_dataclass(value)
            else msgspec.structs.replace(value, **changed)
        )
    if isinstance(value, tuple):
        return tuple(spoilt(one, texts) for one in value)
    if isinstance(value, dict):
        return {key: spoilt(one, texts) for key, one in value.items()}
    if type(value) is str:
        return next(texts)  # type: ignore[call-overload]
    return value


@pytest.mark.parametrize("first", range(0, len(HOSTILE), 12))
def test_texts_from_outside_are_shown_and_do_nothing(first: int) -> None:
    texts = cycle([*HOSTILE.values()][first:] + [*HOSTILE.values()][:first])
    page = page_of(spoilt(fleets.trouble(), texts))  # type: ignore[arg-type]
    ours = (
        r'<svg class="\w+" width="[\d.]+" height="[\d.]+" role="img" [^<>]*>|<svg viewBox="0 0 12'
        r' 12"[^<>]*>|</svg>'
    )
    assert Acting(re.sub(ours, "", page)).found == []
    assert not re.search("[\u202a-\u202e\u2066-\u2069\x00\x1b\x07\x08]", page)
