"""The stations of a run start together: first they read and check, then they write what cannot
heat, then they heat. A failure in a step stops all.

The stations' side of the serial lines shows what was written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from support.product import (
    SILENT_S,
    STAND,
    WORKING,
    Exit,
    RunEnded,
    StationFacts,
    StationTask,
    Steps,
    VirtualStation,
    Wait,
    do,
    exit_code,
    findings,
    pull,
    send,
    throw,
)
from support.virtual.virtual_run import (
    RECIPE,
    Heard,
    Tap,
    VirtualRun,
    is_cold_in_extractor,
    prepare,
)

NAMES = ("a", "b", "c")
STATION = """
[[station]]
name = "{name}"
url = "{name}"
family = "dde"
ports = [1]
[station.sim]
turnaround_ms = {turnaround_ms}
settings = {{selected_temperature = 300, sleep_delay = 9}}
{sim}
"""
HEATS = ("WST", "WA1", "WS1", "WPS100000")
COOLS = "WPS100001"

Deaf = Callable[[bytes, float], bool]


@dataclass
class Cable:
    """A cable that loses everything, or is pulled, from the first question for which `is_deaf` is
    true.
    """

    tap: Tap
    is_deaf: Deaf
    pulled: bool = False
    since: float | None = field(default=None)

    def is_unplugged(self, now: float) -> bool:
        return self.pulled and self.since is not None

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        if self.since is None and self.is_deaf(data, now):
            self.since = now
        return [] if self.since is not None else self.tap.receive(data, now)


def never(_data: bytes, _now: float) -> bool:
    return False


def line_of(sims: dict[str, str]) -> str:
    """Return a line of three stations with different response times; "b" is the one under test."""
    line = '[line]\nname = "bench"\n'
    for place, name in enumerate(NAMES):
        line += STATION.format(name=name, turnaround_ms=1.0 + 4 * place, sim=sims.get(name, ""))
    return line


def start_with(sim: str, also: str) -> VirtualRun:
    """Return a run that has not begun, with these simulations of "b" and "c"."""
    return prepare(line_of({"b": sim, "c": also}), RECIPE, 2.0, 2.0)


def run_with(
    deaf: Deaf = never,
    sim: str = "",
    *,
    pulled: bool = False,
    allow_missing: bool = False,
    also: str = "",
    duration_s: float = 2.0,
) -> VirtualRun:
    def behind_cable(
        order: StationTask, session: Steps[StationFacts], tap: object
    ) -> tuple[Steps[StationFacts], Cable]:
        return session, Cable(tap, deaf if order.name == "b" else never, pulled)  # type: ignore[arg-type]  # it is a tap

    line = line_of({"b": sim, "c": also})
    return prepare(
        line, RECIPE, duration_s, 2.0, allow_missing=allow_missing, pulled=behind_cable
    ).go()


def nak(command: str, code: int = 3) -> str:
    return (
        f'\n[[station.sim.fault]]\nkind = "nak"\ncode = {code}\ncommand = "{command}"\nonly ='
        ' "write"\n'
    )


SILENT = '\n[[station.sim.fault]]\nkind = "silence"\n'


def writes(run: VirtualRun, name: str) -> list[str]:
    return [one.text for one in run.taps[name].heard if one.is_write]


def heated(run: VirtualRun) -> list[str]:
    """Return every write to any station that can heat."""
    return [text for name in NAMES for text in writes(run, name) if text.startswith(HEATS)]


def outcomes(run: VirtualRun) -> list[str]:
    return [run.contexts[name].facts.outcome for name in NAMES]


def code_of(run: VirtualRun) -> Exit:
    return exit_code(
        findings(
            [context.facts for context in run.contexts.values()],
            verdict=None,
            record=None,
            cut_short=None,
        )
    )


def assert_all_touched_are_safe(run: VirtualRun) -> None:
    for name in NAMES:
        station, facts = run.stations[name], run.contexts[name].facts
        assert isinstance(station, VirtualStation)
        if station.log.writes and not facts.unsafe:
            assert facts.safe_state == {1: "verified"}
            if run.contexts[name].step <= 2:  # it rested, and would be heated to be told to stand
                assert is_cold_in_extractor(station, 1)
                assert station.log.written("status") == []
            else:
                assert station.log.written("status")[-1].value == STAND


def assert_is_not_started(run: VirtualRun, step: int) -> None:
    """The others were ready and name the station at fault; nothing was sampled; the run ends with
    exit code 3, or 5 if a tool of that station is not safe.
    """
    assert run.memory.samples == []
    for name in ("a", "c"):
        facts = run.contexts[name].facts
        assert facts.outcome == "not_started"
        assert "did not start because of b" in facts.reason
    assert outcomes(run)[1] in ("refused", "gone")
    assert [name for name in ("a", "c") if run.contexts[name].facts.unsafe] == []
    assert code_of(run) is (Exit.UNSAFE if run.contexts["b"].facts.unsafe else Exit.STATION)
    assert_all_touched_are_safe(run)
    if step == 1:
        assert [writes(run, name) for name in NAMES] == [[], [], []]
        assert all(context.facts.touched == [] for context in run.contexts.values())
    if step == 2:
        assert heated(run) == []


# -- all is well -----------------------------------------------------------------------------------


def test_a_step_begins_on_no_station_before_all_have_done_the_one_before() -> None:
    run = run_with()
    assert outcomes(run) == ["completed"] * 3
    last_read = max(_first(run, name, "WD1").at for name in NAMES)
    assert max(_first(run, name, "RA12").at for name in NAMES) < min(
        _first(run, name, "WD1").at for name in NAMES
    )
    for name in NAMES:
        cool = [
            one.at
            for one in run.taps[name].heard
            if one.is_write and not one.text.startswith((*HEATS, COOLS))
        ]
        hot = [
            one.at for other in NAMES for one in run.taps[other].heard if one.text.startswith(HEATS)
        ]
        assert max(cool) < min(hot)
        assert last_read < min(hot)


def _first(run: VirtualRun, name: str, start: str) -> Heard:
    return next(one for one in run.taps[name].heard if one.text.startswith(start))


# -- step one --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sim", "words"),
    [
        (SILENT, "no usable answer"),
        ('model = "NAE"', "family dde"),
        ("robot_mode = false", "Robot mode"),
        ("tool = 0", "no tool in port 1"),
        (
            '\n[[station.sim.fault]]\nkind = "nak"\ncode = 99999\ncommand = "alarm_low_limit"\n',
            "cannot read alarm low limit",
        ),
    ],
    ids=["silent", "another model", "no Robot mode", "no tool", "cannot be read"],
)
def test_one_that_fails_in_step_one_leaves_all_untouched(sim: str, words: str) -> None:
    run = run_with(sim=sim)
    assert_is_not_started(run, 1)
    assert words in run.contexts["b"].facts.reason


def test_every_station_that_fails_in_step_one_is_named() -> None:
    run = run_with(sim=SILENT, also="tool = 0")
    assert outcomes(run) == ["not_started", "gone", "refused"]
    assert (
        "because of b, c" in run.contexts["a"].facts.reason
        or "because of c, b" in run.contexts["a"].facts.reason
    )
    found = findings(
        [context.facts for context in run.contexts.values()],
        verdict=None,
        record=None,
        cut_short=None,
    )
    assert {finding.text.partition(":")[0] for finding in found} == {"b", "c"}
    assert [writes(run, name) for name in NAMES] == [[], [], []]


# -- step two --------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["refused", "silent", "pulled"])
def test_one_that_fails_in_step_two_heats_nothing_and_what_was_written_is_named(how: str) -> None:
    def deaf(data: bytes, now: float) -> bool:
        return how != "refused" and b"WHA1" in data

    run = run_with(
        deaf, nak("alarm_high_limit") if how == "refused" else "", pulled=how == "pulled"
    )
    assert_is_not_started(run, 2)
    # it was touched and cannot be reached
    assert bool(run.contexts["b"].facts.unsafe) == (how != "refused")
    assert "step 2 of 3" in run.contexts["b"].facts.reason
    for name in NAMES:
        assert (
            "settings written before that remain: sleep delay of port 1 5 min (was 9 min)"
            in run.contexts[name].facts.reason
        )
        station = run.stations[name]
        assert isinstance(station, VirtualStation)
        assert station.plant.ports[1].tools[2].sleep_delay == 5  # nothing is rolled back
        assert run.contexts[name].facts.touched == [1]


@pytest.mark.parametrize("state", ["extractor", "sleep", "working", "held hot"])
def test_a_tool_that_rests_when_step_two_fails_is_not_told_to_stand(state: str) -> None:
    """A working tool gets the order, and so does one that does not cool in the extractor state."""
    run = start_with(
        nak("alarm_high_limit"), "extractor_cools = false" if state == "held hot" else ""
    )
    word = {
        "extractor": (0, True),
        "held hot": (0, True),
        "sleep": (2, False),
        "working": (0, False),
    }[state]
    for name in NAMES:
        station = run.stations[name]
        assert isinstance(station, VirtualStation)
        station.plant.ports[1].order(*word)
    run.go()
    rests = state in ("extractor", "sleep")
    assert writes(run, "c")[-1].startswith(COOLS) != rests
    assert (COOLS in writes(run, "a")) == (state == "working")
    told = {event.station: event.text for event in run.memory.of_kind("safety.safe_state")}
    assert run.contexts["c"].facts.safe_state == {1: "verified"}
    assert ("is at rest already and is left as it is" in told["c"]) == rests


# -- step three ------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["selected_temperature", "status"])
def test_one_that_fails_in_step_three_puts_all_touched_tools_in_their_safe_state(
    command: str,
) -> None:
    sim = nak(command) + ("for_s = 3\n" if command == "status" else "")
    run = run_with(sim=sim)
    assert_is_not_started(run, 3)
    assert heated(run) != []
    for name in ("a", "c"):
        assert writes(run, name)[-1] == COOLS


def test_in_step_three_nobody_who_heats_waits_for_one_that_is_slow_to_fail() -> None:
    """A tool that is already hot is ordered to stand as soon as any station fails."""
    run = run_with(sim=nak("selected_temperature"))
    failed = next(event.time for event in run.memory.of_kind("station.refused")) / 1e6
    for name in ("a", "c"):
        safe = [one.at for one in run.taps[name].heard if one.text == COOLS]
        assert run.utc_s(safe[0]) < failed + 1.0


# -- silence ---------------------------------------------------------------------------------------


def test_a_station_that_is_silent_delays_the_others_by_ten_seconds_at_the_most() -> None:
    run = hung(allow_missing=False)
    assert outcomes(run) == ["not_started", "gone", "not_started"]
    assert "silent for 10 s in step 1" in run.contexts["b"].facts.reason
    assert "because of b" in run.contexts["a"].facts.reason
    ended = [
        event.time / 1e6 - run.utc_s(run.t0) for event in run.memory.of_kind("station.not_started")
    ]
    assert all(SILENT_S <= at <= SILENT_S + 3 for at in ended)
    assert [writes(run, name) for name in NAMES] == [[], [], []]


def test_a_station_that_is_silent_is_left_out_where_that_is_allowed() -> None:
    run = hung(allow_missing=True)
    assert outcomes(run) == ["completed", "left_out", "completed"]
    began = [_first(run, name, "WD1").at - run.t0 for name in ("a", "c")]
    assert all(SILENT_S <= at <= SILENT_S + 3 for at in began)


def hung(*, allow_missing: bool) -> VirtualRun:
    """Run with one session that is silent for a minute, because its driver hangs while it opens the
    port.
    """

    async def late(session: Steps[StationFacts]) -> StationFacts:
        request = pull(session)
        try:
            await do(Wait(1060.0))
        except RunEnded as end:
            request = throw(session, end)
        while True:
            try:
                heard = await do(request)
            except Exception as error:
                step = error
                try:
                    request = throw(session, step)
                except StopIteration as done:
                    facts: StationFacts = done.value
                    return facts
                continue
            try:
                request = send(session, heard)
            except StopIteration as done:
                return done.value  # type: ignore[no-any-return]  # what the session returns

    def behind(
        order: StationTask, session: Steps[StationFacts], tap: object
    ) -> tuple[Steps[StationFacts], Tap]:
        return (late(session) if order.name == "b" else session), tap  # type: ignore[return-value]  # it is a tap

    return prepare(line_of({}), RECIPE, 2.0, 2.0, allow_missing=allow_missing, pulled=behind).go()


def test_a_slow_station_is_waited_for_as_long_as_it_answers() -> None:
    """At 1200 baud, reading everything takes longer than the time limit of a silent station."""
    line = (
        line_of({})
        .replace('url = "b"', 'url = "b"\nbaudrate = 1200')
        .replace("turnaround_ms = 5.0", "turnaround_ms = 80.0\nwire = true")
    )
    run = prepare(
        line, RECIPE.replace("[run]", "[sampling]\ncounters_every_s = 600\n\n[run]"), 10.0, 0.2
    ).go()
    assert outcomes(run) == ["completed"] * 3, [
        context.facts.reason for context in run.contexts.values()
    ]
    assert _first(run, "a", "WD1").at - run.t0 > SILENT_S


# -- without those that are missing ----------------------------------------------------------------


@pytest.mark.parametrize("step", [1, 2, 3])
def test_the_others_go_on_without_it_where_that_is_allowed(step: int) -> None:
    sim = {1: SILENT, 2: nak("alarm_high_limit"), 3: nak("selected_temperature")}[step]
    run = run_with(sim=sim, allow_missing=True)
    assert outcomes(run) == ["completed", "left_out", "completed"]
    assert {row[2] for row in run.memory.samples} == {"a", "c"}
    assert code_of(run) is Exit.FINE
    assert_all_touched_are_safe(run)
    assert not [text for text in writes(run, "b") if text.startswith("WPS100000")]
    (event,) = run.memory.of_kind("station.left_out")
    assert (event.station, event.severity) == ("b", "warning")


def test_a_run_of_which_no_station_starts_is_refused_whatever_is_allowed() -> None:
    run = prepare(
        line_of(dict.fromkeys(NAMES, "tool = 0")), RECIPE, 2.0, 2.0, allow_missing=True
    ).go()
    assert outcomes(run) == ["left_out"] * 3
    assert code_of(run) is Exit.STATION


# -- the end of the run while it starts ------------------------------------------------------------


@pytest.mark.parametrize("at_s", [0.2, 0.9, 1.5, 2.2])
def test_a_run_that_is_ended_while_it_starts_calls_nobody_off(at_s: float) -> None:
    run = prepare(line_of({}), RECIPE, 5.0, 2.0)
    run.at(at_s, lambda: run.driver.end("ended by a test"))
    run.go()
    assert outcomes(run) == ["completed"] * 3
    assert_all_touched_are_safe(run)
    for name in NAMES:
        station = run.stations[name]
        assert isinstance(station, VirtualStation)
        orders = [write.value for write in station.log.written("status")]
        assert orders == [] or orders[-1] == STAND
        assert orders.count(WORKING) <= 1
