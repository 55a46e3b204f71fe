"""The virtual OMEGA: what it answers, when, and what it meets with silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.config.line import parse_line
from jbclog.core.errors import UsageError
from jbclog.protocol.commands.omega import ConditionRecord
from jbclog.sim.omega import SLOWEST_S, WARM_UP_S, seconds_of, usual
from jbclog.sim.setup import virtual_station
from jbclog.sim.virtual import VirtualOmega, VirtualStation
from support.clients.omega_talk import framed

LINE = (
    '[line]\nname = "t"\n[[station]]\nname = "omega-1"\nurl = "x"\nfamily ='
    ' "{family}"\n[station.sim]\n{sim}\n'
)
ON = 1000.0
WARM = ON + WARM_UP_S + 1
BYTE_S = 10 / 9600


def station(sim: str = "turnaround_ms = 50\njoints_per_minute = 0") -> VirtualOmega:
    made = virtual_station(
        parse_line(LINE.format(family="omega", sim=sim), Path("line.toml")).stations[0], now=ON
    )
    assert isinstance(made, VirtualOmega)
    return made


def said(omega: VirtualOmega, text: str, now: float = WARM) -> list[str]:
    """The texts of everything that comes of a question."""
    return [reply.data[1:-3].decode() for reply in omega.receive(framed(text), now)]


def test_a_line_file_decides_what_is_virtual() -> None:
    spec = parse_line(LINE.format(family="dde", sim=""), Path("line.toml")).stations[0]
    assert isinstance(virtual_station(spec, now=ON), VirtualStation)


@pytest.mark.parametrize(("text", "answer"), [("A", "a0"), ("B", "b0"), ("F", "f0"), ("G", "g4")])
def test_what_it_tells(text: str, answer: str) -> None:
    omega = station()
    (reply,) = omega.receive(framed(text), WARM)
    assert reply.data == framed(answer)
    assert reply.at == pytest.approx(WARM + (5 + 6) * BYTE_S + 0.05)


def test_it_prepares_after_it_was_switched_on() -> None:
    omega = station()
    assert (said(omega, "B", ON + 1), said(omega, "F", ON + 1)) == (["b1"], ["f1"])
    assert (said(omega, "B"), said(omega, "F")) == (["b0"], ["f0"])


def test_it_answers_within_a_quarter_of_a_second_and_never_at_the_same_moment() -> None:
    """003, 11.1: 0 to 250 ms."""
    omega = station("")
    delays = []
    for number in range(200):
        (reply,) = omega.receive(framed("A"), WARM + number)
        delays.append(reply.at - WARM - number - 11 * BYTE_S)
    assert 0 <= min(delays) < 0.03
    assert SLOWEST_S - 0.03 < max(delays) <= SLOWEST_S + 1e-9
    assert len(set(delays)) == 200


@pytest.mark.parametrize(
    "text",
    ["E", "K12C", "A1", "a", "C0064", "C006", "C00C8", "H0000", "H0064", "D00656" + "000" * 15],
)
def test_what_it_does_not_know_is_met_with_silence(text: str) -> None:
    omega = station()
    assert said(omega, text) == []
    assert [one.text for one in omega.log.refused] == [text]
    assert omega.log.writes == []


def test_a_wrong_sum_is_met_with_silence() -> None:
    """003, 11.2: "the command is treated as unauthorized data, is ignored and deleted"."""
    omega = station()
    assert omega.receive(b"\x02A\x0342", WARM) == []
    assert said(omega, "A") == ["a0"]


def test_a_condition_is_told_and_stored() -> None:
    omega = station()
    (told,) = said(omega, "C0065")
    assert told[:6] == "c00650"
    assert len(told) == 51
    other = "00651" + "00A" * 15
    assert said(omega, "D" + other) == ["d"]
    assert said(omega, "C0065") == ["c" + other]
    assert omega.log.writes[-1].value == ConditionRecord(101, 1, *[1.0] * 15)


def test_a_speed_above_its_own_is_out_of_range() -> None:
    omega = station()
    assert said(omega, "D" + "00650" + "000" * 2 + "FFF" + "000" * 12) == []
    assert said(omega, "C0065") != []


def test_the_cleaning_is_a_short_record() -> None:
    assert said(station(), "C0000") == ["c0000005"]


@pytest.mark.parametrize(("number", "letter"), [(101, "h"), (201, "i"), (301, "h")])
def test_a_joint_is_told_of_when_it_is_made(number: int, letter: str) -> None:
    """h when a point is done, i after a slide's first stage; questions are answered meanwhile."""
    omega = station()
    (late,) = omega.receive(framed(f"H{number:04X}"), WARM)
    assert late.data == framed(letter)
    takes = seconds_of(usual(number), first_stage=letter == "i")
    assert late.at == pytest.approx(WARM + takes + (9 + 5) * BYTE_S)
    (between,) = omega.receive(framed("A"), WARM + 0.1)
    assert between.at < late.at
    assert [one.value for one in omega.log.writes] == [number]


