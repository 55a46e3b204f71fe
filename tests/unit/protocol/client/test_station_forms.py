"""What the client takes beside the recommended forms, how it counts that, and what it does not
take.
"""

from __future__ import annotations

import pytest

from support.clients.talk import Answer, Talk, framed
from support.product import (
    FAMILIES,
    LEAST_S,
    LINK_QUIET_S,
    MOST_S,
    OFF,
    AnswerFormat,
    NotReceived,
    NotSupported,
    Refusal,
    Station,
    StationError,
    StationSilent,
    Steps,
    Value,
)

ALE, UCR = FAMILIES["ale"].commands, FAMILIES["ucr"].commands
PROBE = ("RSMN", "ASMN  ALE")
TIP, CYCLES, DISPENSED = ALE["tip_temperature"], ALE["desolder_cycles"], ALE["dispensed_cycles"]


def read(name: str) -> object:
    """A step that reads a command of ALE: of port 1 and tool 2 where it wants them."""
    command = ALE[name]
    scope = command.scope.value
    return lambda station: station.read(
        command, None if scope == "station" else 1, 2 if scope == "tool" else None
    )


def outcome(talk: Talk, step: object) -> object:
    """The value, or the error where there is none."""
    try:
        return talk.do(step)  # type: ignore[arg-type]
    except StationError as error:
        return type(error)


# -- data fields -----------------------------------------------------------------------------------

ODD = [
    ("adjust", "RA12", ".0050", -50, 3),
    ("alarm_high_delay", "RHD1", "00160", 1.6, 22),
    ("alarm_low_delay", "RLD1", "00000", 0.0, 22),
    ("alarm_high_limit", "RHA1", "00000", OFF, 23),
    ("alarm_low_limit", "RLA1", "65535", OFF, 23),
    ("alarm_flags", "RTA1", "00020", (0, 0, 0, 1, 0), 24),
    ("time_to_sleep", "RED1", "65535", 65535, 25),
    ("port_error", "RPE1", "80000", 8, 28),
    ("power", "RPP1", "01001", 1001, 32),
    ("model", "RSMN", "ALE-2U", "ALE-2U", 34),
    ("model", "RSMN", "ALE", "ALE", 34),
    ("model", "RSMN", "ALE  ", "ALE", 34),
    ("model", "RSMN", "UCR24", "UCR24", 34),
    ("software_version", "RSVR", "8886412", "8886412", 5),
    ("dispensed_length", "RDL1", "0x000000003E8", 100.0, 35),
    ("dispensed_length", "RDL1", "003e8", 100.0, 35),
    ("dispensed_length", "RDL1", "3E8", 100.0, 35),
    ("dispensed_length", "RDL1", "01000", 409.6, 35),
]
PLAIN = [
    ("adjust", "RA12", "-0050", -50),
    ("alarm_high_delay", "RHD1", "01.60", 1.6),
    ("alarm_high_delay", "RHD1", "99999", OFF),
    ("alarm_high_limit", "RHA1", "99999", OFF),
    ("alarm_high_limit", "RHA1", "00380", 380),
    ("alarm_flags", "RTA1", "00010", (0, 0, 0, 1, 0)),
    ("time_to_sleep", "RED1", "99999", 99999),
    ("port_error", "RPE1", "00008", 8),
    ("power", "RPP1", "01000", 1000),
    ("model", "RSMN", "  ALE", "ALE"),
    ("software_version", "RSVR", "1.00a", "1.00a"),
    ("dispensed_length", "RDL1", "003E8", 100.0),
    ("dispensed_length", "RDL1", "00007", 0.7),
]


@pytest.mark.parametrize(("name", "question", "data", "value", "row"), ODD)
def test_an_odd_form_is_read_counted_and_told_once(
    name: str, question: str, data: str, value: Value, row: int
) -> None:
    talk = Talk((question, f"A{question[1:]}{data}"), (question, f"A{question[1:]}{data}"))
    assert talk.each(read(name), read(name)) == [value, value]  # type: ignore[arg-type]
    assert talk.station.data == data
    assert talk.station.anomalies.counts == {row: 2}
    (told,) = talk.station.anomalies.take()
    assert (told.number, told.raw) == (row, data)
    assert talk.station.anomalies.take() == []


