"""The client's rules: which answers are believed, what is asked again, and what never is."""

from __future__ import annotations

import pytest

from support.clients.talk import Answer, Talk, framed
from support.golden.form import with_check_byte
from support.product import (
    FAMILIES,
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    IoResult,
    ModelUnknown,
    NotReceived,
    NotSupported,
    OutOfRange,
    Refusal,
    RobotModeOff,
    Station,
    StationError,
    Steps,
    Value,
)

ALE = FAMILIES["ale"].commands
TIP, STATUS, FLAGS, SELECT = (
    ALE["tip_temperature"],
    ALE["status"],
    ALE["alarm_flags"],
    ALE["selected_temperature"],
)
GOOD = ("RTT1", "ATT100183")
PROBE = ("RSMN", "ASMN  ALE")


def read_tip(station: Station) -> Steps[Value]:
    return station.read(TIP, 1)


def read_power(station: Station) -> Steps[Value]:
    return station.read(ALE["power"], 1)


def flipped(frame: bytes) -> bytes:
    """One bit the other way round, which the check byte always shows."""
    return frame[:8] + bytes([frame[8] ^ 4]) + frame[9:]


# -- addresses -------------------------------------------------------------------------------------


def test_an_answer_names_the_station_as_its_source() -> None:
    assert Talk(("RTT1", framed("ATT100183", 1, 0))).do(read_tip) == 183


def test_the_other_order_of_addresses_is_believed_and_learnt() -> None:
    """The check byte is the same in both orders; no manual says which one answers have.

    docs/reference/protocol.md, Check byte; docs/reference/contradictions.md, B-6.
    """
    talk = Talk(("RTT1", framed("ATT100183", 0, 1)))
    assert talk.do(read_tip) == 183
    assert talk.station.question(TIP, 1).answer_start == b"\x020001ATT1"


@pytest.mark.parametrize("pair", [(2, 0), (0, 2), (1, 1), (10, 0), (1, 2), (None, 0)])
def test_another_pair_of_addresses_is_never_matched(pair: tuple[int | None, int]) -> None:
    talk = Talk(("RTT1", framed("ATT100999", *pair), (0.03, "ATT100183")))
    assert talk.do(read_tip) == 183
    assert talk.station.strays == {"address": 1}


def test_a_line_without_addresses_takes_answers_without_addresses_only() -> None:
    talk = Talk(("RTT1", framed("ATT100999", 1, 0), (0.03, "ATT100183")), address=None)
    assert talk.do(read_tip) == 183
    assert talk.station.strays == {"address": 1}


@pytest.mark.parametrize(
    ("frame", "address", "said"),
    [
        (framed("ATT100999", 5, 0), 1, "ATT100999 from address 05, not 01"),
        # either order of addresses
        (framed("ATT100999", 0, 20), 1, "ATT100999 from address 20, not 01"),
        (framed("ATT100999", 99, 0), None, "ATT100999 from address 99, though no address is used"),
        (framed("ATT100999", None, None), 1, "ATT100999 without an address, not from address 01"),
        (framed("APP100999", 1, 0), 1, "APP100999, which is no answer to it"),
        (framed("APP100999", 0, 1), 1, "APP100999, which is no answer to it"),
        (framed("APP100999", None), None, "APP100999, which is no answer to it"),
    ],
)
def test_what_came_in_place_of_an_answer_is_named_with_its_address(
    frame: bytes, address: int | None, said: str
) -> None:
    talk = Talk(replies=lambda text: [frame if text == "RTT1" else PROBE[1]], address=address)
    with pytest.raises(AnswerFormat, match=f"answered by {said}$"):
        talk.do(read_tip)


# -- header, code, length, digits ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stray", "kind"),
    [
        (framed("RTT1", 0, 1), "echo"),
        (framed("WST100350", 0, 1), "echo"),
        (framed("APP100999"), "code"),  # another signal's
        (framed("ATT200999"), "code"),  # another port's
        (framed("ATT1"), "code"),  # an acknowledgement where a value was asked
        (framed("NPP100003"), "code"),  # a refusal of something else
    ],
)
def test_what_answers_nothing_is_counted_and_the_answer_still_waited_for(
    stray: bytes, kind: str
) -> None:
    talk = Talk(("RTT1", stray, (0.03, "ATT100183")))
    assert talk.do(read_tip) == 183
    assert talk.station.strays == {kind: 1}


def test_a_port_s_temperature_is_not_the_transformer_s() -> None:
    """RTT has two letters: ATT1ddddd begins as its answer does (docs/reference/contradictions.md,
    B-10).
    """
    talk = Talk(("RTT", "ATT100183", (0.03, "ATT00045")))
    assert talk.do(lambda station: station.read(ALE["transformer_temperature"])) == 45