def test_a_joint_takes_the_temperature_out_of_its_range() -> None:
    omega = station()
    omega.receive(framed("H0065"), WARM)
    takes = seconds_of(usual(101))
    assert [said(omega, "F", WARM + part * takes) for part in (0.2, 0.8, 1.1)] == [
        ["f0"],
        ["f1"],
        ["f0"],
    ]


@pytest.mark.parametrize(
    ("kinds", "text", "answer"),
    [
        (["solder_shortage"], "A", "a1"),
        (["clog"], "A", "a2"),
        (["solder_shortage", "clog"], "A", "a3"),
        (["not_ready"], "B", "b1"),
        (["out_of_range"], "F", "f1"),
    ],
)
def test_faults_of_its_own(kinds: list[str], text: str, answer: str) -> None:
    faults = "".join(
        f'\n[[station.sim.fault]]\nkind = "{kind}"\nat_s = 5\nfor_s = 5\n' for kind in kinds
    )
    omega = station("joints_per_minute = 0" + faults)
    usual_answer = said(omega, text)
    assert said(omega, text, WARM + 6) == [answer]
    assert said(omega, text, WARM + 11) == usual_answer != [answer]


def test_a_restart_loses_nothing_that_is_stored_and_prepares_again() -> None:
    omega = station(
        'joints_per_minute = 0\n[[station.sim.fault]]\nkind = "restart"\nat_s = 5\nfor_s = 3'
    )
    said(omega, "D" + "00651" + "00A" * 15)
    assert said(omega, "A", WARM + 6) == []
    assert said(omega, "B", WARM + 9) == ["b1"]
    assert said(omega, "C0065", WARM + 9) == ["c00651" + "00A" * 15]


@pytest.mark.parametrize(
    ("sim", "wrong"),
    [
        ("counters = { plugged_hours = 5 }", "counters: plugged_hours"),
        ('quirks = ["addresses_swapped"]', "quirks: addresses_swapped"),
        ('[[station.sim.fault]]\nkind = "overheat"', "fault overheat"),
        ('[[station.sim.fault]]\nkind = "silence"\ncommand = "power"', "fault silence: power"),
        ('[[station.sim.fault]]\nkind = "silence"\nport = 2', "fault silence: port 2"),
        ('settings = { condition_101 = "0065" }', "condition_101"),
        (
            'settings = { condition_102 = "0000005" }',
            "condition_102 is nothing that an omega can begin with",
        ),
    ],
)
def test_what_it_does_not_have_is_said(sim: str, wrong: str) -> None:
    with pytest.raises(UsageError, match=wrong):
        station(sim)


def test_a_station_of_jbc_has_no_faults_of_an_omega() -> None:
    text = LINE.format(family="dde", sim='[[station.sim.fault]]\nkind = "clog"')
    with pytest.raises(UsageError, match="fault clog"):
        virtual_station(parse_line(text, Path("line.toml")).stations[0], now=ON)
