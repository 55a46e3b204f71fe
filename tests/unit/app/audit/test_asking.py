"""What an audit asks, what it believes, and what it says of the rest."""

from __future__ import annotations

import pytest

from jbclog.maintenance.counter_totals.observed import Count, Standing
from jbclog.protocol.commands.family import FAMILIES
from support.virtual.audit_bench import AUDIT, MakeBench, See, count
from support.virtual.manual import says, station_text

COUNTED = "[station.sim.counters]\nplugged_hours = 1234\nwork_hours = 812\nsleep_cycles = 99\n"
ROBOT_OFF = "robot_mode = false"


def test_everything_of_a_station_is_seen(bench: MakeBench, see: See) -> None:
    seen = see(bench(station_text("dde-1", "dde", sim=COUNTED)))["dde-1"]
    assert (seen.audit, seen.line, seen.station, seen.seen, seen.why, seen.source) == (
        AUDIT,
        "hand",
        "dde-1",
        True,
        "",
        "wire",
    )
    assert seen.identity is not None
    assert (seen.identity.family, seen.identity.model, seen.identity.software) == (
        "dde",
        "DDE",
        "1.00a",
    )
    assert len(seen.counts) == 14  # seven of each port
    assert {one.standing for one in seen.counts} == {Standing.OK}
    assert [count(seen, name).value for name in ("plugged_h", "work_h", "sleep_cycles")] == [
        1234.0,
        812.0,
        99.0,
    ]
    assert seen.tool_names == {1: "T245/T470/TR245/TR470", 2: "T245/T470/TR245/TR470"}
    assert (
        seen.parameters["2.sleep_delay"],
        seen.parameters["1.adjust"],
        seen.parameters["maximum_temperature"],
    ) == (
        "5",
        "0",
        "500",
    )
    assert (seen.errors.station, seen.errors.ports) == ("ok", {1: "ok", 2: "ok"})


@pytest.mark.parametrize("family", FAMILIES)
def test_no_family_is_written_to_or_asked_what_reading_clears(
    bench: MakeBench, see: See, family: str
) -> None:
    made = bench(station_text("it", family))
    seen = see(made)["it"]
    assert (seen.seen, seen.why) == (True, "")
    assert {one.standing for one in seen.counts} <= {Standing.OK}
    counters = {counter.name for counter in FAMILIES[family].counters}
    assert {one.counter for one in seen.counts} == counters
    assert made.wires["it"].writes == []
    assert [text for text in made.wires["it"].texts if text.startswith("RTA")] == []


def test_each_count_is_asked_twice_and_no_more(bench: MakeBench, see: See) -> None:
    made = bench(station_text("dde-1", "dde"))
    see(made)
    asked = made.wires["dde-1"].texts
    assert [asked.count(text) for text in ("RSMN", "RSVR", "RCW1", "RCW2", "RSER", "RA12")] == [
        2,
        2,
        2,
        2,
        2,
        2,
    ]


@pytest.mark.parametrize(
    ("said", "value", "standing", "values"),
    [
        (("00100", "00101"), 101.0, Standing.OK, (100.0, 101.0, 101.0)),
        (("00100", "00101", "00100"), 100.0, Standing.OK, (100.0, 101.0, 100.0)),
        (("00100", "00101", "00102"), None, Standing.MOVING, (100.0, 101.0, 102.0)),
    ],
)
def test_two_of_at_most_three_reads_must_agree(
    bench: MakeBench,
    see: See,
    said: tuple[str, ...],
    value: float | None,
    standing: Standing,
    values: tuple[float, ...],
) -> None:
    made = bench(station_text("dde-1", "dde", sim="[station.sim.counters]\nwork_hours = 101\n"))
    says(made, "dde-1", "CW1", *said)
    found = count(see(made)["dde-1"], "work_h")
    assert (found.value, found.standing, found.values) == (value, standing, values)
    assert made.wires["dde-1"].texts.count("RCW1") == 3


def test_a_station_without_robot_mode_is_a_state_that_is_told(bench: MakeBench, see: See) -> None:
    made = bench(station_text("dde-1", "dde", sim=ROBOT_OFF))
    seen = see(made)["dde-1"]
    assert (seen.seen, seen.why) == (False, "Robot mode is off; switch it on in the station's menu")
    assert (seen.counts, seen.identity) == ((), None)
    assert len(made.wires["dde-1"].texts) == 1