def test_a_value_does_not_acknowledge_a_write() -> None:
    talk = Talk(("WST100350", "AST100300", (0.03, "AST1")))
    talk.do(lambda station: station.write(SELECT, 350, 1))
    assert talk.station.strays == {"code": 1}


@pytest.mark.parametrize(
    "data", [b"0183", b"000183", b"0018x", b"00 83", b"1e100", b"+0183", b"0_183", b"-----"]
)
def test_data_that_is_not_five_digits_is_no_value(data: bytes) -> None:
    wrong = with_check_byte(b"\x020100ATT1" + data + b"\x03")
    talk = Talk(replies=lambda text: [wrong if text == "RTT1" else "ASMN  ALE"])
    with pytest.raises(AnswerFormat):
        talk.do(read_tip)
    assert talk.end.heard.count("RTT1") == 3


@pytest.mark.parametrize(
    ("data", "value"), [("00011", (0, 0, 0, 1, 1)), ("00000", (0, 0, 0, 0, 0))]
)
def test_alarm_flags_are_digits(data: str, value: tuple[int, ...]) -> None:
    assert Talk(("RTA1", f"ATA1{data}")).do(lambda station: station.read(FLAGS, 1)) == value


@pytest.mark.parametrize(
    ("data", "value"),
    [("00002", (0, 0, 0, 0, 1)), ("00070", (0, 0, 0, 1, 0)), ("00095", (0, 0, 0, 1, 1))],
)
def test_a_flag_that_is_neither_0_nor_1_is_set(data: str, value: tuple[int, ...]) -> None:
    talk = Talk(("RTA1", f"ATA1{data}"))
    assert talk.do(lambda station: station.read(FLAGS, 1)) == value
    assert talk.station.anomalies.counts == {24: 1}


@pytest.mark.parametrize("data", ["00100", "10000", "99999", "-0001"])
def test_flags_that_no_manual_has_are_a_format_error_and_not_asked_again(data: str) -> None:
    talk = Talk(("RTA1", f"ATA1{data}"))
    with pytest.raises(AnswerFormat):
        talk.do(lambda station: station.read(FLAGS, 1))


@pytest.mark.parametrize(
    ("text", "value"), [("ADL1003E8", 100.0), ("ADL10x000000003E8", 100.0), ("ADL101000", 409.6)]
)
def test_the_dispensed_length_has_any_width_and_is_hexadecimal(text: str, value: float) -> None:
    talk = Talk(("RDL1", text))
    assert talk.do(lambda station: station.read(ALE["dispensed_length"], 1)) == value
    assert talk.station.data == text.removeprefix("ADL1")  # as it came


def test_the_identification_s_check_byte_is_stx() -> None:
    """R-SMN ends in 03 02 on a line with addresses, an acknowledgement of W-A12 in 03 03.

    docs/reference/protocol.md, Check byte.
    """
    assert framed("RSMN", 0, 1)[-2:] == b"\x03\x02"
    assert framed("AA12")[-2:] == b"\x03\x03"
    assert Talk(PROBE).do(lambda station: station.read(ALE["model"])) == "ALE"
    Talk(("WA12-0050", "AA12")).do(lambda station: station.write(ALE["adjust"], -50, 1, 2))


# -- pieces ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", range(1, 16))
def test_an_answer_may_come_in_pieces(cut: int) -> None:
    whole = framed("ATT100183")
    talk = Talk(("RTT1", (0.010, whole[:cut]), (0.020, whole[cut:])))
    assert talk.do(read_tip) == 183
    assert talk.station.garbage_bytes == 0


@pytest.mark.parametrize(
    "noise",
    [
        b"\x00\xff",
        b"\x02",
        b"\x03",
        b"\x020100ATT",
        b"\x02\x02\x02",
        bytes(range(128, 256)),
        b"U" * 300,
    ],
)
def test_garbage_before_an_answer_is_counted_and_dropped(noise: bytes) -> None:
    talk = Talk(("RTT1", noise + framed("ATT100183")))
    assert talk.do(read_tip) == 183
    assert talk.station.garbage_bytes == len(noise)


def test_merged_frames_are_taken_apart() -> None:
    talk = Talk(("RTT1", framed("APP100999") + framed("ATT100183") + framed("APE100000")))
    assert talk.do(read_tip) == 183


def test_a_truncated_answer_is_none() -> None:
    talk = Talk(("RTT1", framed("ATT100183")[:-1]), PROBE, GOOD)
    assert talk.do(read_tip) == 183


def test_what_is_left_of_one_answer_is_not_read_into_the_next() -> None:
    """A duplicate that lost its check byte, which the next frame's STX would then be."""
    tip, power = framed("ATT100183"), framed("APP100840")
    talk = Talk(("RTT1", tip + tip[:-1]), ("RPP1", power[:9], power[9:]))
    assert talk.each(read_tip, read_power) == [183, 840]


