"""However a run ends, each tool that it touched is in its safe state, by the station's own log of
the serial line.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.oracles.account import assert_account_holds
from support.oracles.listed_writes import strange_writes
from support.product import (
    COLUMN,
    EXTRACTOR,
    LOOK_S,
    SIM_STAND,
    STAND,
    WORKING,
    EventRow,
    RecordError,
    SampleRow,
    SimPort,
    before_each_value,
    before_made_safe,
    build_device,
    parse_line,
    patch,
)
from support.virtual.lines import fault
from support.virtual.virtual_run import (
    RECIPE,
    Memory,
    VirtualRun,
    is_cold_in_extractor,
    line_text,
    prepare,
)

ALE_RECIPE = RECIPE + "\n[feeder]\nlength_mm = 7.5\n"


def ale_line(sim: str = "") -> str:
    return line_text(sim).replace('"dde"', '"ale"').replace("dde-1", "ale-1")


def orders(run: VirtualRun, port: int) -> list[object]:
    """Return the status words that the station accepted for `port`, in order."""
    return [write.value for write in run.station.log.written("status") if write.port == port]


def touched(run: VirtualRun) -> set[int]:
    """Return the ports that were written to, by the station's log."""
    return {write.port for write in run.station.log.writes if write.port}


def may_be_hot(run: VirtualRun) -> bool:
    """Whether the third step of the start had begun. Before it, nothing that heats is written, not
    even to make a tool safe.
    """
    return max(context.step for context in run.contexts.values()) > 2


def assert_safe(run: VirtualRun) -> None:
    for port in touched(run):
        if may_be_hot(run) or orders(run, port):
            assert orders(run, port)[-1] == STAND, f"port {port}"
        else:
            assert is_cold_in_extractor(run.station, port), f"port {port}"
    assert run.facts.unsafe == []
    assert run.facts.touched == sorted(touched(run))


# -- ways out --------------------------------------------------------------------------------------


def test_at_the_end_of_its_duration() -> None:
    run = prepare(duration_s=5).go()
    assert [orders(run, port) for port in (1, 2)] == [[WORKING, STAND]] * 2
    assert run.facts.safe_state == {1: "verified", 2: "verified"}
    assert len(run.memory.of_kind("safety.safe_state")) == 2


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("family", ["dde", "ale"])
def test_ended_at_any_moment(family: str, every: int) -> None:
    """From the first byte, through writes, sampling and making safe."""
    for step in range(0, 130, every):
        line, recipe = (ale_line(), ALE_RECIPE) if family == "ale" else (line_text(), RECIPE)
        run = prepare(line, recipe, duration_s=1.5)
        run.at(step * 0.023, lambda run=run: run.driver.end("SIGTERM"))
        run.go()
        assert run.facts.outcome != "running", step
        assert_safe(run)
        assert may_be_hot(run) or not run.station.log.written("status"), step


@pytest.mark.parametrize("away_s", [1.1, 4.0], ids=["starting", "at work"])
@pytest.mark.parametrize("after_s", [0.1 + 0.05 * step for step in range(8)])
def test_ended_during_an_outage_that_passes(away_s: float, after_s: float) -> None:
    """The cable is back within the three seconds that are allowed. Whether a tool is at rest may
    not be known in time.
    """
    run = prepare(line_text(fault("dropout", at_s=away_s, for_s=2.0)), duration_s=60)
    run.at(away_s + after_s, lambda: run.driver.end("SIGINT"))
    run.go()
    assert_safe(run)
    assert may_be_hot(run) == (away_s > 2)


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("kind", ["silence", "dropout", "nak"])
def test_ended_in_the_moment_in_which_it_goes_away(kind: str, every: int) -> None:
    """The signal comes once. Neither an unanswered question nor the search for the station may lose
    it.
    """
    keys = {"silence": {"for_s": 1.5}, "dropout": {"for_s": 1.5}, "nak": {"for_s": 1.5, "code": 5}}[
        kind
    ]
    for step in range(0, 60, every):
        run = prepare(line_text(fault(kind, at_s=4, **keys)), duration_s=None)
        run.at(3.95 + 0.01 * step, lambda run=run: run.driver.end("SIGTERM"))
        run.at(60, lambda: pytest.fail("it was never ended"))
        run.go()
        assert run.heard[-1].at < run.t0 + 9, step
        assert_safe(run)