@pytest.mark.parametrize(("name", "question", "data", "value"), PLAIN)
def test_the_recommended_form_is_no_anomaly(
    name: str, question: str, data: str, value: Value
) -> None:
    talk = Talk((question, f"A{question[1:]}{data}"))
    assert talk.do(read(name)) == value  # type: ignore[arg-type]
    assert talk.station.anomalies.counts == {}


def test_a_station_is_told_of_by_itself_whatever_others_have_said() -> None:
    """What an answer means is remembered once for all stations; who said it is not."""
    for _ in range(2):
        talk = Talk(("RPE1", "APE180000"))
        talk.do(read("port_error"))  # type: ignore[arg-type]
        assert [one.number for one in talk.station.anomalies.take()] == [28]


def test_each_answer_with_swapped_addresses_is_counted() -> None:
    answer = framed("ATT100183", 0, 1)
    talk = Talk(("RTT1", answer), ("RTT1", answer), ("RTT1", answer))
    steps = [lambda station: station.read(TIP, 1)] * 3
    assert talk.each(*steps) == [183] * 3
    assert talk.station.anomalies.counts == {6: 3}
    assert [one.raw for one in talk.station.anomalies.take()] == ["0001ATT100183"]


@pytest.mark.parametrize(("text", "count"), [("NTT100004", {}), ("N00004", {11: 1})])
def test_a_refusal_may_leave_out_what_it_refuses(text: str, count: dict[int, int]) -> None:
    talk = Talk(("RTT1", text))
    assert outcome(talk, lambda station: station.read(TIP, 1)) is NotSupported
    assert talk.station.anomalies.counts == count


# -- R-TT ------------------------------------------------------------------------------------------

TRANSFORMER = read("transformer_temperature")


@pytest.mark.parametrize(
    ("answer", "count"), [("ATT00045", {}), ("ATT 00045", {10: 1}), ("ATT000045", {10: 1})]
)
def test_the_transformer_s_answer_may_be_padded(answer: str, count: dict[int, int]) -> None:
    talk = Talk(("RTT", answer))
    assert talk.do(TRANSFORMER) == 45  # type: ignore[arg-type]
    assert talk.station.anomalies.counts == count


@pytest.mark.parametrize(
    ("refusal", "bare"), [("NTT 00004", 1), ("NTT00004", 1), ("N00002", 3), ("NTT00002", 3)]
)
def test_the_transformer_is_asked_with_a_blank_once_it_was_refused_bare(
    refusal: str, bare: int
) -> None:
    talk = Talk(replies=lambda text: [refusal if text == "RTT" else "ATT 00045"])
    assert talk.each(TRANSFORMER, TRANSFORMER) == [45, 45]  # type: ignore[arg-type]
    assert talk.end.heard == ["RTT"] * bare + ["RTT "] * 2
    assert talk.station.anomalies.counts[10] >= 2


@pytest.mark.parametrize("answers", [["NTT00004"], ["NTT00002"], []])
def test_a_transformer_that_is_understood_in_neither_form_is_not_supported(
    answers: list[Answer],
) -> None:
    talk = Talk(replies=lambda text: ["ASMN  ALE"] if text == "RSMN" else answers)
    assert outcome(talk, TRANSFORMER) is NotSupported
    assert talk.end.heard.count("RTT ") == 1


def test_a_transformer_that_was_answered_bare_is_never_asked_with_a_blank() -> None:
    said: list[list[Answer]] = [["ATT00045"], [], [], []]
    talk = Talk(replies=lambda text: ["ASMN  ALE"] if text == "RSMN" else said.pop(0))
    talk.do(TRANSFORMER)  # type: ignore[arg-type]
    with pytest.raises(StationError):
        talk.do(TRANSFORMER)  # type: ignore[arg-type]
    assert "RTT " not in talk.end.heard


