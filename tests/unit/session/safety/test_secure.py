"""Making tools safe: nothing is written to a stranger, no station takes longer than it may, nothing
is heated by it.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from support.campaigns.each_row import each_row
from support.clients.making_safe import ASKED_AT, Cable, FloodedCable, Silent, station, task
from support.clients.talk import framed
from support.golden.form import with_check_byte
from support.product import (
    EXTRACTOR,
    SECURE_ALLOWED_S,
    SIM_SLEEP,
    SIM_WORKING,
    STAND,
    AirModel,
    AnswerTimeout,
    Ask,
    HeatReading,
    IoResult,
    LinkError,
    Listen,
    SafetyResult,
    SafetyTask,
    SimPort,
    StatusWord,
    TimeBudget,
    VirtualStation,
    Wait,
    do,
    heat_falls,
    in_time,
    patch,
    pull,
    secure,
    send,
    throw,
    tool_is_cold,
)


def written(device: VirtualStation) -> list[object]:
    return [write.value for write in device.log.written("status") if write.at >= ASKED_AT]


# -- whoever is at the other end -------------------------------------------------------------------


def test_each_tool_is_told_and_read_back() -> None:
    device, made = station(), task(1, 2)
    Cable(device).pull(secure(made))
    assert written(device) == [STAND, STAND]
    assert [(tool.reached, tool.status) for tool in made.tools] == [
        (SafetyResult.VERIFIED, STAND)
    ] * 2


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
    assert [tool.is_safe for tool in made.tools] == [False, False]


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
    assert [tool.reached for tool in made.tools] == [SafetyResult.VERIFIED, SafetyResult.VERIFIED]
    assert "RSMN" in told


# -- in time ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("ports", [(1,), (1, 2), (1, 2, 3, 4)], ids=len)
@pytest.mark.parametrize("feeds", [False, True], ids=["", "feeding"])
def test_a_silent_station_is_told_all_and_takes_no_longer_than_three_seconds(
    ports: tuple[int, ...], feeds: bool
) -> None:
    silent, made = Silent(), task(*ports, family="ale" if feeds else "dme", feeds=feeds)
    cable = Cable(silent)
    cable.pull(secure(made))
    assert cable.now - ASKED_AT <= 3.0 + 1e-9
    told = {
        question[:4]: at - ASKED_AT
        for question, at in silent.questions.items()
        if question[0] == "W"
    }
    assert told.keys() == {*(f"WPS{port}" for port in ports), *(["WSTP"] if feeds else [])}
    # one order is waited for as long as a station may need for it
    assert max(told.values()) < (2.4 if feeds else 1.8)
    assert {tool.reached for tool in made.tools} <= {SafetyResult.FAILED, SafetyResult.SENT}


def test_a_port_that_does_not_open_takes_no_longer() -> None:
    made = task(1, 2)
    cable = Cable(Silent(), is_out=True)
    cable.pull(secure(made))
    assert cable.now - ASKED_AT <= SECURE_ALLOWED_S + 1e-9
    assert [tool.reached for tool in made.tools] == [SafetyResult.FAILED, SafetyResult.FAILED]


@pytest.mark.parametrize("feeds", [False, True], ids=["", "feeding"])
def test_a_port_that_takes_long_to_open_leaves_the_time_to_identify_and_order(feeds: bool) -> None:
    """As one behind an rfc2217 server: half of the time was over, a share of it was for the first
    order, and nothing was left of that to ask who is there.
    """
    family = "ale" if feeds else "dme"
    device, made = station(family, (1,)), task(1, family=family, feeds=feeds, is_proven=False)

    def opening() -> None:
        cable.now += 1.6

    cable = Cable(device, opens=opening)
    cable.pull(secure(made))
    assert (made.is_done, cable.now - ASKED_AT <= SECURE_ALLOWED_S) == (True, True)
    assert written(device) == [STAND]


@pytest.mark.parametrize(
    ("took_s", "rounds", "parts", "answers", "until"),
    [
        (None, 0, 4, 1, 100.75),  # no answer yet: its share of three seconds alone
        (None, 0, 30, 1, 100.3),  # and that is never too short to ask again
        (0.01, 0, 4, 1, 100.2),  # one answer of a quick station, and of three
        (0.01, 0, 4, 3, 100.6),
        (0.01, 1, 4, 1, 100.4),  # each round is twice as patient, up to the share
        (0.01, 2, 4, 1, 100.75),
        (0.1, 0, 4, 1, 100.4),  # four times as long as the quickest answer took
        (0.1, 0, 1, 30, 103.0),  # all that is left
    ],
)
def test_a_step_has_its_share_or_what_its_answers_take(
    took_s: float | None, rounds: int, parts: int, answers: int, until: float
) -> None:
    client = SimpleNamespace(now=100.0, sent=99.0, heard=98.0)  # its last request: no answer
    budget = TimeBudget(client, end=103.0, rounds=rounds)  # type: ignore[arg-type]  # its times alone
    budget.note_answer()
    for seconds in () if took_s is None else (took_s, 0.5):  # a slower one makes none more patient
        client.heard = client.sent + seconds
        budget.note_answer()
    assert budget.share_ends(budget.end, parts, answers) == pytest.approx(until)


def test_what_is_over_neither_waits_nor_asks() -> None:
    given: list[object] = []

    async def steps() -> str:
        for request in (Ask(b"?", 5.0), Listen(20.0), Wait(30.0)):
            given.append(await do(request))
        try:
            await do(Ask(b"more", 1.0))
        except AnswerTimeout as error:
            return str(error)
        return "asked"

    pulled = in_time(steps(), 10.0, 12.0)
    assert pull(pulled) == Ask(b"?", 2.0)
    assert send(pulled, IoResult(11.0, b"", 10.0)) == Listen(12.0)
    assert send(pulled, IoResult(11.5, b"", 10.0)) == Wait(12.0)
    with pytest.raises(StopIteration, match="no time is left to ask"):
        send(pulled, IoResult(12.0, b"", 10.0))
    assert len(given) == 3


def test_what_a_driver_throws_reaches_the_steps_and_what_they_raise_comes_out() -> None:
    async def steps() -> None:
        try:
            await do(Wait(1.0))
        except LinkError:
            raise AnswerTimeout("seen") from None

    pulled = in_time(steps(), 0.0, 2.0)
    pull(pulled)
    with pytest.raises(AnswerTimeout, match="seen"):
        throw(pulled, LinkError("gone"))


@pytest.mark.parametrize("ports", [(1,), (1, 2, 3, 4)], ids=len)
def test_what_blocks_an_order_for_a_while_is_waited_for(ports: tuple[int, ...]) -> None:
    """Somebody switches Robot mode on after more than a second: the tries are spread over the time
    that there is.
    """
    device, made = station("dme", ports), task(*ports, family="dme")

    class Blocked(Lossy):
        def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            if b"WPS" in data and now < ASKED_AT + 1.2:
                return [(now + 0.01, framed("N00005"))]
            return super().receive(data, now)

    cable = Cable(Blocked(device, lambda: False))
    cable.pull(secure(made))
    assert (made.is_done, cable.now - ASKED_AT <= SECURE_ALLOWED_S) == (True, True)
    assert {write.port for write in device.log.written("status") if write.at >= ASKED_AT} == set(
        ports
    )
    # it was refused at first, and is what was to be all the same
    assert {tool.fell_back for tool in made.tools} == {""}


def test_of_a_silent_station_only_one_tool_is_looked_at_before_all_are_ordered() -> None:
    silent, made = Silent(), task(1, 2, 3, 4, family="dme", spare=True)
    asked: list[tuple[str, float]] = []
    cable = Cable(silent, before=lambda text: asked.append((text, cable.now - ASKED_AT)))
    cable.pull(secure(made))
    first = next(at for text, at in asked if text.startswith("WPS"))
    assert {text for text, at in asked if at < first and text.startswith("RPS")} == {"RPS1"}
    assert {text for text, at in asked if text.startswith("WPS") and at < 1.8} == {
        f"WPS{port}00001" for port in (1, 2, 3, 4)
    }


# -- nothing is heated -----------------------------------------------------------------------------


def in_extractor(family: str, seconds: float, *ports: int) -> VirtualStation:
    device = station(family, ports)
    for number in ports:
        device.plant.ports[number].order(SIM_WORKING, True)
    device.advance_to(ASKED_AT + seconds)
    return device


@pytest.mark.parametrize("family", ["dde", "nae", "dme", "ucr"])
@pytest.mark.parametrize("seconds", [5.0, 3600.0], ids=["cooling", "cold"])
def test_a_tool_in_its_extractor_state_that_cools_or_is_cold_is_left_alone(
    family: str, seconds: float
) -> None:
    device, made = in_extractor(family, seconds, 1), task(1, family=family, spare=True)
    Cable(device, now=ASKED_AT + seconds).pull(secure(made))
    assert written(device) == []
    assert (made.tools[0].reached, made.tools[0].was_spared) == (SafetyResult.VERIFIED, True)
    assert is_extractor(made.tools[0].status)


@pytest.mark.parametrize(
    ("celsius", "permille", "is_cold"),
    [
        ((40, 41), (0, 0), True),
        ((60, 60), (20, 20), True),
        ((40, 61), (0, 0), False),
        ((61, 40), (0, 0), False),
        ((40, 41), (0, 21), False),
        ((40, 41), (), False),  # nobody knows what its heater gets
        ((), (0, 0), False),
        ((), (), False),
    ],
)
def test_a_tool_is_cold_where_both_answers_of_both_readings_say_so(
    celsius: tuple[int, ...],
    permille: tuple[int, ...],
    is_cold: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def read(*_: object) -> object:
        return HeatReading(celsius, permille)

    patch(monkeypatch, "cooling._heat", read)
    with pytest.raises(StopIteration) as end:
        pull(tool_is_cold(None, None))  # type: ignore[arg-type]  # what they are is read by `_heat` alone
    assert end.value.value is is_cold


def test_four_cold_ones_are_seen_within_a_second() -> None:
    device, made = (
        in_extractor("dme", 3600.0, 1, 2, 3, 4),
        task(1, 2, 3, 4, family="dme", spare=True),
    )
    cable = Cable(device, now=ASKED_AT + 3600.0)
    cable.pull(secure(made))
    assert (written(device), made.is_done) == ([], True)
    assert cable.now - ASKED_AT - 3600.0 < 1.0


def test_four_hot_ones_that_cool_are_watched_together_and_left_alone() -> None:
    device, made = in_extractor("dme", 5.0, 1, 2, 3, 4), task(1, 2, 3, 4, family="dme", spare=True)
    Cable(device, now=ASKED_AT + 5.0).pull(secure(made))
    assert (made.is_done, written(device)) == (True, [])
    assert [tool.was_spared for tool in made.tools] == [True] * 4


def test_of_four_of_which_one_is_held_hot_that_one_is_told_to_stand() -> None:
    device, made = in_extractor("dme", 5.0, 1, 2, 3, 4), task(1, 2, 3, 4, family="dme", spare=True)
    held_hot(device, 3)
    Cable(device, now=ASKED_AT + 5.0).pull(secure(made))
    assert made.is_done
    assert [
        (write.port, write.value) for write in device.log.written("status") if write.at >= ASKED_AT
    ] == [(3, STAND)]


def held_hot(device: VirtualStation, *ports: int) -> None:
    """These ports heat in their extractor state as at work."""
    for number in ports:
        device.plant.ports[number].character.extractor_cools = False
        device.plant.ports[number].changed()


def test_one_that_is_held_hot_in_it_is_told_to_stand() -> None:
    device, made = station("dde", (1,), "extractor_cools = false"), task(1, spare=True)
    device.plant.ports[1].order(SIM_WORKING, True)
    device.advance_to(ASKED_AT + 60)
    Cable(device, now=ASKED_AT + 60).pull(secure(made))
    assert written(device) == [STAND]


def test_one_that_works_is_told_to_stand_although_its_heater_rests_for_a_moment() -> None:
    """Its heater may be off because the tip is above its setting; by power alone it would pass for
    one that cools.
    """
    device, made = station("dde", (1,)), task(1, spare=True)
    Cable(Drawing(device, permille=0)).pull(secure(made))
    assert written(device) == [STAND]
    assert (made.tools[0].reached, made.tools[0].was_spared) == (SafetyResult.VERIFIED, False)


def test_where_nothing_is_to_be_spared_it_is_told() -> None:
    device, made = in_extractor("dde", 3600.0, 1), task(1)
    Cable(device, now=ASKED_AT + 3600.0).pull(secure(made))
    assert written(device) == [STAND]


@pytest.mark.parametrize("family", ["dde", "ucr"])
def test_what_was_told_is_not_taken_for_what_rested_already(family: str) -> None:
    """The record would say that nobody made it safe."""
    device, made = station(family, (1,)), task(1, family=family, spare=True)
    asked: list[str] = []

    class Mute(Lossy):
        """It answers none of the questions from the first order on, for some time."""

        def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            replies = super().receive(data, now)
            return (
                []
                if now < ASKED_AT + 1.5 and any(text.startswith("WPS") for text in asked)
                else replies
            )

    cable = Cable(Mute(device, lambda: False), before=asked.append)
    cable.pull(secure(made))
    assert (made.tools[0].reached, made.tools[0].was_spared) == (SafetyResult.VERIFIED, False)
    assert set(written(device)) == {STAND}


def is_extractor(status: StatusWord | None) -> bool:
    return status is not None and status[3] == EXTRACTOR[3]


# -- the extractor state as the safe state ---------------------------------------------------------

BENCH_FAMILIES = ["dde", "nae", "dme", "hde"]
FOUR = (1, 2, 3, 4)


def put_in_extractor(
    device: VirtualStation, *ports: int, family: str = "dme", **cable: Any
) -> tuple[SafetyTask, float]:
    """The task when it is over, and how long it took."""
    made = task(*ports, family=family, wanted="extractor")
    pulled = Cable(device, **cable)
    pulled.pull(secure(made))
    return made, pulled.now - ASKED_AT


def told_words(device: VirtualStation, port: int) -> list[object]:
    return [
        one.value for one in device.log.written("status") if one.port == port and one.at >= ASKED_AT
    ]


@pytest.mark.parametrize("family", BENCH_FAMILIES)
def test_a_tool_that_cools_in_its_extractor_state_stays_there(family: str) -> None:
    device = station(family, (1, 2))
    made, _ = put_in_extractor(device, 1, 2, family=family)
    assert [told_words(device, port) for port in (1, 2)] == [[EXTRACTOR]] * 2
    assert [(tool.reached, tool.fell_back) for tool in made.tools] == [
        (SafetyResult.VERIFIED, "")
    ] * 2


@pytest.mark.parametrize("turnaround_ms", [1, 10, 50])
@pytest.mark.parametrize("hot", [(1,), (2, 4), FOUR], ids=len)
def test_each_of_four_that_is_read_back_and_heats_on_is_told_to_stand_within_three_seconds(
    turnaround_ms: int, hot: tuple[int, ...]
) -> None:
    device = station("dme", FOUR, f"turnaround_ms = {turnaround_ms}")
    device.advance_to(ASKED_AT)
    held_hot(device, *hot)
    made, seconds = put_in_extractor(device, *FOUR)
    assert (made.is_done, seconds <= SECURE_ALLOWED_S) == (True, True)
    for port in hot:
        assert told_words(device, port) == [EXTRACTOR, STAND]
    if turnaround_ms < 50:  # then there is time to see that the others cool
        assert [told_words(device, port) for port in FOUR if port not in hot] == [[EXTRACTOR]] * (
            4 - len(hot)
        )
        assert {tool.fell_back for tool in made.tools if tool.port in hot} == {
            "extractor was read back, but the tool did not cool"
        }


def test_all_four_are_ordered_before_any_is_watched() -> None:
    asked: list[str] = []
    put_in_extractor(station("dme", FOUR), *FOUR, before=asked.append)
    last_order = max(place for place, text in enumerate(asked) if text.startswith("WPS"))
    assert last_order < min(
        place for place, text in enumerate(asked) if text.startswith(("RTT", "RPP"))
    )


def test_where_it_is_refused_stand_follows_at_once_and_is_told() -> None:
    device = station("dme", FOUR, 'quirks = ["extractor_refused"]')
    made, seconds = put_in_extractor(device, *FOUR)
    assert [told_words(device, port) for port in FOUR] == [[STAND]] * 4
    assert {tool.fell_back for tool in made.tools} == {"extractor was refused with N 00003"}
    assert (made.is_done, seconds < 1.0) == (True, True)


def test_where_it_is_acknowledged_and_ignored_stand_follows_at_once_and_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device, order = station("dme", FOUR), SimPort.order

    def ignore(port: SimPort, state: int, extractor: bool) -> None:
        if not extractor:
            order(port, state, extractor)

    patch(monkeypatch, "SimPort.order", ignore)
    made, seconds = put_in_extractor(device, *FOUR)
    assert [told_words(device, port)[-1] for port in FOUR] == [STAND] * 4
    assert {tool.fell_back for tool in made.tools} == {
        "extractor was acknowledged, but working was read back"
    }
    assert (made.is_done, seconds < 1.0) == (True, True)


@pytest.mark.parametrize(
    ("before", "after", "cools"),
    [
        (((300, 301), (0, 0)), ((298, 298), (200, 200)), True),
        # by one degree only, in one of the pairs
        (((300, 301), (0, 0)), ((299, 298), (200, 200)), False),
        (((300, 301), (0, 0)), ((298, 298), (200, 201)), False),
        (((300, 301), (0, 0)), ((298, 298), ()), False),  # what its heater gets was not read
        (((300, 301), ()), ((300, 300), (20, 20)), True),  # off
        (((300, 301), ()), ((300, 300), (20, 21)), False),
        (((), ()), ((298, 298), (200, 200)), False),
        (((), ()), ((), ()), False),
    ],
)
def test_a_tool_cools_where_all_answers_say_so(
    before: tuple[tuple[int, ...], ...], after: tuple[tuple[int, ...], ...], cools: bool
) -> None:
    assert heat_falls(HeatReading(*before), HeatReading(*after)) is cools


def test_a_falling_tip_whose_heater_works_against_it_does_not_cool() -> None:
    """It is at a joint: its temperature alone would pass for a proof."""
    device = station("dde", (1,), "extractor_cools = false\njoints_per_minute = 0")
    port = device.plant.ports[1]
    port.tip.temperature_c = 420.0  # and falls to its setting
    port.runaway_by_c = None
    falling = Cable(Drawing(device, permille=700))
    made = task(1, wanted="extractor")
    falling.pull(secure(made))
    assert told_words(device, 1) == [EXTRACTOR, STAND]


class Other:
    """A station that says some things otherwise; by itself it says what `device` says."""

    def __init__(self, device: VirtualStation) -> None:
        self._device = device

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        return [(reply[0], reply[1]) for reply in self._device.receive(data, now)]

    def is_unplugged(self, now: float) -> bool:
        return self._device.is_unplugged(now)


class Drawing(Other):
    """A station that tells another power than its own."""

    def __init__(self, device: VirtualStation, permille: int) -> None:
        super().__init__(device)
        self._data = f"{permille:05d}".encode()

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        replies = super().receive(data, now)
        return [(at, self._told(answer)) for at, answer in replies] if b"RPP" in data else replies

    def _told(self, answer: bytes) -> bytes:
        return with_check_byte(answer[:9] + self._data + answer[14:15])


@pytest.mark.parametrize("only", ["read", "write"])
def test_a_tool_whose_answers_are_lost_is_told_to_stand_all_the_same(only: str) -> None:
    """Nobody can see that it cools, or that the order was taken."""
    device = station("dme", FOUR, f"[[station.sim.fault]]\nkind = 'silence'\nonly = '{only}'")
    made, seconds = put_in_extractor(device, *FOUR)
    assert seconds <= SECURE_ALLOWED_S + 1e-9
    if only == "read":
        assert {told_words(device, port)[-1] for port in FOUR} == {STAND}
    else:  # an acknowledgement is not needed where it is read back, and watched
        assert {tool.reached for tool in made.tools} == {SafetyResult.VERIFIED}


@each_row((f"{share} {seed}", (share, seed)) for share in (0.05, 0.25) for seed in range(40))
def test_whatever_is_lost_no_tool_that_heats_on_counts_as_safe(share: float, seed: int) -> None:
    device, random = station("dme", FOUR), Random(seed)
    held_hot(device, *FOUR)
    made = task(*FOUR, family="dme", wanted="extractor")
    asked: list[str] = []
    lossy = Cable(Lossy(device, lambda: random.random() < share), before=asked.append)
    lossy.pull(secure(made))
    assert lossy.now - ASKED_AT <= SECURE_ALLOWED_S + 1e-9
    for tool in made.tools:
        orders = [text for text in asked if text.startswith(f"WPS{tool.port}")]
        # and once told to stand it is never told to extract again
        assert orders[-1] == f"WPS{tool.port}00001"
        assert sorted(orders, reverse=True) == orders
        if tool.is_safe or share < 0.1:
            assert told_words(device, tool.port)[-1] == STAND


def test_where_a_twentieth_is_lost_nearly_all_is_proven_in_time() -> None:
    proven = 0
    for seed in range(40):
        device, random, made = station("dme", FOUR), Random(seed), task(*FOUR, family="dme")
        lossy = Cable(Lossy(device, lambda random=random: random.random() < 0.05))  # type: ignore[misc]
        lossy.pull(secure(made))
        proven += made.is_done
    assert proven >= 39


@pytest.mark.parametrize("lost", [("WPS2", "WPS3"), ("WPS1", "RPS1"), ("RPS1", "RPS3", "WPS4")])
def test_after_a_slow_answer_what_is_lost_keeps_no_tool_hot(lost: tuple[str, ...]) -> None:
    """The client waits four times as long as the slowest recent answer took: two lost ones took all
    of the time, and the last tools had no order at all.
    """
    device, made = station("dme", FOUR), task(*FOUR, family="dme")
    held_hot(device, *FOUR)
    made.client.turnaround_s = 0.4  # type: ignore[attr-defined]  # of a station's client
    left = [code.encode() for code in lost]

    class LosesEach(Lossy):
        def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            hit = next((code for code in left if code in data), None)
            if hit is not None:
                left.remove(hit)
                return []
            return super().receive(data, now)

    cable = Cable(LosesEach(device, lambda: False))
    cable.pull(secure(made))
    assert made.is_done
    assert cable.now - ASKED_AT <= SECURE_ALLOWED_S + 1e-9
    assert {told_words(device, port)[-1] for port in FOUR} == {STAND}


def test_what_was_not_acknowledged_is_ordered_again_at_last() -> None:
    """Its reads are never answered; of the orders to a tool the first four are lost."""
    device, made = station("dme", (1, 2)), task(1, 2, family="dme")
    held_hot(device, 1, 2)
    lost: list[bytes] = []

    class LosesFour(Lossy):
        def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            if b"RPS" in data or (b"WPS2" in data and len(lost) < 4):
                lost.extend([data] * (b"W" in data))
                return []
            return super().receive(data, now)

    Cable(LosesFour(device, lambda: False)).pull(secure(made))
    assert [told_words(device, port)[-1:] for port in (1, 2)] == [[STAND], [STAND]]
    assert {tool.reached for tool in made.tools} == {SafetyResult.SENT}


class Lossy(Other):
    """A line on which what is asked, or what is answered, is lost now and then."""

    def __init__(self, device: VirtualStation, is_lost: Callable[[], bool]) -> None:
        super().__init__(device)
        self._is_lost = is_lost

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        if self._is_lost():
            return []
        replies = super().receive(data, now)
        return [] if self._is_lost() else replies


def test_one_order_that_is_lost_on_its_way_is_given_again_before_another_state_is() -> None:
    device = station("dde", (1,))
    lost: list[bytes] = []

    class LosesOne(Lossy):
        def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
            if b"WPS" in data and not lost:
                lost.append(data)
                return []
            return super().receive(data, now)

    made = task(1, wanted="extractor")
    Cable(LosesOne(device, lambda: False)).pull(secure(made))
    assert (told_words(device, 1), made.is_done, len(lost)) == ([EXTRACTOR], True, 1)


def test_a_tool_that_is_found_asleep_by_the_reading_back_needs_no_watching() -> None:
    device = station("dde", (1,))
    assert device.plant.ports[1].tool
    status = task(1).family.status
    assert status.is_safe((0, 0, 0, 0, 2), EXTRACTOR)
    assert not task(1).has_to_cool((0, 0, 0, 0, 2))
    assert task(1).has_to_cool(EXTRACTOR)


# -- hot air and its suction -----------------------------------------------------------------------

COOL, COOL_AND_HOLD, ALL_OFF = (0, 0, 0, 1, 0), (0, 0, 1, 1, 0), (0, 0, 0, 0, 0)


def hot_air() -> VirtualStation:
    """One that is on and holds a part."""
    device = station("jtse", (1,))
    assert isinstance(device.device.face, AirModel)
    device.device.face.station.suck(on=True)
    return device


@pytest.mark.parametrize(
    ("suction", "spare", "ordered"),
    [
        (True, False, COOL_AND_HOLD),
        (False, False, COOL),
        (None, False, COOL),
        (None, True, COOL_AND_HOLD),
        (False, True, COOL),
    ],
)
def test_suction_is_kept_where_it_is_known_to_be_on(
    suction: bool | None, spare: bool, ordered: StatusWord
) -> None:
    """Unknown counts as off, unless a look that is taken anyhow has told it."""
    device, made = hot_air(), task(1, family="jtse", wanted="cooling", suction=suction, spare=spare)
    Cable(device).pull(secure(made))
    assert (told_words(device, 1), made.is_done) == ([ordered], True)


def test_a_silent_station_is_told_the_plain_words_too_within_the_time() -> None:
    silent, made = Silent(), task(1, family="jtse", wanted="cooling", suction=True)
    asked: list[str] = []
    cable = Cable(silent, before=asked.append)
    cable.pull(secure(made))
    orders = list(dict.fromkeys(text for text in asked if text.startswith("WPS")))
    assert orders == ["WPS100110", "WPS100010", "WPS100000"]
    # the part is not let go at the first loss
    assert [text for text in asked if text.startswith("WPS")].count("WPS100110") >= 2
    assert cable.now - ASKED_AT <= SECURE_ALLOWED_S + 1e-9


# -- what a file from elsewhere asks for -----------------------------------------------------------


def test_hot_air_is_not_switched_on_by_one_either() -> None:
    made = task(1, family="jtse")
    assert (
        SafetyTask(made.client, made.family, "on", made.tools, made.feeds, made.prove).wanted
        == "cooling"
    )


@pytest.mark.parametrize("family", ["dde", "ucr"])
@pytest.mark.parametrize("wanted", ["working", "on", "", "../x"])
def test_a_state_that_is_not_safe_is_never_ordered(family: str, wanted: str) -> None:
    """A lease is a file in a folder of runs: whoever puts one there must not heat a tool by it."""
    device, made = station(family, tools=(1,)), task(1, family=family)
    given = SafetyTask(made.client, made.family, wanted, made.tools, made.feeds, made.prove)
    Cable(device).pull(secure(given))
    safe = {
        made.family.status.orders[name]
        for name in (*made.family.safe_states, *made.family.status.last_resorts)
    }
    assert written(device)
    assert set(written(device)) <= safe


# -- a flooded link --------------------------------------------------------------------------------


SAFE, OTHER, OURS = framed("APS100001"), framed("ASMNNAE"), framed("ASMNDDE")


@pytest.mark.parametrize("frame", [SAFE, OTHER, OURS, b"\xaa"])
@pytest.mark.parametrize("is_proven", [True, False])
@pytest.mark.parametrize("spare", [True, False])
def test_on_a_flooded_link_each_tool_is_told_and_none_is_verified(
    frame: bytes, is_proven: bool, spare: bool
) -> None:
    """Whatever the copies say: that it is safe, or that it is another station."""
    device, made = station(), task(1, 2, is_proven=is_proven, spare=spare)
    cable = FloodedCable(device, frame)
    cable.pull(secure(made))
    assert set(map(str, written(device))) == {str(STAND)}
    assert {write.port for write in device.log.written("status") if write.at >= ASKED_AT} == {1, 2}
    assert [tool.reached for tool in made.tools] == [SafetyResult.SENT, SafetyResult.SENT]
    assert made.flood is not None
    assert cable.now - ASKED_AT < SECURE_ALLOWED_S + 1.5


@pytest.mark.parametrize("is_proven", [True, False])
@pytest.mark.parametrize(
    ("wanted", "suction", "ordered"),
    [
        ("cooling", False, COOL),
        ("cooling", True, COOL_AND_HOLD),
        ("off", False, ALL_OFF),
        ("off", True, (0, 0, 1, 0, 0)),
    ],
)
def test_on_a_flooded_link_hot_air_ends_in_the_wanted_state_and_keeps_its_part(
    wanted: str, suction: bool, ordered: StatusWord, is_proven: bool
) -> None:
    """The heater is off in both. Until the flood is recognized, the fallbacks of a silent station
    may go out.
    """
    device = hot_air()
    made = task(1, family="jtse", wanted=wanted, suction=suction, is_proven=is_proven)
    FloodedCable(device, b"\xaa").pull(secure(made))
    told = told_words(device, 1)
    assert told[-1] == ordered
    if suction or not is_proven:
        assert {*told} == {ordered}
    assert made.tools[0].reached == SafetyResult.SENT


def test_on_a_flooded_link_hot_air_does_not_get_what_it_refused_before() -> None:
    device, made = hot_air(), task(1, family="jtse", wanted="cooling")
    made.tools[0].pass_over(COOL, "cooling was refused with N 00005")
    FloodedCable(device, b"\xaa").pull(secure(made))
    assert {*told_words(device, 1)} == {ALL_OFF}


@pytest.mark.parametrize("wanted", ["stand", "extractor"])
def test_on_a_flooded_link_soldering_stands_because_extract_would_have_to_be_seen(
    wanted: str,
) -> None:
    device, made = station(), task(1, 2, wanted=wanted, is_proven=False)
    FloodedCable(device, b"\xaa").pull(secure(made))
    assert {*written(device)} == {STAND}


def test_a_stranger_that_was_found_before_the_flood_is_told_nothing() -> None:
    stranger, made = station("nae"), task(1, 2, is_proven=False)
    made.is_stranger = True
    FloodedCable(stranger, b"\xaa").pull(secure(made))
    assert written(stranger) == []
    assert [tool.reached for tool in made.tools] == [SafetyResult.FAILED, SafetyResult.FAILED]


@pytest.mark.parametrize("seconds", [0.8, 1.2, 2.2])
def test_a_flood_that_ends_in_time_is_followed_by_a_proof(seconds: float) -> None:
    device, made = station(), task(1, 2)
    FloodedCable(device, b"\xaa", seconds).pull(secure(made))
    assert [tool.reached for tool in made.tools] == [SafetyResult.VERIFIED, SafetyResult.VERIFIED]


def test_what_is_not_handed_over_is_not_sent() -> None:
    device, made = station(), task(1, 2)
    made.client.flow.is_flooded = True
    cable = FloodedCable(device, b"\xaa", is_out=True)
    cable.pull(secure(made))
    assert [tool.reached for tool in made.tools] == [SafetyResult.FAILED, SafetyResult.FAILED]


@pytest.mark.parametrize(("feeds", "stops"), [(True, 1), (False, 0)])
def test_on_a_flooded_link_a_feeder_that_may_run_is_told_to_stop_and_nobody_knows_that_it_did(
    feeds: bool, stops: int
) -> None:
    device, made = station("ale", (1,)), task(1, family="ale", feeds=feeds)
    FloodedCable(device, b"\xaa").pull(secure(made))
    assert min(len(device.log.written("stop_feeding")), 1) == stops
    assert made.feeds == feeds


@pytest.mark.parametrize("is_out", [True, False], ids=["no order goes out", "orders go out"])
@pytest.mark.parametrize("spare", [True, False])
def test_what_was_read_back_before_a_flood_is_not_believed_any_more(
    spare: bool, is_out: bool
) -> None:
    device, made = station(), task(1, 2, spare=spare)
    if spare:
        device.plant.ports[1].order(SIM_SLEEP, False)
        device.plant.ports[2].order(SIM_SLEEP, False)
    cable = FloodedCable(device, b"\xaa")
    cable.begin_at(ASKED_AT + 99.0)
    begun: list[float] = []

    def flood_behind_the_first(question: str) -> None:
        if question.startswith("RPS2") and not begun:
            assert made.tools[0].reached == SafetyResult.VERIFIED
            begun.append(cable.now)
            cable.begin_at(cable.now)
        cable.is_out |= is_out and bool(begun) and question.startswith("WPS")

    cable.before = flood_behind_the_first
    cable.pull(secure(made))
    assert [tool.was_spared for tool in made.tools] == [False, False]
    if is_out:  # what was ordered before it was; what only rested was never ordered
        assert [tool.reached for tool in made.tools] == (
            [SafetyResult.FAILED, SafetyResult.FAILED]
            if spare
            else [SafetyResult.SENT, SafetyResult.SENT]
        )
    else:
        assert [tool.reached for tool in made.tools] == [SafetyResult.SENT, SafetyResult.SENT]
        assert {write.port for write in device.log.written("status") if write.at >= ASKED_AT} == {
            1,
            2,
        }


# -- a feeder --------------------------------------------------------------------------------------


def feeding() -> VirtualStation:
    """A feeder that runs on until it is stopped."""
    device = station("ale", (1,))
    assert device.plant.feeder is not None
    device.plant.feeder.settings.feeder_mode = "continuous"
    device.plant.feeder.start(ASKED_AT)
    return device


def test_a_feeder_that_a_robot_starts_again_is_stopped_again_when_the_tools_are_safe() -> None:
    device, made = feeding(), task(1, family="ale", feeds=True)
    assert device.plant.feeder is not None
    started: list[str] = []

    def start_again(question: str) -> None:
        if question.startswith("RPS1") and not started:
            started.append(question)
            device.plant.feeder.start(cable.now)  # type: ignore[union-attr]  # it has one

    cable = Cable(device, before=start_again)
    cable.pull(secure(made))
    assert len(device.log.written("stop_feeding")) == 2
    assert (made.feeds, made.is_done, device.plant.feeder.motor(cable.now)) == (False, True, 0)


@pytest.mark.parametrize("pulled_at", ["RFEE", "RPS1", "WSTP"])
def test_a_feeder_that_nobody_could_look_at_counts_as_running(pulled_at: str) -> None:
    device, made = feeding(), task(1, family="ale", feeds=True)

    def pull(question: str) -> None:
        cable.is_out |= question.startswith(pulled_at)

    cable = Cable(device, before=pull)
    cable.pull(secure(made))
    assert (made.feeds, made.is_done) == (True, False)


# -- while they are watched ------------------------------------------------------------------------


def test_after_a_cable_that_was_out_the_station_is_identified_before_it_is_ordered() -> None:
    device = station("dde", (1, 2), "extractor_cools = false")
    made, asked = task(1, 2, wanted="extractor"), list[str]()

    def pull(question: str) -> None:
        asked.append(question)
        cable.is_out |= question.startswith("RTT1") and cable.now < ASKED_AT + 0.3

    def plug_in() -> None:
        cable.is_out = cable.now < ASKED_AT + 0.4

    cable = Cable(device, before=pull, opens=plug_in)
    cable.pull(secure(made))
    assert [(tool.reached, tool.status) for tool in made.tools] == [
        (SafetyResult.VERIFIED, STAND)
    ] * 2
    pulled = asked.index("RTT1")
    assert (
        "RSMN"
        in asked[
            pulled : next(
                place for place, text in enumerate(asked) if place > pulled and text[0] == "W"
            )
        ]
    )


def test_a_flood_that_begins_while_a_tool_is_watched_has_it_told_to_stand_without_proof() -> None:
    device, made = station("dde", (1, 2)), task(1, 2, wanted="extractor")
    cable = FloodedCable(device, b"\xaa")
    cable.begin_at(ASKED_AT + 99.0)
    begun: list[float] = []

    def flood(question: str) -> None:
        if question.startswith("RTT1") and not begun:
            begun.append(cable.now)
            cable.begin_at(cable.now)

    cable.before = flood
    cable.pull(secure(made))
    assert made.flood is not None
    assert [told_words(device, port) for port in (1, 2)] != [[EXTRACTOR]] * 2
    assert [told_words(device, port)[-1] for port in (1, 2)] == [STAND, STAND]
    assert [tool.reached for tool in made.tools] == [SafetyResult.SENT, SafetyResult.SENT]


class WithoutPower(Other):
    """A station that does not know the question for the heater's power."""

    def receive(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        replies = super().receive(data, now)
        return [(at, framed("N00004")) for at, _ in replies] if b"RPP" in data else replies


@pytest.mark.parametrize(("heats_on", "words"), [(False, [EXTRACTOR]), (True, [EXTRACTOR, STAND])])
def test_where_a_station_does_not_tell_its_power_a_tip_that_falls_is_proof_enough(
    heats_on: bool, words: list[StatusWord]
) -> None:
    device, made = station("dde", (1,)), task(1, wanted="extractor")
    if heats_on:
        held_hot(device, 1)
    Cable(WithoutPower(device)).pull(secure(made))
    assert (told_words(device, 1), made.is_done) == (words, True)