def test_a_duplicate_is_dropped() -> None:
    """It comes while the next question is out, which is another signal's."""
    talk = Talk(("RTT1", "ATT100183", (0.020, "ATT100183")), ("RPP1", "APP100840"))
    assert talk.each(read_tip, read_power) == [183, 840]
    assert talk.station.strays == {"code": 1}


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "error", "reason"),
    [
        (3, OutOfRange, "nak3"),
        (4, NotSupported, "nak4"),
        (5, RobotModeOff, "robot_off"),
        (6, ModelUnknown, "nak6"),
        (7, Refusal, "nak7"),
    ],
)
# no manual says whether N repeats the code (docs/reference/contradictions.md, B-11)
@pytest.mark.parametrize("code", ["TT1", ""])
def test_a_refusal_is_a_named_error_and_not_asked_again(
    code: str, number: int, error: type[Refusal], reason: str
) -> None:
    talk = Talk(("RTT1", f"N{code}{number:05d}"))
    with pytest.raises(error, match="tip temperature of port 1") as caught:
        talk.do(read_tip)
    assert (caught.value.code, caught.value.reason) == (number, reason)


@pytest.mark.parametrize("text", ["NTT100001", "N00002", "NXX900001"])
def test_a_read_that_was_not_received_is_sent_again(text: str) -> None:
    """After a wrong check byte the station cannot know which code it refuses."""
    assert Talk(("RTT1", text), GOOD).do(read_tip) == 183


def test_a_refusal_without_a_number_is_a_format_error() -> None:
    talk = Talk(replies=lambda text: ["NTT1" if text == "RTT1" else "ASMN  ALE"])
    with pytest.raises(AnswerFormat):
        talk.do(read_tip)


# -- what is asked again, and what is not ----------------------------------------------------------


def saying(answer: Answer | None) -> Talk:
    """An ALE that says this to all but the question for its model; None: nothing."""
    return Talk(
        replies=lambda text: ["ASMN  ALE"] if text == "RSMN" else [] if answer is None else [answer]
    )


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (None, AnswerTimeout),
        (flipped(framed("ATT100183")), AnswerCorrupt),
        ("NTT100001", NotReceived),
        ("ATT10018x", AnswerFormat),
        ("APP100999", AnswerFormat),
    ],
)
def test_a_read_goes_out_three_times_at_most(
    answer: Answer | None, error: type[StationError]
) -> None:
    talk = saying(answer)
    with pytest.raises(error):
        talk.do(read_tip)
    assert talk.end.heard.count("RTT1") == 3


@pytest.mark.parametrize(
    "answer",
    [None, flipped(framed("ATA100001")), "NTA100001", "NTA199999", "ATA100102", "APP100999"],
)
def test_alarm_flags_go_out_once_whatever_comes(answer: Answer | None) -> None:
    talk = saying(answer)
    with pytest.raises(StationError):
        talk.do(lambda station: station.read(FLAGS, 1))
    assert talk.end.heard.count("RTA1") == 1


@pytest.mark.parametrize(
    "answer", [None, flipped(framed("APS1")), "NPS100003", "NPS199999", "APS100000", "APP1"]
)
def test_a_write_goes_out_once_whatever_comes(answer: Answer | None) -> None:
    talk = saying(answer)
    with pytest.raises(StationError):
        talk.do(lambda station: station.write(STATUS, (0, 0, 0, 0, 1), 1))
    assert talk.end.heard.count("WPS100001") == 1


@pytest.mark.parametrize(
    "order", ["start_feeding", "stop_feeding", "restart", "factory_reset", "store"]
)
def test_orders_go_out_once_even_without_any_answer(order: str) -> None:
    talk = Talk(replies=lambda text: [])
    with pytest.raises(AnswerTimeout):
        talk.do(lambda station: station.write(ALE[order], 0))
    assert talk.end.heard == [f"W{ALE[order].letters}00000"]


def test_a_refused_write_names_command_and_port() -> None:
    talk = Talk(("WST100350", "NST100003"))
    with pytest.raises(
        OutOfRange, match="selected temperature of port 1: refused with N 00003, value out of range"
    ):
        talk.do(lambda station: station.write(SELECT, 350, 1))


# -- what comes although nothing was asked ---------------------------------------------------------


@pytest.mark.parametrize(
    "said", [framed("ATT100350"), framed("ATT100350")[:9]], ids=["whole", "begun"]
)
def test_what_comes_unasked_is_counted_and_answers_nothing(said: bytes) -> None:
    talk = Talk(GOOD)
    talk.station.unasked(IoResult(0.0, said, 0.0))
    talk.station.unasked(IoResult(0.0, b"", 0.0))
    assert talk.do(read_tip) == 183
    assert talk.station.strays == {"unasked": 1}