def test_a_line_on_which_much_is_asked_again_holds_up_no_safe_state() -> None:
    """The tick during which the run is ended is completed first, if that is soon."""
    bad = "".join(fault("silence", command=name, at_s=4) for name in ("tip_temperature", "power"))
    for step in range(20):
        run = prepare(line_text(bad), duration_s=None)
        run.at(5 + 0.05 * step, lambda run=run: run.driver.end("SIGTERM"))
        run.go()
        ordered = next(one.at for one in run.writes if one.text == "WPS100001")
        assert ordered - (run.t0 + 5 + 0.05 * step) < 1.2, step
        assert_safe(run)


def test_the_tick_during_which_the_run_is_ended_has_whole_rows() -> None:
    """What it had not read yet would count as lost."""
    ended = set()
    for step in range(12):
        run = prepare(duration_s=None)
        run.at(5 + 0.01 * step, lambda run=run: run.driver.end("SIGTERM"))
        run.go()
        ended.add(run.facts.last_tick)
        assert {row[COLUMN["quality"]] for row in run.memory.samples} == {"ok"}, step
        for name in ("temperature_c", "power_permille", "status"):
            assert None not in run.memory.column(name, 1) + run.memory.column(name, 2), step
    assert len(ended) == 2  # in one tick, and in the next


def test_a_setting_found_changed_stops_the_run() -> None:
    run = prepare(duration_s=60)
    run.at(5, lambda: setattr(run.station.plant.ports[1].settings, "selected_temperature", 300))
    run.go()
    assert run.facts.outcome == "stopped"
    assert_safe(run)


@pytest.mark.parametrize("at_s", [0.0, 0.3, 0.6, 0.9, 1.0, 1.1, 5.0])
def test_a_run_that_is_refused_half_way(at_s: float) -> None:
    """From some moment on, the station refuses one setting for a while."""
    run = prepare(
        line_text(fault("nak", code=3, command="alarm_low_limit", at_s=at_s, for_s=1.0)),
        duration_s=5,
    ).go()
    assert_safe(run)


@pytest.mark.parametrize("reading", [0, 1, 7, 50])
def test_a_fault_of_this_program(monkeypatch: pytest.MonkeyPatch, reading: int) -> None:
    """An unexpected exception at one of the readings."""
    count = iter(range(10_000))

    def broken() -> None:
        if next(count) == reading:
            raise ZeroDivisionError("injected")

    before_each_value(monkeypatch, broken)
    run = prepare(duration_s=5).go()
    assert run.facts.outcome == "failed"
    assert "ZeroDivisionError: injected" in run.facts.reason
    assert_safe(run)
    assert_account_holds(run)


class BrokenJournal(Memory):
    """A journal that fails after `after` rows."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self._left = after

    def _take(self) -> None:
        self._left -= 1
        if self._left < 0:
            raise RecordError("no space left on device")

    def sample(self, row: SampleRow) -> None:
        self._take()

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self._take()


@pytest.mark.parametrize("after", [0, 1, 2, 3, 10, 100])
def test_a_record_that_cannot_be_kept(after: int) -> None:
    run = prepare(duration_s=5)
    for context in run.contexts.values():
        context.journal = BrokenJournal(after)
    run.go()
    assert run.facts.outcome == "failed"
    assert_safe(run)


# -- what is written, and to whom ------------------------------------------------------------------


def test_a_fault_of_a_moment_while_it_is_made_safe_costs_no_row_of_the_record(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For example, memory is refused once: the tools are made safe, and the record also has all
    readings and events after that.
    """
    refused: list[str] = []

    def refusing(name: str) -> None:
        if not refused:
            refused.append(name)
            raise MemoryError

    before_made_safe(monkeypatch, refusing)
    run = prepare(line_text()).go()
    assert refused
    assert "MemoryError" in run.facts.reason
    assert (run.facts.outcome, run.facts.safe_state) == ("failed", {1: "verified", 2: "verified"})
    assert len(run.memory.of_kind("safety.safe_state")) == 2
    assert_account_holds(run)