# -- R-DC that is answered as R-CD is (B-36) -------------------------------------------------------


def read_dispensed(station: Station) -> Steps[Value]:
    return station.read(DISPENSED, 1)


def read_desoldered(station: Station) -> Steps[Value]:
    return station.read(CYCLES, 1)


def test_dispensed_cycles_under_the_other_letters_are_believed_when_said_twice() -> None:
    talk = Talk(("RDC1", "ACD100042"), PROBE, ("RDC1", "ACD100042"))
    assert talk.do(read_dispensed) == 42
    assert talk.station.data == "00042"
    assert talk.station.anomalies.counts == {36: 1}
    asked, probed, _ = talk.end.moments
    assert probed - asked > LINK_QUIET_S  # the line was drained


def test_a_repeated_answer_to_the_question_before_is_no_count_of_dispensed_cycles() -> None:
    """The attack: R-CD is answered twice, and the second copy comes while R-DC is out."""
    twice = framed("ACD100777") + framed("ACD100777")[:0]
    for late_s in (0.017, 0.020, 0.030, 0.050, 0.080):
        talk = Talk(("RCD1", twice, (late_s, "ACD100777")), ("RDC1", (0.1, "ADC100042")))
        assert talk.each(read_desoldered, read_dispensed) == [777, 42], late_s
        assert talk.station.anomalies.counts == {}


def test_a_late_answer_to_the_question_before_is_no_count_of_dispensed_cycles() -> None:
    """The attack: the answers to R-CD come after everybody has given them up, whatever is asked
    meanwhile.
    """
    for step in range(120):
        late_s = 0.05 + 0.021 * step
        said = {
            "RCD1": "ACD100777",
            "RDC1": "ADC100042",
            "RSMN": "ASMN  ALE",
            "RSER": "ASER00000",
            "RMAT": "AMAT00500",
        }

        def replies(text: str, late_s: float = late_s, said: dict[str, str] = said) -> list[Answer]:
            return [(late_s, said[text])] if text == "RCD1" else [said[text]]

        talk = Talk(replies=replies)
        found: list[object] = []

        async def steps(station: Station, found: list[object] = found) -> None:
            for ask in (read_desoldered, read_dispensed, read_dispensed):
                try:
                    found.append(await ask(station))
                except StationError as error:
                    found.append(type(error))

        talk.do(steps)
        assert set(found[1:]) <= {42} | {one for one in found if isinstance(one, type)}, (
            f"{late_s:.3f} s late: {found}"
        )
        assert 36 not in talk.station.anomalies.counts


@pytest.mark.parametrize("late_s", [0.018, 0.025, 0.035])
def test_a_copy_that_comes_behind_another_question_is_not_believed_either(late_s: float) -> None:
    """It is taken for a first answer, asked again behind a drained line, and contradicted."""
    tip: tuple[str, Answer, Answer] = ("RTT1", "ATT100350", (late_s, "ACD100777"))
    talk = Talk(
        ("RCD1", "ACD100777"), tip, ("RDC1", (0.03, "ADC100042")), PROBE, ("RDC1", "ADC100042")
    )
    assert talk.each(read_desoldered, lambda station: station.read(TIP, 1), read_dispensed) == [
        777,
        350,
        42,
    ]
    assert talk.station.anomalies.counts == {}


def test_a_station_that_has_answered_under_its_own_letters_is_not_believed_under_others() -> None:
    talk = Talk(
        ("RDC1", "ADC100042"),
        ("RTT1", "ATT100350"),
        ("RDC1", "ACD100777"),
        PROBE,
        ("RDC1", "ACD100777"),
        PROBE,
        ("RDC1", "ADC100043"),
    )
    assert talk.each(read_dispensed, lambda station: station.read(TIP, 1), read_dispensed) == [
        42,
        350,
        43,
    ]
    assert talk.station.anomalies.counts == {}


