"""What drifted: from the audit before, and from the fleet where it agrees."""

from __future__ import annotations

import pytest

from jbclog.maintenance.fleet_of_ledger import drifts
from support.fleets.counters import look


def test_an_odd_one_out_is_told_with_how_many_have_what() -> None:
    looks = {
        f"s{number}": [look(f"s{number}", parameters={"1.sleep_delay_min": "5"})]
        for number in range(8)
    }
    looks["s8"] = [look("s8", parameters={"1.sleep_delay_min": "9"}, software="0203457")]
    found = drifts(looks)
    assert [one.text for one in found["s8"]] == [
        "0203457, 8 of 8 others have 0203456",
        "9, 8 of 8 others have 5",
    ]
    assert all(found[f"s{number}"] == () for number in range(8))


@pytest.mark.parametrize("values", ["55599", "5599", "59", "123456", "9"])
def test_a_fleet_that_does_not_agree_has_no_odd_one(values: str) -> None:
    looks = {
        f"s{at}": [look(f"s{at}", parameters={"1.adjust_c": value})]
        for at, value in enumerate(values)
    }
    assert not any(drifts(looks).values())


def test_only_what_is_alike_is_compared() -> None:
    looks = {
        f"s{at}": [look(f"s{at}", parameters={"1.adjust_c": "0"}, tool_names={1: "T245"})]
        for at in range(5)
    }
    looks["desolder"] = [look("desolder", parameters={"1.adjust_c": "9"}, tool_names={1: "DR560"})]
    looks["other"] = [look("other", model="DME", software="1")]
    assert not any(drifts(looks).values())


def test_what_changed_since_the_audit_before_is_told_once() -> None:
    seen = [
        look(days_ago=days, parameters={"2.adjust_c": value})
        for days, value in ((20, "0"), (10, "4"), (0, "4"))
    ]
    assert [one.text for one in drifts({"a": seen[:2]})["a"]] == ["4, was 0 at the last audit"]
    assert drifts({"a": seen}) == {"a": ()}


def test_a_station_that_was_never_seen_drifts_from_nothing() -> None:
    assert drifts({"a": [], "b": [look("b")]}) == {"b": ()}


def test_a_port_of_thousands_of_digits_is_no_port() -> None:
    """Of a ledger that is not ours: Python converts no number of so many."""
    odd = look(parameters={f"{'9' * 5000}.sleep_delay_min": "5"})
    assert drifts({"a": [odd]}) == {"a": ()}


def test_another_tool_is_no_drift() -> None:
    seen = [
        look(days_ago=9, parameters={"1.adjust_c": "0"}, tool_names={1: "T245"}),
        look(parameters={"1.adjust_c": "3"}, tool_names={1: "T210"}),
    ]
    assert drifts({"a": seen}) == {"a": ()}