def test_what_was_not_touched_is_not_written_to() -> None:
    """A port has no tool and no settings to write: `run` writes only to the other one."""
    run = prepare(
        line_text("tools = {2 = 0}"), RECIPE + "require_tool = false\n", duration_s=3
    ).go()
    assert orders(run, 1) == [WORKING, STAND]
    assert WORKING not in orders(run, 2)


def test_a_run_that_only_looks_writes_nothing() -> None:
    recipe = '[recipe]\nname = "look"\nrevision = 1\nfamilies = ["dde"]\n'
    sim = "settings = {sleep_delay = 5, hibernation_delay = 30}"
    run = prepare(line_text(sim), recipe, duration_s=5).go()
    assert run.writes == []
    assert run.facts.outcome == "completed"


def test_the_feeder_is_stopped_before_anything_else() -> None:
    """On ale, W-STP comes first whenever its tool may be at work."""
    run = prepare(ale_line(), ALE_RECIPE, duration_s=5)
    run.at(3, lambda: run.station.plant.feeder.start(run.driver.clock.monotonic()))
    run.go()
    assert [one.text for one in run.writes][-2:] == ["WSTP00000", "WPS100001"]
    assert run.station.plant.feeder.motor(run.driver.clock.monotonic()) == 0


def test_a_feeder_that_the_robot_starts_again_before_its_tool_rests_is_stopped_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = prepare(ale_line(), ALE_RECIPE + 'mode = "continuous"\n', duration_s=5)
    feeder, order = run.station.plant.feeder, SimPort.order

    def start_and_order(port: SimPort, state: int, extractor: bool) -> None:
        if (state, extractor) == (SIM_STAND, False):
            feeder.start(run.driver.clock.monotonic())
        order(port, state, extractor)

    patch(monkeypatch, "SimPort.order", start_and_order)
    run.go()
    assert [one.text for one in run.writes][-3:] == ["WSTP00000", "WPS100001", "WSTP00000"]
    assert feeder.motor(run.driver.clock.monotonic()) == 0
    assert (run.facts.unsafe, run.facts.may_feed) == ([], False)


def test_nothing_starts_the_feeder() -> None:
    run = prepare(ale_line("feed_each_joint = true"), ALE_RECIPE, duration_s=30).go()
    assert run.station.log.written("start_feeding") == []


# -- extractor -------------------------------------------------------------------------------------


OF_002 = ["dde", "nae", "dme", "hde", "ucr", "ale"]


def extracts(family: str = "dme", sim: str = "", keys: str = "") -> VirtualRun:
    line = line_text(sim).replace('"dde"', f'"{family}"')
    recipe = RECIPE.replace(
        'families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]',
        f'families = ["{family}"]',
    )
    return prepare(
        line, f'{recipe}safe_state = "extractor"\n{keys}[sampling]\nrate_hz = 2\n', duration_s=10
    )


def told(run: VirtualRun) -> list[tuple[str, str]]:
    return [(event.severity, event.text) for event in run.memory.of_kind("safety.safe_state")]


@pytest.mark.parametrize("family", OF_002)
def test_the_extractor_state_counts_where_the_tip_cools(family: str) -> None:
    run = extracts(family).go()
    assert run.facts.touched
    for port in run.facts.touched:
        assert orders(run, port) == [WORKING, EXTRACTOR]
    assert {severity for severity, _ in told(run)} == {"info"}
    assert strange_writes(run.heard, family, next(iter(run.contexts.values())).recipe.text) == []


@pytest.mark.parametrize("family", OF_002)
def test_where_it_does_not_cool_stand_follows_within_three_seconds(family: str) -> None:
    run = extracts(family, "extractor_cools = false").go()
    first = next(
        one.at for one in run.writes if one.text.startswith("WPS") and one.text.endswith("00010")
    )
    for port in run.facts.touched:
        assert orders(run, port) == [WORKING, EXTRACTOR, STAND]
    assert max(one.at for one in run.writes if one.text.endswith("00001")) - first < 3.0
    assert set(run.facts.safe_state.values()) == {"verified"}
    assert all(
        severity == "warning" and "read back: stand; extractor was read back" in text
        for severity, text in told(run)
    )


