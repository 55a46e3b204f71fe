"""The protocol face, held to frames that are written out by hand from the manuals
(docs/reference/protocol.md).
"""

from __future__ import annotations

import pytest

from jbclog.config.line import StationSpec
from jbclog.config.sim_spec import SimSpec
from jbclog.core.errors import UsageError
from jbclog.core.quantities import OFF
from jbclog.sim.device import AcceptedWrite
from jbclog.sim.virtual import VirtualStation
from support.virtual.by_frame import T0, frame, told


def station(family: str = "dde", address: int = 1, **sim: object) -> VirtualStation:
    """A station that answers at once, so that its physics stands still between two questions at
    `T0`.
    """
    table = SimSpec.model_validate(
        {"wire": False, "turnaround_ms": 0, "joints_per_minute": 0} | sim
    )
    return VirtualStation(
        StationSpec(name="s", url="s", family=family, address=address, sim=table), now=T0
    )


# Printed in the manuals, or text printed there with the check byte computed: (question, answer)
GOLDEN = [
    # RST1 -> AST100350
    ("02 3030 3031 52 535431 03 64", "02 3031 3030 41 535431 3030333530 03 41"),
    # RTT1 -> ATT100183
    ("02 3030 3031 52 545431 03 63", "02 3031 3030 41 545431 3030313833 03 4a"),
    ("02 3030 3031 52 5454 03 52", "02 3031 3030 41 5454 3030303435 03 70"),  # RTT -> ATT00045
    # WST100350 -> AST1
    ("02 3030 3031 57 535431 3030333530 03 57", "02 3031 3030 41 535431 03 77"),
    # WA1200012 -> AA12, check byte ETX
    ("02 3030 3031 57 413132 3030303132 03 26", "02 3031 3030 41 413132 03 03"),
    # WHD101.60 -> AHD1
    ("02 3030 3031 57 484431 30312e3630 03 43", "02 3031 3030 41 484431 03 7c"),
    # WHD199999 -> AHD1
    ("02 3030 3031 57 484431 3939393939 03 53", "02 3031 3030 41 484431 03 7c"),
    # WNVS00000 -> ANVS
    ("02 3030 3031 57 4e5653 3030303030 03 2c", "02 3031 3030 41 4e5653 03 0a"),
    # WMAT00375, printed in 002 and 004
    ("02 3030 3031 57 4d4154 3030333735 03 3e", "02 3031 3030 41 4d4154 03 19"),
    # WPS100010 -> APS1
    ("02 3030 3031 57 505331 3030303130 03 54", "02 3031 3030 41 505331 03 73"),
]


@pytest.mark.parametrize(("question", "answer"), GOLDEN)
def test_golden_frames(question: str, answer: str) -> None:
    asked = station()
    asked.plant.ports[1].tip.temperature_c = 183.2
    asked.plant.transformer.idle_c = 45
    replies = asked.receive(bytes.fromhex(question), T0)
    assert [reply.data for reply in replies] == [bytes.fromhex(answer)]


def test_the_model_name_is_filled_with_blanks_on_the_left() -> None:
    question = bytes.fromhex("023030303152534d4e0302")
    assert station().receive(question, T0)[0].data == frame("ASMN  DDE", "0100")
    assert station("ucr").receive(question, T0)[0].data == frame("ASMNUCR245", "0100")


def test_golden_frames_without_addresses() -> None:
    asked = station(address=False)
    asked.plant.ports[1].tip.temperature_c = 183.0
    assert (
        asked.receive(bytes.fromhex("02525454310362"), T0)[0].data.hex()
        == "02415454313030313833034b"
    )
    assert (
        asked.receive(bytes.fromhex("02574d41543030333735033f"), T0)[0].data.hex()
        == "02414d41540318"
    )


def test_power_port_error_and_alarm_flags_as_printed() -> None:
    asked = station(tools={2: 0})
    asked.plant.ports[1].tip.power_w = 0.84 * 130
    assert told(asked, "RPP1") == "APP100840"
    assert told(asked, "RPE2") == "APE200004"
    asked.plant.ports[1].high.latched = asked.plant.ports[1].low.latched = True
    # reading clears (000, 4.8.27)
    assert [told(asked, "RTA1"), told(asked, "RTA1")] == ["ATA100011", "ATA100000"]


FACTORY = {
    "RST1": "AST100350",
    "RPS1": "APS100010",
    "RCT1": "ACT100002",
    "RA12": "AA1200000",
    "RS12": "AS1200150",
    "RD12": "AD1200005",
    "RH12": "AH1200030",
    "RHA1": "AHA199999",
    "RLD1": "ALD199999",
    "RED1": "AED199999",
    "RMAT": "AMAT00500",
    "RMIT": "AMIT00090",
    "RSER": "ASER00000",
    "RCW1": "ACW100000",
}


def test_factory_settings() -> None:
    asked = station()
    assert {text: told(asked, text) for text in FACTORY} == FACTORY
    assert told(station("ucr"), "RMAT") == "AMAT00450"  # manual 004