def test_two_different_counts_under_the_other_letters_are_none() -> None:
    talk = Talk(("RDC1", "ACD100041"), PROBE, ("RDC1", "ACD100042"), PROBE, ("RDC1", "ACD100043"))
    assert outcome(talk, read_dispensed) is not int
    assert talk.station.anomalies.counts == {}


def test_another_port_s_count_is_never_taken() -> None:
    talk = Talk(replies=lambda text: ["ASMN  ALE"] if text == "RSMN" else ["ACD200042"])
    assert outcome(talk, read_dispensed) is AnswerFormat


# -- acknowledgements ------------------------------------------------------------------------------


def write_delay(name: str) -> object:
    return lambda station: station.write(ALE[name], 1.6, 1)


def test_the_upper_delay_may_be_acknowledged_as_the_lower_one() -> None:
    talk = Talk(("WHD101.60", "ALD1"))
    talk.do(write_delay("alarm_high_delay"))  # type: ignore[arg-type]
    assert talk.station.anomalies.counts == {53: 1}


@pytest.mark.parametrize("answer", ["ALD2", "ALD101.60", "ALA1"])
def test_nothing_else_acknowledges_the_upper_delay(answer: str) -> None:
    talk = Talk(("WHD101.60", answer))
    assert outcome(talk, write_delay("alarm_high_delay")) is AnswerFormat
    assert talk.station.anomalies.counts == {}


def test_the_lower_delay_is_not_acknowledged_as_the_upper_one() -> None:
    talk = Talk(("WLD101.60", "AHD1"))
    assert outcome(talk, write_delay("alarm_low_delay")) is AnswerFormat


@pytest.mark.parametrize("lower", [[], ["ALD1", (0.02, "ALD1")]], ids=["lost", "repeated"])
def test_a_late_acknowledgement_of_the_lower_delay_is_none_of_the_upper_one(
    lower: list[Answer],
) -> None:
    """The attack: W-LD is out, or was answered twice, when the upper delay is written."""
    talk = Talk(("WLD101.60", *lower), ("WHD101.60", (0.01, "ALD1")))
    for name in ("alarm_low_delay", "alarm_high_delay"):
        outcome_ = outcome_of_step(talk, name)
    assert outcome_ is AnswerFormat
    assert talk.station.anomalies.counts == {}


def outcome_of_step(talk: Talk, name: str) -> object:
    turns, talk.turns = talk.turns[1:], talk.turns[:1]
    found = outcome(talk, write_delay(name))
    talk.turns = turns
    return found


@pytest.mark.parametrize(
    ("answer", "taken"), [("APS100001", True), ("APS100000", False), ("APS1", True)]
)
def test_a_status_may_be_acknowledged_with_its_own_value(answer: str, taken: bool) -> None:
    talk = Talk(("WPS100001", answer))
    found = outcome(talk, lambda station: station.write(ALE["status"], (0, 0, 0, 0, 1), 1))
    assert found is (None if taken else AnswerFormat)
    assert talk.station.anomalies.counts == ({43: 1} if answer == "APS100001" else {})


def test_a_reading_that_comes_late_does_not_acknowledge_the_status_that_is_written() -> None:
    """The attack: a reading of the same state is under way when the state is ordered, and looks
    like the order's answer.
    """
    talk = Talk(replies=lambda text: ["APS100001"] if text[0] == "W" else [])
    assert outcome(talk, read("status")) is StationSilent
    assert (
        outcome(talk, lambda station: station.write(ALE["status"], (0, 0, 0, 0, 1), 1))
        is AnswerFormat
    )
    assert talk.station.anomalies.counts == {}


# -- what is sent again ----------------------------------------------------------------------------


@pytest.mark.parametrize("refusal", ["NST100001", "N00001", "NST100002"])
def test_a_setting_that_was_not_understood_is_sent_again(refusal: str) -> None:
    talk = Talk(("WST100350", refusal), ("WST100350", "AST1"))
    talk.do(lambda station: station.write(ALE["selected_temperature"], 350, 1))


