"""Starts and short runs on stations that somebody else wrote from the manuals (`outside_bench`), on
bad links and beside faulty stations.

Differences from `line/test_starts.py`: a late answer keeps the station busy, so later questions are
also answered late; stations store a setting for up to 0.3 s; and each has habits of its own where
the manuals are silent.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from support.campaigns.awaited import HOW_OFTEN, NOT_STARTED
from support.command import jbclog
from support.oracles.outside_bench import FAMILIES, KINDS, Cable, Habits, Served, cable, line_file
from support.oracles.outside_runs import AIR, TIP, Outcome, eight, virtual, wrong_values
from support.oracles.sane import assert_memory_is_bounded
from support.product import COLUMN, VirtualClock, open_run

FOUR = ("dde", "nae", "hde", "jtse")
HEATS = re.compile(r"W(ST\d|S\d\d|PS\d000[^0]0|PS\d00000|SF1|SE1|WM1|A\d\d)")
"""Writes of step three on stations for soldering."""


def ordered(one: Cable) -> list[str]:
    """Return writes that the station received, whether it carried them out or not."""
    return [f"W{write.code}{write.data}" for write in one.written]


def is_hot(one: Cable) -> bool:
    """Whether it was left in a state that keeps heating."""
    if one.station.family == "jtse":
        return one.station.read("PS1", one.rows[-1].at)[-2:] == "01"  # type: ignore[index]  # it is known
    return any(
        port.tool and port.units == 0 and not port.extractor for port in one.station.ports.values()
    )


def silent_from(one: Cable, question: str) -> None:
    """Make the station silent from that question on."""
    fallen: list[bool] = []

    def is_silent(text: str) -> bool:
        if text.startswith(question):
            fallen.append(True)
        return bool(fallen)

    one.is_silent_to = is_silent


def assert_true(outcome: Outcome, number: object) -> None:
    assert list(wrong_values(outcome)) == [], number
    assert [name for name, one in outcome.cables.items() if is_hot(one)] == [], number


# -- bad links -------------------------------------------------------------------------------------


def test_the_bench_is_sound() -> None:
    """On good links everything starts, is recorded as sent, and rests at the end."""
    outcome = virtual(eight(0, 0.0))
    assert outcome.not_started == {}
    assert_true(outcome, 0)
    rows = [row for row in outcome.memory.settings if row.outcome == "confirmed"]
    assert {row.station for row in rows} == set(FAMILIES)
    assert len(outcome.memory.samples) > 100


def test_a_false_value_is_found() -> None:
    """The bench would notice one cell that its station never sent."""
    outcome = virtual({"dde": cable("dde", 1)})
    outcome.memory.samples[3][8] = 999
    outcome.cables["dde"].station.ports[1].selected = 345
    found = list(wrong_values(outcome))
    assert len(found) == 2
    assert "00345" in found[0]
    assert "999" in found[1]


def test_a_station_that_is_busy_for_a_moment_starts() -> None:
    """3 s before one answer, at each place of the start in turn; questions asked meanwhile are
    answered later.
    """
    for number in (3, 14, 25, 40, 60, 75):
        one = cable("dde", 7)
        one.script = {number: "late"}
        one.rng.uniform = lambda _low, _high: 3.0  # type: ignore[method-assign]  # later than any
        outcome = virtual({"dde": one})
        assert outcome.not_started == {}, number
        assert_true(outcome, number)
        assert one.faults == {}


# in 141 a station is late again before its line has settled, in 142 a lost order came after a slow
# answer, and other tools had none
@pytest.mark.parametrize("number", [0, 1, 141, 142])
def test_no_start_is_refused_at_one_percent_of_each(number: int) -> None:
    outcome = virtual(eight(number, 0.01))
    assert outcome.not_started == {}
    assert_true(outcome, number)


@pytest.mark.parametrize("number", range(3))
def test_no_value_is_wrong_at_five_percent_of_each(number: int) -> None:
    outcome = virtual(eight(number, 0.05, FOUR))
    assert_true(outcome, number)
    for reason in outcome.not_started.values():
        assert HOW_OFTEN.search(reason) or NOT_STARTED in reason, reason


@pytest.mark.parametrize("number", [1013, 1044, 1079])
def test_no_lost_frame_leaves_a_tool_hot(number: int) -> None:
    assert_true(virtual(eight(number, 0.05)), number)


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(20))
def test_two_hundred_starts_at_one_percent_of_each(
    block: int, counted: Callable[..., None]
) -> None:
    for number in range(100 + 10 * block, 110 + 10 * block):
        outcome = virtual(eight(number, 0.01))
        assert outcome.not_started == {}, number
        assert_true(outcome, number)
        assert_memory_is_bounded()
        counted(**tally(outcome))


@pytest.mark.campaign
@pytest.mark.parametrize("block", range(10))
def test_a_hundred_starts_at_five_percent_of_each(block: int, counted: Callable[..., None]) -> None:
    for number in range(1000 + 10 * block, 1010 + 10 * block):
        outcome = virtual(eight(number, 0.05))
        assert_true(outcome, number)
        for reason in outcome.not_started.values():
            assert HOW_OFTEN.search(reason) or NOT_STARTED in reason, reason
        counted(**{f"at_5_percent_{name}": count for name, count in tally(outcome).items()})


def tally(outcome: Outcome) -> dict[str, int]:
    struck = [sum(one.faults.values()) for one in outcome.cables.values()]
    asked = sum(row.what == "asked" for one in outcome.cables.values() for row in one.rows)
    refused = sum(NOT_STARTED not in reason for reason in outcome.not_started.values())
    told = {
        "starts": 1,
        "stations": len(outcome.cables),
        "frames": asked,
        "disturbed": sum(struck),
        "refused": refused,
    }
    return told | {"rows": len(outcome.memory.samples), "wrong_values": 0}


@pytest.mark.campaign
@pytest.mark.parametrize("number", range(5))
def test_starts_by_the_command_line_on_real_ports(
    number: int, tmp_path: Path, counted: Callable[..., None]
) -> None:
    """The same at 1 % of each, through pseudo-terminals and the shipped command."""
    cables = eight(number, 0.01)
    (tmp_path / "tip.toml").write_text(TIP)
    (tmp_path / "air.toml").write_text(AIR)
    with Served(cables, tmp_path) as served:
        recipes = {name: f'recipe = "{"air" if name == "jtse" else "tip"}.toml"' for name in cables}
        (tmp_path / "line.toml").write_text(
            line_file(served.urls, {name: name for name in cables}, more=recipes)
        )
        run = jbclog(
            "run", "--line", tmp_path / "line.toml", "--out", tmp_path / "runs", "--duration", "2s"
        )
    assert run.returncode == 0, run.stderr
    recorded = open_run(run.stdout.split()[-1])
    settings = recorded.settings()
    confirmed = settings[settings["outcome"] == "confirmed"]
    assert set(confirmed["station"]) == set(cables)
    assert [name for name, one in cables.items() if is_hot(one)] == []
    counted(
        on_real_ports_starts=1,
        on_real_ports_frames=sum(
            row.what == "asked" for one in cables.values() for row in one.rows
        ),
    )


@pytest.mark.parametrize(
    ("for_s", "family"), [(0.6, "nae"), (1.0, "dde"), (1.5, "hde"), (1.0, "jtse"), (60.0, "dde")]
)
def test_one_that_is_late_as_the_run_ends_gets_its_chance(for_s: float, family: str) -> None:
    """The run waits a few seconds for it, finds it again, and counts its outage; one that stays
    silent is gone.
    """
    begun_at = virtual({family: cable(family, 1)}, duration_s=5.0).memory.samples[0][COLUMN["time"]]
    one = cable(family, 1)
    one.silent_from = (
        int(str(begun_at)) / 1e6 - (VirtualClock().utc() - VirtualClock().monotonic()) + 4.7
    )
    one.silent_until = one.silent_from + for_s
    facts = virtual({family: one}, duration_s=5.0).contexts[family].facts
    assert facts.outages == 1
    if for_s > 10:
        assert facts.outcome == "gone"
        away = re.search(
            r"not reachable for the last (\d+\.\d) s; waited 3 s after the end of the run",
            facts.reason,
        )
        assert away is not None, facts.reason
        assert 3.3 < float(away[1]) < 8.0
    else:
        assert (facts.outcome, facts.unsafe) == ("completed", [])
        assert set(facts.safe_state.values()) == {"verified"}


def test_every_kind_of_accident_happens() -> None:
    cables = eight(5, 0.05)
    virtual(cables)
    assert set().union(*(one.faults for one in cables.values())) == set(KINDS)


def test_a_name_that_comes_from_elsewhere_refuses_with_the_address_it_came_from() -> None:
    one = cable("hde", 3)
    one.script = dict.fromkeys(range(200), "other address")
    one.rng.choice = lambda _of: 20  # type: ignore[method-assign]  # always the same neighbour
    one.rng.random = lambda: 0.9  # type: ignore[method-assign]  # and never the station itself
    (why,) = virtual({"hde": one}).not_started.values()
    assert "from address 20, not 01" in why
    assert "no answer to it" not in why


def test_a_software_that_is_never_answered_is_a_warning_and_not_an_unknown_command() -> None:
    one = cable("dde", 1)
    one.is_silent_to = lambda text: text == "RSVR"
    outcome = virtual({"dde": one})
    facts = outcome.contexts["dde"].facts
    assert (facts.outcome, facts.software, facts.not_supported.count("software_version")) == (
        "completed",
        None,
        0,
    )
    assert [event.severity for event in outcome.memory.of_kind("identity.not_known")] == ["warning"]


# -- one of several does not start -----------------------------------------------------------------

BAD = {
    "silent in step one": (lambda one: silent_from(one, "RHA1"), 1),
    "silent from the first question": (lambda one: silent_from(one, "R"), 1),
    "refuses in step two": (
        lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WH12")),
        2,
    ),
    "silent in step two": (lambda one: silent_from(one, "WHA1"), 2),
    "refuses in step three": (
        lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WST1")),
        3,
    ),
    "refuses to work": (
        lambda one: setattr(one, "refuses", lambda text: 3 * text.startswith("WPS100000")),
        3,
    ),
    "silent in step three": (lambda one: silent_from(one, "WST1"), 3),
}


@pytest.mark.parametrize("how", BAD)
def test_what_is_written_where_when_one_fails(how: str) -> None:
    spoil, step = BAD[how]
    cables = eight(0, 0.0, FOUR)
    bad = cables["hde"]
    spoil(bad)
    outcome = virtual(cables)
    assert set(outcome.not_started) == set(FOUR)
    assert outcome.memory.samples == []
    orders = {name: ordered(one) for name, one in cables.items()}
    if step == 1:
        assert [one for name in FOUR for one in orders[name]] == []
    if step == 2:
        assert [one for name in FOUR for one in orders[name] if HEATS.match(one)] == []
        assert "WD1200004" in orders["dde"]
        # named, and not rolled back
        assert "sleep delay of port 1 4 min (was 5 min)" in outcome.not_started["hde"]
        rested = [name for name in FOUR if name != "hde" or "silent" not in how]
        # they are cold
        assert [one for name in rested for one in orders[name] if one.startswith("WPS")] == []
    if step == 3:
        assert [
            one.station.name
            for name, one in cables.items()
            if is_hot(one) and (name != "hde" or "silent" not in how)
        ] == []
    others = {outcome.contexts[name].facts.outcome for name in FOUR if name != "hde"}
    assert others == {"not_started"}
    assert all("hde" in outcome.not_started[name] for name in FOUR)


@pytest.mark.parametrize("name", ["dde", "nae", "hde"])
def test_one_at_work_is_told_to_rest_where_step_two_fails(name: str) -> None:
    cables = eight(0, 0.0, FOUR)
    spoil, _ = BAD["refuses in step two"]
    spoil(cables["hde"])
    cables[name].station.write("PS1", "00000", 0.0)
    outcome = virtual(cables)
    assert set(outcome.not_started) == set(FOUR)
    told = [(one, text) for one in FOUR for text in ordered(cables[one]) if text.startswith("WPS")]
    assert told == [(name, "WPS100001")]
    assert [one for one, cable_ in cables.items() if is_hot(cable_)] == []


@pytest.mark.parametrize("how", BAD)
def test_a_silent_station_delays_the_others_by_ten_seconds_at_the_most(how: str) -> None:
    spoil, _ = BAD[how]
    alone = virtual(eight(0, 0.0, ("dde", "nae", "jtse")), duration_s=0.5)
    cables = eight(0, 0.0, FOUR)
    spoil(cables["hde"])
    outcome = virtual(cables, duration_s=0.5, allow_missing=True)
    assert set(outcome.not_started) == {"hde"}
    assert outcome.contexts["hde"].facts.outcome == "left_out"
    assert begun(outcome) - begun(alone) < 10.5
    assert_true(outcome, how) if "silent" not in how else None
    assert {row[2] for row in outcome.memory.samples} == {"dde", "nae", "jtse"}


def begun(outcome: Outcome) -> float:
    return min(one.taken("PS")[0].at for one in outcome.cables.values() if one.taken("PS"))


# -- safe states, and stations of another family ---------------------------------------------------


def statuses(one: Cable, port: int = 1) -> list[tuple[str, int]]:
    return [(write.data, write.error) for write in one.written if write.code == f"PS{port}"]


@pytest.mark.parametrize("family", ["dde", "nae", "dme", "hde"])
def test_extractor_is_believed_where_the_tool_cools_and_else_stand_follows_in_time(
    family: str,
) -> None:
    cools, stubborn, refuses = (
        cable(family, 1),
        cable(family, 2, habits=Habits(extractor_cools=False)),
        cable(family, 3),
    )
    refuses.refuses = lambda text: 3 * (text.startswith("WPS") and text.endswith("00010"))
    recipe = TIP.replace('"soldering", ', "").replace("[run]", '[run]\nsafe_state = "extractor"')
    virtual(
        {"cools": cools, "stubborn": stubborn, "refuses": refuses}, duration_s=6.0, recipe=recipe
    )
    for port in cools.station.ports:
        assert statuses(cools, port) == [("00000", 0), ("00010", 0)]
        assert statuses(stubborn, port) == [("00000", 0), ("00010", 0), ("00001", 0)]
        assert statuses(refuses, port) == [("00000", 0), ("00010", 3), ("00001", 0)]
    orders = [
        write.at
        for write in stubborn.written
        if write.code.startswith("PS") and write.data != "00000"
    ]
    assert orders[-1] - orders[0] < 3.0


@pytest.mark.parametrize(
    ("refused", "told"),
    [
        ((), ["00101", "00110"]),
        (("00110",), ["00101", "00110", "00010"]),
        (("00110", "00010"), ["00101", "00110", "00010", "00000"]),
    ],
)
def test_hot_air_keeps_its_suction_where_the_station_lets_it(
    refused: tuple[str, ...], told: list[str]
) -> None:
    one = cable("jtse", 1)
    one.station.write("PS1", "00100", 0.0)
    one.refuses = lambda text: (
        3 * text.endswith(tuple(f"WPS1{word}" for word in refused)) if refused else 0
    )
    outcome = virtual({"jtse": one})
    assert [word for word, _ in statuses(one)] == told
    assert outcome.contexts["jtse"].facts.safe_state == {1: "verified"}


@pytest.mark.parametrize("name", ["DIE", "DDE"])
def test_hot_air_by_a_soldering_station_s_name_is_never_told_a_status(name: str) -> None:
    keys = 'ports = [1]\nmodel = "DIE"' if name == "DIE" else "ports = [1]"
    one = cable("jtse", 1, name=name)
    one.station.family = "dde"  # as its line file says
    outcome = virtual({"dde": one}, keys=keys)
    assert set(outcome.not_started) == {"dde"}
    assert statuses(one) == []