REFUSED = [
    ("RXYZ", "NXYZ00004"),
    ("RTT3", "NTT300004"),  # a DDE has two ports
    ("RA10", "NA1000004"),
    ("WTT100100", "NTT100004"),  # only read
    ("RNVS", "NNVS00004"),  # only written
    ("RFST", "NFST00004"),  # UCR only
    ("RTT1000", "NTT100002"),
    ("WST1", "NST100002"),
    ("WST1350", "NST100002"),
    ("WST10x350", "NST100002"),
    ("WHD100160", "NHD100002"),  # not ss.cc
    ("ATT1", "NTT100002"),
    ("WNVS", "NNVS00002"),
    ("WST100352", "NST100003"),  # steps of 5
    ("WST100505", "NST100003"),  # above MAT
    ("WST100085", "NST100003"),  # below MIT
    ("WA12-0051", "NA1200003"),
    ("WD1200010", "ND1200003"),
    ("WH1200007", "NH1200003"),
    ("WHA199999", "NHA100003"),
    ("WPS100002", "NPS100003"),
    ("WPS100009", "NPS100003"),
    ("WNVS00001", "NNVS00003"),
]


@pytest.mark.parametrize(("question", "answer"), REFUSED)
def test_refusals(question: str, answer: str) -> None:
    asked = station()
    assert told(asked, question) == answer
    assert asked.log.writes == []
    assert [refused.code for refused in asked.log.refused] == [int(answer[-1])]


def test_a_wrong_check_byte_is_refused_with_1_and_changes_nothing() -> None:
    asked = station()
    broken = bytearray(frame("WST100330"))
    broken[-1] ^= 4
    assert asked.receive(bytes(broken), T0)[0].data == frame("NST100001", "0100")
    assert told(asked, "RST1") == "AST100350"


def test_a_right_check_byte_over_no_frame_is_refused_with_2() -> None:
    assert station().receive(frame("QST1"), T0)[0].data == frame("NST100002", "0100")


@pytest.mark.parametrize(
    "question", [frame("RTT1", "0002"), frame("RTT1", ""), b"\x55\xaa", b"", frame("RTT1")[:-1]]
)
def test_what_is_not_for_it_gets_silence(question: bytes) -> None:
    assert station().receive(question, T0) == []


def test_a_question_in_pieces_and_two_at_once() -> None:
    asked = station()
    question = frame("RST1")
    assert asked.receive(question[:4], T0) == []
    assert len(asked.receive(question[4:], T0)) == 1
    assert len(asked.receive(question + frame("RMIT"), T0)) == 2
    assert len(asked.receive(b"\x00\x7f" + question, T0)) == 1
    assert len(asked.receive(question, T0)) == 1


def test_robot_mode_off_refuses_everything_with_5() -> None:
    asked = station(robot_mode=False)
    assert [told(asked, text) for text in ("RTT1", "WST100330", "RXYZ")] == [
        "NTT100005",
        "NST100005",
        "NXYZ00005",
    ]
    asked.device.identity.robot_mode = True
    assert told(asked, "RST1") == "AST100350"


def test_writes_are_read_back_and_logged() -> None:
    asked = station()
    for question in ("WST100330", "WA12-0012", "WD1299999", "WHA100380", "WHD101.60", "WPS100001"):
        assert (told(asked, question) or "").startswith("A")
    answers = [told(asked, text) for text in ("RST1", "RA12", "RD12", "RHA1", "RHD1", "RPS1")]
    assert answers == ["AST100330", "AA12-0012", "AD1299999", "AHA100380", "AHD101.60", "APS100001"]
    assert told(asked, "RST2") == "AST200350"  # the other port is left alone
    assert asked.log.writes == [
        AcceptedWrite(T0, "selected_temperature", 1, 0, 330),
        AcceptedWrite(T0, "adjust", 1, 2, -12),
        AcceptedWrite(T0, "sleep_delay", 1, 2, OFF),
        AcceptedWrite(T0, "alarm_high_limit", 1, 0, 380),
        AcceptedWrite(T0, "alarm_high_delay", 1, 0, 1.6),
        AcceptedWrite(T0, "status", 1, 0, (0, 0, 0, 0, 1)),
    ]
    assert asked.log.reads == 7


def test_a_restart_takes_a_while_and_forgets_the_selected_temperature() -> None:
    asked = station()
    told(asked, "WST100330")
    assert told(asked, "WRST00000", T0 + 1) == "ARST"
    assert told(asked, "RST1", T0 + 3.9) is None
    assert told(asked, "RST1", T0 + 4.1) == "AST100350"
    told(asked, "WST100330", T0 + 5)
    told(asked, "WNVS00000", T0 + 5)
    told(asked, "WRST", T0 + 6)
    assert told(asked, "RST1", T0 + 10) == "AST100330"


