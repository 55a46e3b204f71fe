"""Quirks by name: deviations of a station from the recommended form where the manuals contradict
each other.

A line file selects them: ``[station.sim] quirks = ["addresses_swapped", "hex_with_0x"]``. Each is
the alternative of one row of docs/reference/contradictions.md: it changes requests, answers,
addresses or the initial physics, but no values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from jbclog.core.quantities import OFF_ON_WIRE
from jbclog.sim.plant import Plant, TableRequest
from jbclog.sim.port import ToolSettings, ToolState
from jbclog.sim.soldering import SolderingPlant
from jbclog.sim.tip import Comparator

WRONG_FORMAT, OUT_OF_RANGE = 2, 3
UNDEFINED = "99999"  # the undefined communication error


class ParsedRequest(NamedTuple):
    """An accepted request, and the characters after its header."""

    asked: TableRequest
    text: str

    @property
    def name(self) -> str:
        return self.asked.command.name

    @property
    def data(self) -> str:
        return self.text[len(self.asked.code) :]


Addresses = tuple[int | None, int | None]
"""Source and target; both None in a frame without addresses."""

Hear = Callable[[str], str | int]
"""Maps a request (header, code, data) to the one that the station processes, or to a communication
error.
"""

Say = Callable[[ParsedRequest, str], str | None]
"""Maps the characters after the A of an answer to those sent; None is silence."""


@dataclass(frozen=True, slots=True)
class Quirk:
    """One deviation; a field that is None keeps the recommended form. `number` is its B-number.

    `addresses` returns those of an answer, given the usual ones, the station's present address, and
    whether the answer acknowledges a change of address. `undefined`: the digits of the undefined
    error, in place of 99999.
    """

    number: int
    hear: Hear | None = None
    say: Say | None = None
    addresses: Callable[[Addresses, int | None, bool], Addresses] | None = None
    begin: Callable[[Plant], None] | None = None
    bare_refusals: bool = False
    undefined: str | None = None
    refuses_others: bool = False


def _data(change: Callable[[str], str], *commands: str) -> Say:
    """Change the data field of the answers to reads of `commands`."""

    def say(turn: ParsedRequest, text: str) -> str:
        code = turn.asked.code
        data = text[len(code) :]
        return code + change(data) if turn.name in commands and data else text

    return say


def _when(data: str, other: str) -> Callable[[str], str]:
    return lambda found: other if found == data else found


def _flags_of_any_digit(data: str) -> str:
    return data.translate(str.maketrans("1", "7"))


def _hex(form: str) -> Callable[[str], str]:
    return lambda data: form.format(int(data, 16))


def _under(letters: str, other: str, *, acknowledgement: bool) -> Say:
    """Send answers under `letters` with `other` letters: the acknowledgements, or the values."""

    def say(turn: ParsedRequest, text: str) -> str:
        is_acknowledgement = text == turn.asked.code
        meant = text.startswith(letters) and is_acknowledgement == acknowledgement
        return other + text[len(letters) :] if meant else text

    return say


def _silence_after_restart(turn: ParsedRequest, text: str) -> str | None:
    return None if turn.name == "restart" else text


def _status_with_value(turn: ParsedRequest, text: str) -> str:
    return turn.text if turn.name == "status" and text == turn.asked.code else text


_ORDERS = re.compile(r"W(STR|STP|RST|RSP|IFE)00000")
_EXTRACTOR = re.compile(r"WPS\d00010")


def _transformer_with_blank(question: str) -> str | int:
    if question == "RTT":
        return WRONG_FORMAT
    return "RTT" if question == "RTT " else question


def _orders_without_data(question: str) -> str | int:
    return WRONG_FORMAT if _ORDERS.fullmatch(question) else question


def _no_extractor(question: str) -> str | int:
    return OUT_OF_RANGE if _EXTRACTOR.fullmatch(question) else question


def _swapped(usual: Addresses, _own: int | None, _moves: bool) -> Addresses:
    return usual[::-1]


def _from_new_address(usual: Addresses, own: int | None, moves: bool) -> Addresses:
    if not moves:
        return usual
    return (None, None) if own is None else (own, usual[1] or 0)


def _from_nowhere(usual: Addresses, _own: int | None, moves: bool) -> Addresses:
    return (None, None) if moves else usual


class _CountsSeconds(ToolState):
    """Counts its delays in seconds instead of minutes."""

    __slots__ = ()

    def due(self, delays: ToolSettings) -> float:
        return self.began + (ToolState.due(self, delays) - self.began) / 60


class _LatchedWhileBeyond(Comparator):
    """Stays latched while the temperature is beyond the limit, even after reading."""

    __slots__ = ()

    def take(self) -> bool:
        was, self.latched = self.latched, self.latched and self.since is not None
        return was


def _delays_in_seconds(face: Plant) -> None:
    if isinstance(face, SolderingPlant):
        for port in face.station.ports.values():
            port.doing = _CountsSeconds(port.now)
            port.changed()


def _flags_stay(face: Plant) -> None:
    """Keep flags latched until the tool is exchanged, or the station restarts."""
    if isinstance(face, SolderingPlant):
        for port in face.station.ports.values():
            port.high, port.low = _LatchedWhileBeyond(), _LatchedWhileBeyond()


_DELAYS = ("alarm_high_delay", "alarm_low_delay")
_LIMITS = ("alarm_high_limit", "alarm_low_limit")

QUIRKS: Mapping[str, Quirk] = MappingProxyType(
    {
        "minus_as_dot": Quirk(3, say=_data(lambda data: data.replace("-", "."), "adjust")),
        "software_in_ten_characters": Quirk(
            5, say=_data(lambda data: data.rjust(10), "software_version")
        ),
        "addresses_swapped": Quirk(6, addresses=_swapped),
        "address_acknowledged_from_the_new_one": Quirk(9, addresses=_from_new_address),
        "address_acknowledged_without_any": Quirk(9, addresses=_from_nowhere),
        "transformer_padded_with_blank": Quirk(
            10, say=_data(lambda data: " " + data, "transformer_temperature")
        ),
        "transformer_padded_with_zero": Quirk(
            10, say=_data(lambda data: "0" + data, "transformer_temperature")
        ),
        "transformer_wants_blank": Quirk(10, hear=_transformer_with_blank),
        "refusal_without_code": Quirk(11, bare_refusals=True),
        "refuses_other_addresses": Quirk(14, refuses_others=True),
        "extractor_refused": Quirk(19, hear=_no_extractor),
        "sleep_delay_in_seconds": Quirk(20, begin=_delays_in_seconds),
        "delay_without_dot": Quirk(
            22, say=_data(lambda data: data.replace(".", "").rjust(5, "0"), *_DELAYS)
        ),
        "alarm_not_set_is_zero": Quirk(23, say=_data(_when(OFF_ON_WIRE, "00000"), *_LIMITS)),
        "alarm_not_set_is_out_of_range": Quirk(
            23, say=_data(_when(OFF_ON_WIRE, "00999"), *_LIMITS)
        ),
        "alarm_flags_of_any_digit": Quirk(24, say=_data(_flags_of_any_digit, "alarm_flags")),
        "alarm_flags_stay": Quirk(24, begin=_flags_stay),
        "countdown_65535": Quirk(25, say=_data(_when(OFF_ON_WIRE, "65535"), "time_to_sleep")),
        "countdown_zero": Quirk(25, say=_data(_when(OFF_ON_WIRE, "00000"), "time_to_sleep")),
        "port_error_80000": Quirk(28, say=_data(_when("00008", "80000"), "port_error")),
        "power_above_full": Quirk(32, say=_data(_when("01000", "01037"), "power")),
        "six_letter_model": Quirk(34, say=_data(lambda data: (data.strip() + "-2A")[:6], "model")),
        "model_cut_to_five": Quirk(34, say=_data(lambda data: data.strip()[:5], "model")),
        "model_unpadded": Quirk(34, say=_data(str.strip, "model")),
        "model_with_type": Quirk(34, say=_data(lambda data: data.strip() + "_CAP_01", "model")),
        "hex_with_0x": Quirk(35, say=_data(_hex("0x{:011X}"), "dispensed_length")),
        "hex_lower_case": Quirk(35, say=_data(_hex("{:05x}"), "dispensed_length")),
        "hex_of_eight": Quirk(35, say=_data(_hex("{:08X}"), "dispensed_length")),
        "dispensed_cycles_answers_acd": Quirk(36, say=_under("DC", "CD", acknowledgement=False)),
        "no_data_orders": Quirk(37, hear=_orders_without_data),
        "silent_after_restart": Quirk(40, say=_silence_after_restart),
        "status_acknowledged_with_value": Quirk(43, say=_status_with_value),
        "alarm_delay_answers_ald": Quirk(53, say=_under("HD", "LD", acknowledgement=True)),
        "undefined_error_255": Quirk(54, undefined="00255"),
    }
)


class Quirks:
    def __init__(self, names: Sequence[str] = ()) -> None:
        self._quirks = [QUIRKS[name] for name in names]
        self.refuses_others = any(quirk.refuses_others for quirk in self._quirks)
        self._bare_refusals = any(quirk.bare_refusals for quirk in self._quirks)
        other = [quirk.undefined for quirk in self._quirks if quirk.undefined is not None]
        self._undefined = other[0] if other else UNDEFINED

    def begin(self, face: Plant) -> None:
        for quirk in self._quirks:
            if quirk.begin is not None:
                quirk.begin(face)

    def hear(self, question: str) -> str | int:
        """Return the request as the station interprets it, or the communication error of its
        refusal.
        """
        heard: str | int = question
        for quirk in self._quirks:
            if quirk.hear is not None and isinstance(heard, str):
                heard = quirk.hear(heard)
        return heard

    def say(self, asked: TableRequest, question: str, text: str) -> str | None:
        """Return the text after the A in the answer to `question` (code, data); None is silence."""
        answer_text: str | None = text
        for quirk in self._quirks:
            if quirk.say is not None and answer_text is not None:
                answer_text = quirk.say(ParsedRequest(asked, question), answer_text)
        return answer_text

    def refusal(self, text: str) -> str:
        """Return the text after the N of a refusal."""
        code, digits = text[:-5], text[-5:]
        if digits == UNDEFINED:
            digits = self._undefined
        return digits if self._bare_refusals else code + digits

    def addresses(self, usual: Addresses, own: int | None, *, moves: bool) -> Addresses:
        """Return source and target of an answer; `moves`: it acknowledges a change of address."""
        for quirk in self._quirks:
            if quirk.addresses is not None:
                usual = quirk.addresses(usual, own, moves)
        return usual
