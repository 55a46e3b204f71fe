"""What a receiver makes of another's characters, by the rules of asynchronous lines."""

from __future__ import annotations

import pytest

from jbclog.core.serial_line import BAUDRATES, LineFormat
from jbclog.sim.links import heard

QUESTION = b"\x020001RSMN\x03\x02"  # manual 002, R-SMN; addressed 00 to 01
FORMATS = [LineFormat(19200, f"8{parity}{stops}") for parity in "NEO" for stops in "12"]


@pytest.mark.parametrize("baudrate", BAUDRATES)
def test_the_same_rate_and_parity_hear_each_other_whatever_the_stop_bits(baudrate: int) -> None:
    for parity in "NEO":
        one, other = LineFormat(baudrate, f"8{parity}1"), LineFormat(baudrate, f"8{parity}2")
        assert heard(QUESTION, one, other) == heard(QUESTION, other, one) == QUESTION


@pytest.mark.parametrize("sender", BAUDRATES)
def test_another_rate_is_never_understood(sender: int) -> None:
    for receiver in BAUDRATES:
        for keeps in (False, True) if sender != receiver else ():
            assert QUESTION not in heard(
                QUESTION, LineFormat(sender), LineFormat(receiver), keeps_errors=keeps
            )


def test_the_next_standard_rate_is_garbage_and_not_silence() -> None:
    assert heard(b"\x15", LineFormat(38400), LineFormat(19200), keeps_errors=True) != b""


def test_half_the_rate_doubles_each_bit() -> None:
    """F0h at 9600: start, four 0s, four 1s, stop. At 19200: start and eight 0s, the tenth bit is
    still 0.
    """
    assert heard(b"\xf0", LineFormat(9600), LineFormat(19200), keeps_errors=True) == b"\x00"
    assert heard(b"\xf0", LineFormat(9600), LineFormat(19200)) == b""


@pytest.mark.parametrize("sender", FORMATS)
def test_a_careful_receiver_of_another_parity_does_not_understand(sender: LineFormat) -> None:
    for receiver in FORMATS:
        if receiver.parity != sender.parity:
            assert heard(QUESTION, sender, receiver) != QUESTION


def test_a_host_that_does_not_look_at_parity_hears_all_the_same() -> None:
    """8E1 heard as 8N1: the parity bit stands where the stop bit belongs, which Linux does not mind
    unless told to.
    """
    assert heard(QUESTION, LineFormat(format="8E1"), LineFormat(), keeps_errors=True) == QUESTION


def test_parity_as_it_is_reckoned() -> None:
    """'A' has two ones: even parity 0, odd 1. Heard without parity, odd looks like a stop bit and
    even does not.
    """
    assert heard(b"A", LineFormat(format="8O1"), LineFormat()) == b"A"
    assert heard(b"A", LineFormat(format="8E1"), LineFormat()) == b""
    assert heard(b"C", LineFormat(format="8E1"), LineFormat()) == b"C"


def test_a_spike_is_no_character() -> None:
    assert heard(b"\xff", LineFormat(500000), LineFormat(1200), keeps_errors=True) == b""
