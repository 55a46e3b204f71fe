"""When a station that does not answer is certain to be the one from before, and what it may get."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest

from support.product import (
    EXTRACTOR,
    FAMILIES,
    MOST_ORDERS,
    ORDER_FOR_S,
    PROVEN_FOR_S,
    RECORDER_HUNG_S,
    STAND,
    WORKING,
    Continuity,
    PortDevice,
    Proof,
    StationLease,
    StatusWord,
    Verdict,
    Watch,
    blind_word,
    is_mixed,
    why_left_alone,
    why_unproven,
)

LEASE = StationLease(
    "ucr-1", "/dev/ttyUSB0", 19200, "8N1", 1, "ucr", "UCR", "1.0", "stand", (1,), False
)
DEVICE = PortDevice(None, 48128, 17, "1-4", "FT1")
ANSWERED_AT = 100.0
HOURS = {1: (1200, 60.0)}
PROOF = Proof("ucr-1", DEVICE, ANSWERED_AT, {1: WORKING}, HOURS)
DIED_AT = 105.0
SILENT = "it last answered 31 s ago, more than 30 s"
OTHER_DEVICE = "its port is not known to be the same device as before"


@pytest.mark.parametrize(
    ("proof", "device", "after_s", "why"),
    [
        (PROOF, DEVICE, 0.0, None),
        (PROOF, DEVICE, PROVEN_FOR_S, None),
        (PROOF, DEVICE, PROVEN_FOR_S + 1.0, SILENT),
        (None, DEVICE, 0.0, "the run had not proven which station it is"),
        (PROOF, None, 0.0, OTHER_DEVICE),
        (PROOF, replace(DEVICE, number=48129), 0.0, OTHER_DEVICE),
        (PROOF, replace(DEVICE, changed_ns=18), 0.0, OTHER_DEVICE),
        (PROOF, replace(DEVICE, usb="1-5"), 0.0, OTHER_DEVICE),
        (PROOF, replace(DEVICE, serial="FT2"), 0.0, OTHER_DEVICE),
        (PROOF, PortDevice(server="terminal:4001"), 0.0, OTHER_DEVICE),
    ],
)
def test_a_station_is_proven_for_a_while_on_the_same_device(
    proof: Proof | None, device: PortDevice | None, after_s: float, why: str | None
) -> None:
    assert why_unproven(proof, device, ANSWERED_AT + after_s) == why


def known() -> Continuity:
    continuity = Continuity()
    continuity.proofs["ucr-1"] = PROOF
    continuity.died_at = DIED_AT
    return continuity


def test_it_is_ordered_three_times_and_never_again() -> None:
    continuity = known()
    for _ in range(MOST_ORDERS):
        assert continuity.has_orders_left("ucr-1", DIED_AT)
        assert continuity.why_not(LEASE, DEVICE, DIED_AT) is None
        continuity.orders["ucr-1"] += 1
    assert not continuity.has_orders_left("ucr-1", DIED_AT)
    assert continuity.why_not(LEASE, DEVICE, DIED_AT) == "it was ordered 3 times"


def test_it_is_ordered_within_ten_seconds_of_the_death() -> None:
    continuity = known()
    assert continuity.why_not(LEASE, DEVICE, DIED_AT + ORDER_FOR_S) is None
    late = DIED_AT + ORDER_FOR_S + 0.1
    assert continuity.why_not(LEASE, DEVICE, late) == "the recorder ended more than 10 s ago"
    assert not continuity.has_orders_left("ucr-1", late)


def test_another_station_ends_the_orders() -> None:
    continuity = known()
    continuity.others["ucr-1"] = "a JTSE, not the UCR"
    why = continuity.why_not(LEASE, DEVICE, DIED_AT)
    assert why == "on /dev/ttyUSB0 there is now a JTSE, not the UCR"
    assert not continuity.has_orders_left("ucr-1", DIED_AT)


@pytest.mark.parametrize(
    ("families", "elsewhere", "mixed"),
    [
        (["ucr"], [], False),
        (["ucr", "ale", "nae", "soldering"], ["dme"], False),
        (["jtse"], ["jtse"], False),
        (["ucr", "omega"], [], False),  # it does not understand a frame of the others
        (["ucr", "jtse"], [], True),
        (["ucr"], ["jtse"], True),
        (["jtse"], ["soldering"], True),
        (["ucr", "auto"], [], True),
        (["ucr"], ["of a later version"], True),
        (None, [], True),
        (["ucr"], None, True),
    ],
)
def test_what_is_not_known_counts_as_a_mixed_line(
    families: list[str] | None, elsewhere: list[str] | None, mixed: bool
) -> None:
    assert is_mixed(families, elsewhere) is mixed


@pytest.mark.parametrize("family", [name for name in FAMILIES if name not in ("jtse", "omega")])
def test_soldering_is_ordered_to_stand_and_on_a_mixed_line_to_its_extractor(family: str) -> None:
    assert blind_word(FAMILIES[family], suction=False, mixed=False) == STAND
    mixed = blind_word(FAMILIES[family], suction=False, mixed=True)
    assert mixed == (None if family == "soldering" else EXTRACTOR)


def test_hot_air_cools_and_keeps_its_part_except_on_a_mixed_line() -> None:
    jtse = FAMILIES["jtse"]
    assert blind_word(jtse, suction=False, mixed=False) == (0, 0, 0, 1, 0)
    assert blind_word(jtse, suction=True, mixed=False) == (0, 0, 1, 1, 0)
    assert blind_word(jtse, suction=True, mixed=True) == (0, 0, 0, 1, 0)


def test_an_omega_has_no_order() -> None:
    assert blind_word(FAMILIES["omega"], suction=False, mixed=False) is None


@pytest.mark.parametrize(
    ("family", "status", "is_ordered"),
    [
        ("ucr", None, True),
        ("ucr", WORKING, True),
        ("ucr", STAND, False),
        ("ucr", (0, 0, 0, 0, 2), False),
        ("ucr", (0, 0, 0, 0, 3), False),
        ("ucr", EXTRACTOR, False),
        ("jtse", None, True),
        ("jtse", (0, 0, 0, 0, 1), True),
        ("jtse", (0, 0, 0, 1, 0), False),
        ("jtse", (0, 0, 0, 0, 0), False),
    ],
)
def test_a_tool_that_rests_is_left_alone(
    family: str, status: StatusWord | None, is_ordered: bool
) -> None:
    assert (why_left_alone(FAMILIES[family], status) is None) is is_ordered


@pytest.mark.parametrize(
    ("statuses", "may_rest"),
    [
        ({1: WORKING}, False),
        ({1: None}, False),
        ({}, False),
        ({1: STAND}, True),
        ({2: STAND}, False),
    ],
)
def test_a_station_where_a_leased_tool_rested_is_read_before_it_is_ordered(
    statuses: dict[int, StatusWord | None], may_rest: bool
) -> None:
    continuity = known()
    continuity.proofs["ucr-1"] = replace(PROOF, statuses=statuses)
    assert continuity.may_rest(LEASE) is may_rest


def test_each_tool_has_its_own_number_of_orders() -> None:
    continuity = known()
    for port in (1, 2, 1):
        continuity.note_order("ucr-1", port, STAND)
    assert continuity.ordered == {("ucr-1", 1): (STAND, 2), ("ucr-1", 2): (STAND, 1)}


# -- the recorder's lines --------------------------------------------------------------------------


def heard(watch: Watch, kind: str, facts: object, now: float = 0.0) -> None:
    assert not watch.hear(f"{kind} {json.dumps(facts)}\n".encode(), now)


def test_the_recorders_lines_arrive_as_they_were_sent() -> None:
    watch = Watch(0.0)
    heard(watch, "families", ["jtse", "ucr"])
    heard(watch, "proof", asdict(PROOF))
    assert watch.continuity.families == ("jtse", "ucr")
    assert watch.continuity.proofs == {"ucr-1": PROOF}
    heard(watch, "answered", {"ucr-1": 111.5, "unknown": 7.0})
    assert watch.continuity.proofs == {"ucr-1": replace(PROOF, answered_at=111.5)}
    heard(watch, "doubted", "ucr-1")
    assert watch.continuity.proofs == {}
    # another station was there: its model and software alone must not prove it
    assert watch.continuity.hours == {"ucr-1": HOURS}


@pytest.mark.parametrize("line", ["proof", "proof {}", "answered 7", "families {", "doubted"])
def test_a_line_that_makes_no_sense_proves_nothing_and_breaks_nothing(line: str) -> None:
    watch = Watch(0.0)
    assert not watch.hear(f"{line}\n".encode(), 0.0)
    assert watch.continuity.proofs == {}


def test_such_lines_are_no_sign_of_life() -> None:
    watch = Watch(0.0)
    assert watch.hear(f"{LEASE.to_json()}\n".encode(), 0.0)
    heard(watch, "answered", {"ucr-1": 1.0}, now=RECORDER_HUNG_S)
    assert watch.verdict(RECORDER_HUNG_S + 0.1, closed=False) is Verdict.HUNG
