"""Making tools safe: nothing is written to a stranger, no station takes longer than it may, nothing is heated by it."""

from __future__ import annotations

import pytest
from making_safe import ASKED_AT, Cable, Silent, station, task

from jbclog.commands.status import EXTRACTOR, STAND, StatusWord
from jbclog.effects import Ask, Heard, Listen, Steps, Wait
from jbclog.errors import AnswerTimeout, LinkError
from jbclog.safety.in_time import in_time
from jbclog.safety.secure import ALLOWED_S, FAILED, SENT, VERIFIED, Task, secure
from jbclog.sim.state import WORKING
from jbclog.sim.virtual import VirtualStation


def written(device: VirtualStation) -> list[object]:
    return [write.value for write in device.log.written("status") if write.at >= ASKED_AT]


# -- whoever is at the other end ---------------------------------------------------------------------------------------


def test_each_tool_is_told_and_read_back() -> None:
    device, made = station(), task(1, 2)
    Cable(device).pull(secure(made))
    assert written(device) == [STAND, STAND]
    assert [(tool.reached, tool.status) for tool in made.tools] == [(VERIFIED, STAND)] * 2


@pytest.mark.parametrize("at", ["WPS1", "RPS1", "WPS2"])
def test_nothing_is_written_to_whoever_is_there_when_the_cable_was_out(at: str) -> None:
    ours, stranger, made = station(), station("nae"), task(1, 2)

    def pulled(question: str) -> None:
        if question.startswith(at):
            cable.end, cable.is_out = stranger, True

    def plugged_in() -> None:
        cable.is_out = False

    cable = Cable(ours, before=pulled, opens=plugged_in)
    cable.pull(secure(made))
    assert [write.name for write in stranger.log.writes if write.at >= ASKED_AT] == []
    assert not made.is_proven
    assert made.tools[1].reached == FAILED


def test_nothing_is_written_to_whoever_is_there_when_a_silent_stations_port_did_not_open() -> None:
    """It was only silent so far; that its port has gone was first seen in opening it again."""
    stranger, made, silent = station("nae"), task(1, 2), Silent()

    def opened() -> None:
        cable.is_out = cable.end is silent
        cable.end = stranger

    cable = Cable(silent, opens=opened)
    cable.pull(secure(made))
    assert [write.name for write in stranger.log.writes if write.at >= ASKED_AT] == []
    assert not made.is_proven


def test_the_one_that_is_meant_is_told_when_its_cable_is_back() -> None:
    device, made = station(), task(1, 2)
    told: list[str] = []

    def pulled(question: str) -> None:
        told.append(question)
        cable.is_out |= len(told) == 2

    def plugged_in() -> None:
        cable.is_out = cable.now < ASKED_AT + 1.0

    cable = Cable(device, before=pulled, opens=plugged_in)
    cable.pull(secure(made))
    assert [tool.reached for tool in made.tools] == [VERIFIED, VERIFIED]
    assert "RSMN" in told


# -- in time ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ports", [(1,), (1, 2), (1, 2, 3, 4)], ids=len)
@pytest.mark.parametrize("feeds", [False, True], ids=["", "feeding"])
def test_a_silent_station_is_told_all_and_takes_no_longer_than_three_seconds(ports: tuple[int, ...], feeds: bool) -> None:
    silent, made = Silent(), task(*ports, family="ale" if feeds else "dme", feeds=feeds)
    cable = Cable(silent)
    cable.pull(secure(made))
    assert cable.now - ASKED_AT <= ALLOWED_S + 1e-9
    told = {question[:4]: at - ASKED_AT for question, at in silent.questions.items() if question[0] == "W"}
    assert told.keys() == {*(f"WPS{port}" for port in ports), *(["WSTP"] if feeds else [])}
    assert max(told.values()) < (2.4 if feeds else 1.8)  # one order is waited for as long as a station may need for it
    assert {tool.reached for tool in made.tools} <= {FAILED, SENT}


def test_a_port_that_does_not_open_takes_no_longer() -> None:
    made = task(1, 2)
    cable = Cable(Silent(), is_out=True)
    cable.pull(secure(made))
    assert cable.now - ASKED_AT <= ALLOWED_S + 1e-9
    assert [tool.reached for tool in made.tools] == [FAILED, FAILED]