@pytest.mark.parametrize("family", OF_002)
def test_where_it_is_refused_stand_follows_and_that_is_told(family: str) -> None:
    run = extracts(family, 'quirks = ["extractor_refused"]').go()
    for port in run.facts.touched:
        assert orders(run, port) == [WORKING, STAND]
    assert all(
        severity == "warning" and text.endswith("extractor was refused with N 00003.")
        for severity, text in told(run)
    )
    assert 19 in run.facts.anomalies


def test_four_tools_of_which_one_heats_on() -> None:
    run = extracts("dme", "tools = {1 = 2, 2 = 2, 3 = 2, 4 = 2}")
    run.at(2, lambda: setattr(run.station.plant.ports[3].character, "extractor_cools", False))
    run.go()
    assert [orders(run, port)[1:] for port in (1, 2, 3, 4)] == [
        [EXTRACTOR],
        [EXTRACTOR],
        [EXTRACTOR, STAND],
        [EXTRACTOR],
    ]
    assert run.facts.safe_state == dict.fromkeys((1, 2, 3, 4), "verified")


def test_a_delay_that_is_off_is_no_less_refused_than_with_stand() -> None:
    """If the extractor state does not cool, stand follows."""
    sim = "settings = {sleep_delay = 'off', hibernation_delay = 30}"
    recipe = RECIPE.replace("[sleep]\ndelay_min = 5\n", "") + 'safe_state = "extractor"\n'
    recipe = recipe.replace('families = ["soldering", ', "families = [")
    run = prepare(line_text(sim), recipe, duration_s=5).go()
    assert (run.facts.outcome, run.writes) == ("refused", [])
    assert "sleep delay of port 1 off, so a tool in stand never cools down" in run.facts.reason


# -- what cannot be made safe ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "sim",
    [
        fault("dropout", at_s=5, for_s=1000),
        fault("silence", at_s=5),
        fault("nak", at_s=5, code=5),
        fault("nak", at_s=5, code=4, command="status"),
        fault("restart", at_s=5, for_s=1000),
    ],
    ids=["cable", "silence", "robot mode", "refused", "restarting"],
)
def test_an_unreachable_tool_is_named_with_its_last_temperature(sim: str) -> None:
    run = prepare(line_text(sim), duration_s=8).go()
    assert run.facts.safe_state == {1: "failed", 2: "failed"}
    last = run.memory.column("temperature_c", 2)
    shown = next(value for value in reversed(last) if value is not None)
    assert any(
        text.startswith("dde-1 port 2: ") and f"last read {shown} °C" in text
        for text in run.facts.unsafe
    )
    assert [event.severity for event in run.memory.of_kind("safety.not_safe")] == [
        "critical",
        "critical",
    ]


@pytest.mark.parametrize("by_s", [0.3, 0.5, 0.9])
def test_a_station_that_takes_its_time_to_store_is_not_given_up(by_s: float) -> None:
    """Its reads are fast; no manual prints the time of an acknowledgement
    (docs/reference/contradictions.md, B-13).
    """
    run = prepare(line_text(fault("late", only="write", by_s=by_s)), duration_s=3).go()
    assert run.facts.outcome == "completed"
    assert run.facts.safe_state == {1: "verified", 2: "verified"}
    assert [one.text for one in run.writes].count("WPS100001") == 1


def test_three_tries_within_seconds() -> None:
    """A station has three seconds, and each of its tools at least one try. An order without an
    acknowledgement is repeated up to three times after that.
    """
    run = prepare(line_text(fault("silence", at_s=5)), duration_s=60)
    run.at(6, lambda: run.driver.end("SIGTERM"))
    run.go()
    assert 3 <= [one.text for one in run.writes].count("WPS100001") <= 6
    assert [one.text for one in run.writes].count("WPS200001") >= 1
    assert run.heard[-1].at - (run.t0 + 6) < 5


def test_no_tool_waits_for_the_tries_of_another() -> None:
    line = line_text(fault("silence", at_s=5)).replace('"dde"', '"dme"')
    run = prepare(line, RECIPE + "\n[sampling]\nrate_hz = 2\n", duration_s=60)
    run.at(6, lambda: run.driver.end("SIGTERM"))
    run.go()
    ordered = [one for one in run.writes if one.text.endswith("00001")]
    assert [one.text[3] for one in ordered[:4]] == ["1", "2", "3", "4"]
    assert ordered[3].at - (run.t0 + 6) < 3
    assert run.heard[-1].at - (run.t0 + 6) < 6