def test_a_factory_reset_answers_and_resets() -> None:
    asked = station()
    told(asked, "WD1200009")
    assert told(asked, "WRSP00000") == "ARSP"
    assert told(asked, "RD12") == "AD1200005"


def test_a_new_address_counts_after_its_answer() -> None:
    asked = station("ucr")
    assert told(asked, "WSAD00007") == "ASAD"
    assert told(asked, "RST1") is None
    assert asked.receive(frame("RST1", "0007"), T0)[0].data == frame("AST100350", "0700")
    assert asked.receive(frame("WSAD00000", "0007"), T0)[0].data == frame("ASAD", "0700")
    assert asked.receive(frame("RST1", ""), T0)[0].data == frame("AST100350", "")


def test_the_feeder_of_an_ale() -> None:
    asked = station("ale", counters={"dispensed_length": 100.0})
    assert [
        told(asked, text) for text in ("RMOD", "RLEN", "RSPD", "RDIA", "RBCK", "RWCD", "RFEE")
    ] == [
        "AMOD00001",
        "ALEN00050",
        "ASPD00100",
        "ADIA00100",
        "ABCK00010",
        "AWCD00000",
        "AFEE00000",
    ]
    assert [told(asked, text) for text in ("WLEN00100", "WMOD00004", "WSTR00000")] == [
        "ALEN",
        "NMOD00003",
        "ASTR",
    ]
    assert [told(asked, text, T0 + 0.5) for text in ("RFEE", "RPS1")] == ["AFEE00001", "APS101010"]
    assert told(asked, "RPS1", T0 + 1.05) == "APS102010"
    assert [told(asked, text, T0 + 2) for text in ("RFEE", "RDL1", "RDC1")] == [
        "AFEE00000",
        "ADL10044C",
        "ADC100001",
    ]
    # 1000 dmm, as printed
    assert told(station("ale", counters={"dispensed_length": 100.0}), "RDL1") == "ADL1003E8"


def test_a_feed_that_is_stopped() -> None:
    asked = station("ale")
    told(asked, "WMOD00000")
    told(asked, "WSTR", T0)
    assert [told(asked, text, T0 + 9) for text in ("RFEE", "WSTP", "RFEE")] == [
        "AFEE00001",
        "ASTP",
        "AFEE00000",
    ]
    assert [write.name for write in asked.log.writes] == [
        "feeder_mode",
        "start_feeding",
        "stop_feeding",
    ]


def test_old_stations_know_no_extractor_order_and_no_nvs() -> None:
    asked = station("soldering")
    assert [told(asked, text) for text in ("WPS100010", "WPS100001", "WNVS00000", "RSMN")] == [
        "NPS100003",
        "APS1",
        "NNVS00004",
        "ASMN  DDR",
    ]


@pytest.mark.parametrize(
    ("family", "ports"),
    [("soldering", 2), ("dde", 2), ("nae", 2), ("dme", 4), ("hde", 2), ("ucr", 1), ("ale", 1)],
)
def test_each_family_has_its_ports(family: str, ports: int) -> None:
    asked = station(family)
    answers = [told(asked, f"RCT{port}") for port in range(1, 5)]
    assert [bool(answer and answer.startswith("A")) for answer in answers] == [
        port <= ports for port in range(1, 5)
    ]


@pytest.mark.parametrize("family", ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"])
def test_every_command_of_every_family_is_answered(family: str) -> None:
    asked = station(family)
    for command in asked.device.family.commands.values():
        if command.readable:
            answer = told(asked, "R" + command.code(1, 2))
            assert answer is not None
            assert answer.startswith("A" + command.code(1, 2)), command.name
            command.quantity.decode(answer[1 + len(command.code(1, 2)) :])


def test_auto_goes_by_the_model_that_is_told() -> None:
    assert told(station("auto", model="NAE"), "RSMN") == "ASMN  NAE"
    with pytest.raises(UsageError, match="family auto"):
        station("auto")


@pytest.mark.parametrize(
    "sim",
    [
        {"settings": {"selected_temperature": 352}},
        {"settings": {"tip_temperature": 350}},
        {"settings": {"selected": 350}},
        {"counters": {"dispensed_length": 1.0}},
        {"tools": {3: 2}},
        {"fault": [{"kind": "nak", "command": "temperature"}]},
        {"fault": [{"kind": "stuck", "port": 4}]},
    ],
)
def test_what_a_station_cannot_be_is_an_error_at_the_start(sim: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="s: "):
        station(**sim)


def test_it_begins_with_the_settings_that_it_is_given() -> None:
    asked = station(
        settings={
            "selected_temperature": 330,
            "sleep_delay": "off",
            "status": "stand",
            "alarm_high_delay": 1.6,
        }
    )
    assert [told(asked, text) for text in ("RST2", "RD29", "RPS1", "RHD1")] == [
        "AST200330",
        "AD2999999",
        "APS100001",
        "AHD101.60",
    ]
    assert asked.log.writes == []