def test_what_is_over_neither_waits_nor_asks() -> None:
    given: list[object] = []

    def steps() -> Steps[str]:
        for wish in (Ask(b"?", 5.0), Listen(20.0), Wait(30.0)):
            given.append((yield wish))
        try:
            yield Ask(b"more", 1.0)
        except AnswerTimeout as error:
            return str(error)
        return "asked"

    pulled = in_time(steps(), 10.0, 12.0)
    assert next(pulled) == Ask(b"?", 2.0)
    assert pulled.send(Heard(11.0, b"", 10.0)) == Listen(12.0)
    assert pulled.send(Heard(11.5, b"", 10.0)) == Wait(12.0)
    with pytest.raises(StopIteration, match="no time is left to ask"):
        pulled.send(Heard(12.0, b"", 10.0))
    assert len(given) == 3


def test_what_a_driver_throws_reaches_the_steps_and_what_they_raise_comes_out() -> None:
    def steps() -> Steps[None]:
        try:
            yield Wait(1.0)
        except LinkError:
            raise AnswerTimeout("seen") from None

    pulled = in_time(steps(), 0.0, 2.0)
    next(pulled)
    with pytest.raises(AnswerTimeout, match="seen"):
        pulled.throw(LinkError("gone"))


# -- nothing is heated ---------------------------------------------------------------------------------------------------------


def in_extractor(family: str, seconds: float, *ports: int) -> VirtualStation:
    device = station(family, ports)
    for number in ports:
        device.plant.ports[number].order(WORKING, True)
    device.advance_to(ASKED_AT + seconds)
    return device


@pytest.mark.parametrize("family", ["dde", "nae", "dme", "ucr"])
@pytest.mark.parametrize("seconds", [5.0, 3600.0], ids=["cooling", "cold"])
def test_a_tool_in_its_extractor_state_that_cools_or_is_cold_is_left_alone(family: str, seconds: float) -> None:
    device, made = in_extractor(family, seconds, 1), task(1, family=family, spare=True)
    Cable(device, now=ASKED_AT + seconds).pull(secure(made))
    assert written(device) == []
    assert (made.tools[0].reached, made.tools[0].was_spared) == (VERIFIED, True)
    assert is_extractor(made.tools[0].status)


def test_four_cold_ones_are_seen_within_a_second() -> None:
    device, made = in_extractor("dme", 3600.0, 1, 2, 3, 4), task(1, 2, 3, 4, family="dme", spare=True)
    cable = Cable(device, now=ASKED_AT + 3600.0)
    cable.pull(secure(made))
    assert (written(device), made.is_done) == ([], True)
    assert cable.now - ASKED_AT - 3600.0 < 1.0


def test_of_four_hot_ones_those_for_which_there_is_no_time_to_look_are_told_to_stand() -> None:
    device, made = in_extractor("dme", 5.0, 1, 2, 3, 4), task(1, 2, 3, 4, family="dme", spare=True)
    Cable(device, now=ASKED_AT + 5.0).pull(secure(made))
    assert made.is_done
    assert [tool.was_spared for tool in made.tools] == [True, False, False, False]


def test_one_that_is_held_hot_in_it_is_told_to_stand() -> None:
    device, made = station("dde", (1,), "extractor_cools = false"), task(1, spare=True)
    device.plant.ports[1].order(WORKING, True)
    device.advance_to(ASKED_AT + 60)
    Cable(device, now=ASKED_AT + 60).pull(secure(made))
    assert written(device) == [STAND]


def test_where_nothing_is_to_be_spared_it_is_told() -> None:
    device, made = in_extractor("dde", 3600.0, 1), task(1)
    Cable(device, now=ASKED_AT + 3600.0).pull(secure(made))
    assert written(device) == [STAND]


def is_extractor(status: StatusWord | None) -> bool:
    return status is not None and status[3] == EXTRACTOR[3]


# -- what a file from elsewhere asks for -----------------------------------------------------------------------------------


def test_hot_air_is_not_switched_on_by_one_either() -> None:
    made = task(1, family="jtse")
    assert Task(made.client, made.family, "on", made.tools, made.feeds, made.prove).wanted == "cooling"


@pytest.mark.parametrize("family", ["dde", "ucr"])
@pytest.mark.parametrize("wanted", ["working", "on", "", "../x"])
def test_a_state_that_is_not_safe_is_never_ordered(family: str, wanted: str) -> None:
    """A lease is a file in a folder of runs: whoever puts one there must not heat a tool with it."""
    device, made = station(family, tools=(1,)), task(1, family=family)
    given = Task(made.client, made.family, wanted, made.tools, made.feeds, made.prove)
    Cable(device).pull(secure(given))
    safe = {made.family.status.orders[name] for name in (*made.family.safe_states, *made.family.status.last_resorts)}
    assert written(device)
    assert set(written(device)) <= safe
