"""What a receiver reads of what is sent at another rate or parity."""

from __future__ import annotations

import pytest

from jbclog.core.serial_line import BAUDRATES, LineFormat
from jbclog.sim.links import heard

QUESTION = b"\x020001RSMN\x03\x02"  # manual 002, R-SMN; addressed 00 to 01


@pytest.mark.parametrize("baudrate", BAUDRATES)
def test_the_same_rate_and_parity_understand_each_other_whatever_the_stop_bits(
    baudrate: int,
) -> None:
    for parity in "NEO":
        short, long = LineFormat(baudrate, f"8{parity}1"), LineFormat(baudrate, f"8{parity}2")
        assert heard(QUESTION, short, long) == heard(QUESTION, long, short) == QUESTION


@pytest.mark.parametrize("baudrate", [one for one in BAUDRATES if one != 19200])
def test_at_another_rate_a_station_reads_nothing_and_a_host_three_junk_bytes(baudrate: int) -> None:
    assert heard(QUESTION, LineFormat(), LineFormat(baudrate)) == b""
    junk = heard(QUESTION, LineFormat(), LineFormat(baudrate), keeps_errors=True)
    assert len(junk) == 3
    assert junk not in QUESTION
    assert heard(b"", LineFormat(), LineFormat(baudrate), keeps_errors=True) == b""


@pytest.mark.parametrize("parity", "EO")
def test_at_another_parity_a_station_reads_nothing_and_a_host_does_not_mind(parity: str) -> None:
    other = LineFormat(format=f"8{parity}1")
    assert heard(QUESTION, LineFormat(), other) == heard(QUESTION, other, LineFormat()) == b""
    assert heard(QUESTION, other, LineFormat(), keeps_errors=True) == QUESTION
