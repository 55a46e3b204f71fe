"""A whole virtual station: its wire's pace, its faults by name and the time they count from."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import SimSpec
from jbclog.protocol.frame import CorruptFrame, Frame, FrameReader
from jbclog.sim.virtual import Reply, VirtualStation

T0 = 1000.0
READ = Frame("R", "TT1", 0, 1).encode()
FLAGS = Frame("R", "TA1", 0, 1).encode()
WRITE = Frame("W", "ST100330", 0, 1).encode()
ORDER = Frame("W", "PS100001", 0, 1).encode()


def station(
    *faults: dict[str, object], baudrate: int = 19200, line: str = "8N1", **sim: object
) -> VirtualStation:
    table = SimSpec.model_validate(
        {"joints_per_minute": 0, "fault": faults, "turnaround_ms": 0} | sim
    )
    return VirtualStation(
        StationSpec(name="s", url="s", family="dde", baudrate=baudrate, format=line, sim=table),
        now=T0,
    )


def text(reply: Reply) -> str:
    return reply.data[5:-2].decode()


def told(asked: VirtualStation, question: bytes, seconds: float) -> list[str]:
    """What is answered to a question `seconds` after T0."""
    return [text(reply) for reply in asked.receive(question, T0 + seconds)]


@pytest.mark.parametrize(
    ("baudrate", "line", "turnaround_ms", "expected_ms"),
    [
        (19200, "8N1", 0, 14.0625),  # (11 + 16) × 10 bits
        (19200, "8N1", 1.5, 15.5625),
        (9600, "8N1", 0, 28.125),
        (19200, "8E1", 0, 15.46875),  # 11 bits a character
        (1200, "8E2", 0, 270.0),  # 12 bits a character
    ],
)
def test_an_answer_takes_what_its_bytes_take(
    baudrate: int, line: str, turnaround_ms: float, expected_ms: float
) -> None:
    (reply,) = station(baudrate=baudrate, line=line, turnaround_ms=turnaround_ms).receive(READ, T0)
    assert (reply.at - T0) * 1000 == pytest.approx(expected_ms)


def test_without_a_wire_only_the_turnaround_is_left() -> None:
    (reply,) = station(wire=False, turnaround_ms=2).receive(READ, T0)
    assert reply.at - T0 == pytest.approx(0.002)


def test_answers_follow_each_other_on_the_wire() -> None:
    asked = station()
    first, second = asked.receive(READ + READ, T0)
    assert second.at - first.at == pytest.approx(16 * 10 / 19200)
    (third,) = asked.receive(READ, T0 + 0.001)
    assert third.at - second.at == pytest.approx(16 * 10 / 19200)  # it waits for the wire


def test_the_same_seed_tells_the_same() -> None:
    def record(seed: int) -> list[bytes]:
        asked = station(
            {"kind": "flip", "every": 3},
            {"kind": "noise", "every": 7},
            joints_per_minute=12,
            noise_c=1.0,
            seed=seed,
        )
        asked.receive(Frame("W", "PS100000", 0, 1).encode(), T0)
        return [reply.data for n in range(200) for reply in asked.receive(READ, T0 + 0.1 * n)]

    assert record(1) == record(1)
    assert record(1) != record(2)


def test_silence_hears_and_acts() -> None:
    asked = station(
        {
            "kind": "silence",
            "at_s": 1,
            "for_s": 2,
            "command": "selected_temperature",
            "only": "write",
        }
    )
    told(asked, READ, 0)
    assert told(asked, WRITE, 1.5) == []
    assert told(asked, Frame("R", "ST1", 0, 1).encode(), 1.6) == ["AST100330"]
    assert told(asked, WRITE, 3.5) == ["AST1"]
    assert [struck.kind for struck in asked.log.struck] == ["silence"]


def test_a_lost_answer_takes_the_alarm_flags_with_it() -> None:
    asked = station({"kind": "silence", "command": "alarm_flags", "for_s": 1})
    asked.plant.ports[1].high.latched = True
    assert told(asked, FLAGS, 0) == []
    assert told(asked, FLAGS, 2) == ["ATA100000"]


def test_every_third_answer_is_lost() -> None:
    asked = station({"kind": "silence", "every": 3})
    assert [len(told(asked, READ, n)) for n in range(6)] == [1, 1, 0, 1, 1, 0]


def test_one_flipped_bit_is_seen_by_the_reader() -> None:
    asked = station({"kind": "flip"})
    for n in range(200):
        (reply,) = asked.receive(READ, T0 + n)
        clean = asked.log.struck[-1].clean
        assert (int.from_bytes(reply.data, "big") ^ int.from_bytes(clean, "big")).bit_count() == 1
        assert not any(isinstance(found, Frame) for found in FrameReader().feed(reply.data))


def test_noise_comes_before_the_answer_and_takes_its_time() -> None:
    asked = station({"kind": "noise", "bytes_count": 12})
    (reply,) = asked.receive(READ, T0)
    assert reply.data.endswith(asked.log.struck[0].clean)
    assert len(reply.data) == 12 + 16
    assert reply.at - T0 == pytest.approx((11 + 12 + 16) * 10 / 19200)
    assert all(isinstance(found, Frame | CorruptFrame) for found in FrameReader().feed(reply.data))


def test_late_is_late() -> None:
    asked = station({"kind": "late", "by_s": 0.5, "every": 2})
    asked.receive(READ, T0)
    (reply,) = asked.receive(READ, T0 + 1)
    assert reply.at - (T0 + 1) == pytest.approx(0.5 + 27 * 10 / 19200)


def test_nak_refuses_and_does_not_act() -> None:
    asked = station(
        {"kind": "nak", "code": 3, "command": "selected_temperature", "only": "write", "port": 1}
    )
    assert told(asked, WRITE, 0) == ["NST100003"]
    assert told(asked, Frame("R", "ST1", 0, 1).encode(), 1) == ["AST100350"]
    assert told(asked, Frame("W", "ST200330", 0, 1).encode(), 2) == ["AST2"]
    assert asked.log.written("selected_temperature")[0].port == 2


def test_a_pulled_cable_carries_nothing_and_the_station_goes_on() -> None:
    asked = station({"kind": "dropout", "at_s": 2, "for_s": 3})
    assert asked.next_plugging(T0 + 5) is None  # nothing has been heard yet
    told(asked, WRITE, 10)
    heard = T0 + 10 + 16 * 10 / 19200
    assert asked.next_plugging(T0 + 10) == pytest.approx(heard + 2)
    assert [asked.is_unplugged(T0 + at) for at in (11.9, 12.1, 14.9, 15.1)] == [
        False,
        True,
        True,
        False,
    ]
    assert asked.receive(READ, heard + 1.995) == []  # its answer would come into the outage
    assert asked.receive(WRITE, T0 + 13) == []
    assert asked.next_plugging(T0 + 13) == pytest.approx(heard + 5)
    # no restart: nothing is lost
    assert told(asked, Frame("R", "ST1", 0, 1).encode(), 15.1) == ["AST100330"]
    assert len(asked.log.writes) == 1
    assert asked.next_plugging(T0 + 16) is None


def test_a_restart_loses_what_is_volatile() -> None:
    asked = station({"kind": "restart", "at_s": 5, "for_s": 2})
    told(asked, WRITE, 0)
    assert told(asked, Frame("R", "ST1", 0, 1).encode(), 4.9) == ["AST100330"]
    assert told(asked, READ, 6) == []
    assert told(asked, Frame("R", "ST1", 0, 1).encode(), 7.1) == ["AST100350"]


def test_a_stuck_reading_stays_while_the_tip_does_not() -> None:
    asked = station({"kind": "stuck", "at_s": 1, "for_s": 10, "port": 1}, tools={2: 2})
    told(asked, Frame("W", "PS100000", 0, 1).encode(), 0)
    readings = [told(asked, READ, at)[0] for at in (2, 5, 10)]
    assert len(set(readings)) == 1
    assert asked.plant.ports[1].seen_c == pytest.approx(350, abs=3)
    assert told(asked, READ, 12) == ["ATT100350"]


def test_an_overheating_tip_raises_the_alarm_and_comes_back() -> None:
    asked = station(
        {"kind": "overheat", "at_s": 20, "for_s": 5, "by_c": 25, "port": 1},
        settings={"status": "working", "alarm_high_limit": 380, "alarm_high_delay": 1.6},
    )
    told(asked, READ, 0)
    assert [told(asked, READ, 19), told(asked, FLAGS, 19)] == [["ATT100350"], ["ATA100000"]]
    assert told(asked, READ, 24.9) == ["ATT100405"]
    assert told(asked, READ, 60) == ["ATT100350"]
    assert [told(asked, FLAGS, 60), told(asked, FLAGS, 61)] == [["ATA100001"], ["ATA100000"]]


def test_a_tool_is_pulled_out_and_put_back() -> None:
    asked = station({"kind": "tool", "at_s": 1, "for_s": 2, "code": 0, "port": 2})
    question = Frame("R", "CT2", 0, 1).encode()
    assert [told(asked, question, at)[0] for at in (0, 2, 4)] == [
        "ACT200002",
        "ACT200000",
        "ACT200002",
    ]


def test_faults_can_count_from_the_first_order_to_a_tool() -> None:
    asked = station({"kind": "silence", "at_s": 1.0}, faults_from="order")
    for question, seconds in ((READ, 0.0), (WRITE, 30.0), (ORDER, 60.0), (ORDER, 60.9)):
        assert len(told(asked, question, seconds)) == 1
    assert told(asked, READ, 61.1) == []


def test_faults_of_the_physics_happen_in_their_order_though_nobody_asks() -> None:
    asked = station(
        {"kind": "restart", "at_s": 10, "for_s": 1},
        {"kind": "tool", "at_s": 5, "for_s": 100, "code": 1},
    )
    told(asked, READ, 0)
    asked.advance_to(T0 + 50)
    assert asked.plant.ports[1].tool == 1
    assert told(asked, READ, 50) != []


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "dropout"},
        {"kind": "restart", "at_s": 3},
        {"kind": "nak", "by_c": 3},
        {"kind": "silence", "code": 3},
        {"kind": "tool", "code": 10},
        {"kind": "fire"},
        {"kind": "flip", "at_s": -1},
        {"kind": "flip", "at_s": float("nan")},
        {"kind": "silence", "every": 0},
    ],
)
def test_a_fault_that_makes_no_sense_is_refused(fault: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SimSpec.model_validate({"fault": [fault]})