def test_a_stranger_on_the_cable_is_not_written_to() -> None:
    """Another model is on the cable after the outage: its 00001 may mean anything (on hot air it
    switches the heater on).
    """
    run = prepare(line_text(fault("dropout", at_s=4, for_s=3)), duration_s=12)
    run.at(5, lambda: setattr(run.station.device.identity, "model", "JTSE"))
    run.go()
    assert [one.text for one in run.writes if one.at > run.t0 + 5] == []
    assert run.facts.safe_state == {1: "failed", 2: "failed"}
    assert any("JTSE" in text for text in run.facts.unsafe)


def test_a_stranger_that_was_plugged_in_at_the_very_end_is_not_written_to() -> None:
    run = prepare(line_text(fault("dropout", at_s=4, for_s=1)), duration_s=60)
    run.at(4.5, lambda: setattr(run.station.device.identity, "model", "JTSE"))
    run.at(4.6, lambda: run.driver.end("SIGTERM"))
    run.go()
    assert [one.text for one in run.writes if one.at > run.t0 + 4.5] == []
    assert run.facts.safe_state == {1: "failed", 2: "failed"}


JTSE = line_text("tool = 1").replace("dde", "jtse")


def exchange(run: VirtualRun, text: str, at_s: float) -> None:
    """Move the cable to the station that `text` describes, between two questions, without losing
    the link.
    """
    (other,) = parse_line(text, Path("line.toml")).stations

    def exchanged() -> None:
        run.station.device = build_device(other, run.driver.clock.monotonic(), 1)

    run.at(at_s, exchanged)


@pytest.mark.parametrize("way_out", ["end", "SIGTERM"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (JTSE, "a JTSE, not the DDE"),
        (line_text().replace("dde", "nae"), "a NAE, not the DDE"),
        (line_text("software = '7777777'"), "a DDE with software 7777777"),
    ],
    ids=["hot air", "another model", "other software"],
)
def test_a_stranger_on_a_standing_link_is_not_written_to(
    text: str, said: str, way_out: str
) -> None:
    """00001 sets a soldering tool to stand and switches hot air on. The link was not lost since the
    last reading of the counters.
    """
    run = prepare(duration_s=12 if way_out == "end" else 60)
    exchange(run, text, at_s=9)
    if way_out != "end":
        run.at(12, lambda: run.driver.end(way_out))
    run.go()
    assert [one.text for one in run.writes if one.at > run.t0 + 9] == []
    assert run.facts.safe_state == {1: "failed", 2: "failed"}
    assert len(run.facts.unsafe) == 2
    for sentence in run.facts.unsafe:
        assert f"({said}" in sentence
        assert ", is now on its cable), its " in sentence
        assert "may be hot (its temperature is not known); switch the station off" in sentence
    (event,) = run.memory.of_kind("identity.changed")
    assert event.severity == "critical"


@pytest.mark.parametrize("answer", ["silence", "N 1", "N 2", "damage"])
def test_the_look_at_the_model_delays_the_safe_order_by_a_moment_at_most(answer: str) -> None:
    """Only another model in the answer shows another station; after any other answer, a hot tool
    gets its order.
    """
    run = prepare(duration_s=60)
    ask, ended = run.station.device.answer, run.t0 + 13
    told = {
        "silence": None,
        "N 1": ("N", "SMN00001"),
        "N 2": ("N", "SMN00002"),
        "damage": ("A", "SMNDDF"),
    }[answer]
    damaged: list[float] = []

    def respond(header: str, text: str, now: float) -> tuple[str, str] | None:
        if now < ended or "SMN" not in text or (answer == "damage" and damaged):
            return ask(header, text, now)
        damaged.append(now)
        return told

    run.station.device.answer = respond  # type: ignore[method-assign]
    run.at(13, lambda: run.driver.end("SIGTERM"))
    run.go()
    assert damaged
    orders = [one for one in run.writes if one.at > ended]
    assert [one.text for one in orders] == ["WPS100001", "WPS200001"]
    assert orders[0].at - ended < LOOK_S + 0.05
    assert run.facts.safe_state == {1: "verified", 2: "verified"}