def test_a_silent_station_costs_seconds_and_the_next_is_asked(bench: MakeBench, see: See) -> None:
    silent = "[[station.sim.fault]]\nkind = 'silence'\n"
    made = bench(station_text("dead", "dde", sim=silent), station_text("dde-2", "dde"))
    begun = made.clock.monotonic()
    made.wires["dde-2"].watch = lambda text: moments.append(made.clock.monotonic())
    moments: list[float] = []
    seen = see(made)
    assert not seen["dead"].seen
    assert "no usable answer" in seen["dead"].why
    assert seen["dde-2"].seen
    assert moments[0] - begun < 5


def test_a_counter_that_is_refused_is_unread_and_the_others_are_read(
    bench: MakeBench, see: See
) -> None:
    refused = "[[station.sim.fault]]\nkind = 'nak'\ncommand = 'work_hours'\ncode = 4\n"
    seen = see(bench(station_text("dde-1", "dde", sim=refused)))["dde-1"]
    assert count(seen, "work_h") == Count(1, "work_h", "h", None, Standing.UNREAD, (), "nak4")
    assert count(seen, "sleep_h").standing is Standing.OK
    assert seen.seen


def test_a_station_that_falls_silent_meanwhile_keeps_what_it_said(
    bench: MakeBench, see: See
) -> None:
    falls_silent = "[[station.sim.fault]]\nkind = 'silence'\nat_s = 0.2\n"
    seen = see(bench(station_text("dde-1", "dde", sim=falls_silent)))["dde-1"]
    assert seen.seen
    assert seen.why == "no answer to 3 questions in a row"
    standings = [one.standing for one in seen.counts]
    assert standings[0] is Standing.OK
    assert standings[-1] is Standing.UNREAD
    assert seen.counts[-1].why == "timeout"
    assert len(standings) == 14


def test_a_bad_wire_ends_in_time_and_says_so(bench: MakeBench, see: See) -> None:
    noisy = (
        "[[station.sim.fault]]\nkind = 'flip'\nat_s = 0.2\nbits = 1\nevery ="
        " 2\n[[station.sim.fault]]\nkind = 'late'\nby_s = 1.2\n"
    )
    made = bench(station_text("dde-1", "dde", sim=noisy))
    begun = made.clock.monotonic()
    see(made)
    assert made.clock.monotonic() - begun < 60


def test_what_answers_as_another_family_is_not_counted_as_this_station(
    bench: MakeBench, see: See
) -> None:
    made = bench(station_text("dde-1", "dde", sim="model = 'NAE'"))
    seen = see(made)["dde-1"]
    assert (seen.seen, seen.counts) == (False, ())
    assert (
        seen.why
        == "the line file says family dde, the station says model NAE; its counters were not read"
    )
    assert seen.identity is not None
    assert seen.identity.model == "NAE"
    assert set(made.wires["dde-1"].texts) == {"RSMN"}


def test_one_whose_family_is_to_be_learnt_is_learnt(bench: MakeBench, see: See) -> None:
    seen = see(bench(station_text("it", "auto", sim="model = 'JTSE'")))["it"]
    assert seen.identity is not None
    assert (seen.seen, seen.identity.family, {one.counter for one in seen.counts}) == (
        True,
        "jtse",
        {"on_h", "work_h", "tool_cycles", "suction_cycles"},
    )


def test_settings_that_a_job_changes_are_no_parameters(bench: MakeBench, see: See) -> None:
    seen = see(
        bench(
            station_text("ale-1", "ale"),
            station_text("jtse-1", "jtse", sim="tool = 1"),
            station_text("omega-1", "omega"),
        )
    )
    for one in seen.values():
        assert [name for name in one.parameters if "selected" in name or "status" in name] == []
    assert seen["ale-1"].parameters["feeder_mode"] == "discontinuous"
    assert seen["omega-1"].parameters == {"mode": seen["omega-1"].parameters["mode"]}
    assert seen["omega-1"].errors.station == "normal, preparing or error"  # it heats up