def test_a_setting_goes_out_three_times_at_most() -> None:
    talk = Talk(replies=lambda text: ["NST100001"])
    assert (
        outcome(talk, lambda station: station.write(ALE["selected_temperature"], 350, 1))
        is NotReceived
    )
    assert talk.end.heard == ["WST100350"] * 3


@pytest.mark.parametrize(
    "order", ["start_feeding", "restart", "factory_reset", "store", "stop_feeding"]
)
@pytest.mark.parametrize("number", [1, 3, 4, 99999])
def test_an_order_that_was_refused_is_not_sent_again(order: str, number: int) -> None:
    letters = ALE[order].letters
    talk = Talk((f"W{letters}00000", f"N{letters}{number:05d}"))
    assert issubclass(outcome(talk, lambda station: station.write(ALE[order], 0)), Refusal)  # type: ignore[arg-type]


@pytest.mark.parametrize("order", ["start_feeding", "restart", "factory_reset", "store"])
def test_what_acts_or_erases_is_never_tried_in_another_form(order: str) -> None:
    letters = ALE[order].letters
    talk = Talk((f"W{letters}00000", f"N{letters}00002"))
    assert outcome(talk, lambda station: station.write(ALE[order], 0)) is NotReceived


@pytest.mark.parametrize(
    ("command", "letters"), [(ALE["stop_feeding"], "STP"), (UCR["ignore_fuse_error"], "IFE")]
)
def test_other_orders_are_sent_without_data_once_that_was_badly_formed(
    command: object, letters: str
) -> None:
    talk = Talk(
        (f"W{letters}00000", f"N{letters}00002"),
        (f"W{letters}", f"A{letters}"),
        (f"W{letters}", f"A{letters}"),
    )
    steps = [lambda station: station.write(command, 0)] * 2
    talk.each(*steps)
    assert talk.station.anomalies.counts == {37: 2}


def test_a_read_that_is_refused_for_no_reason_is_asked_once_more() -> None:
    talk = Talk(("RTT1", "NTT199999"), ("RTT1", "ATT100183"))
    assert talk.do(lambda station: station.read(TIP, 1)) == 183
    talk = Talk(("RTT1", "NTT199999"), ("RTT1", "NTT199999"))
    assert outcome(talk, lambda station: station.read(TIP, 1)) is Refusal


# -- bad frames, and how long is waited ------------------------------------------------------------

GOOD = framed("ATT100183")
BAD = GOOD[:8] + bytes([GOOD[8] ^ 4]) + GOOD[9:]
SHORT_BAD = b"\x02NOISE\x03\x55"


@pytest.mark.parametrize(
    "bad", [BAD, SHORT_BAD, BAD + BAD], ids=["as long as the answer", "short", "two"]
)
@pytest.mark.parametrize("later_s", [0.0, 0.005, 0.02])
def test_a_good_answer_behind_a_bad_frame_is_taken(bad: bytes, later_s: float) -> None:
    answers: list[Answer] = [bad + GOOD] if later_s == 0 else [bad, (0.016 + later_s, GOOD)]
    talk = Talk(("RTT1", *answers))
    assert talk.do(lambda station: station.read(TIP, 1)) == 183


def test_after_a_bad_answer_nobody_waits_for_another() -> None:
    """A tick has no time for that; the probe of another code sees to an answer that comes all the
    same.
    """
    talk = Talk(("RTT1", BAD), PROBE, ("RTT1", "ATT100183"))
    assert talk.do(lambda station: station.read(TIP, 1)) == 183
    asked, probed, _ = talk.end.moments
    assert probed - asked < LEAST_S / 2


def test_a_station_that_answers_ever_later_does_not_stretch_every_wait() -> None:
    station = Station(Talk().station.line)
    question = station.question(TIP, 1)
    for seen_s in (0.4, 0.6, 3.0, 60.0):
        station.turnaround_s = seen_s
        assert station.patience_s(question) - question.wire_s <= MOST_S
