"""A port opened for reading only lets questions pass and nothing else, whoever sends it."""

from __future__ import annotations

import pytest

from support.links.far_ends import terminal
from support.product import LineFormat, Port, ReadOnly, WriteForbidden, only_reads, open_port

MODEL = b"\x02RSMN\x03\x03"  # 002, R-SMN, without addresses
MAXIMUM = b"\x02" + b"0001" + b"WMAT00375" + b"\x03\x3e"  # 002, "Examples": W-MAT 375 from 00 to 01


def test_a_question_goes_out_and_its_answer_comes_back() -> None:
    with terminal() as far:
        plain = open_port(far.url, LineFormat())
        port: Port = ReadOnly(plain, only_reads)
        assert (port.url, port.fileno()) == (plain.url, plain.fileno())
        port.write(MODEL)
        assert far.heard() == MODEL
        far.say(b"\x02ASMN  DDE\x03\x00")
        heard = port.read(1.0)
        while len(heard) < 12:
            heard += port.read_now()
        port.close()
        port.close()
    assert heard == b"\x02ASMN  DDE\x03\x00"


@pytest.mark.parametrize(
    "data",
    [
        MAXIMUM,
        b"\x02WNVS00000\x03\x2d",
        b"\x02WRST\x03\x02",
        MODEL + MAXIMUM,  # a write behind a read
        MAXIMUM + MODEL,
        b"\x02RSMN" + MAXIMUM,
        MODEL[:-1],
        b"\x02RSMN\x03\x02",  # a wrong check byte
        b"\x02RS\x02WRST\x03\x02\x03"
        + bytes([0x52 ^ 0x53 ^ 0x02 ^ 0x57 ^ 0x52 ^ 0x53 ^ 0x54 ^ 0x03 ^ 0x02 ^ 0x02 ^ 0x03]),
        b"\x02ASMN  DDE\x03\x00",
        b"\x00",
        b"",
    ],
)
def test_all_else_is_refused_and_not_a_byte_of_it_is_sent(data: bytes) -> None:
    with terminal() as far:
        port = ReadOnly(open_port(far.url, LineFormat()), only_reads)
        with pytest.raises(WriteForbidden, match="open for reading only"):
            port.write(data)
        port.write(MODEL)
        assert far.heard() == MODEL
        port.close()


def test_what_a_question_is_the_caller_says() -> None:
    with terminal() as far:
        # 003: OMEGA's information request
        port = ReadOnly(open_port(far.url, LineFormat()), lambda data: data == b"\x02A\x0341")
        port.write(b"\x02A\x0341")
        assert far.heard() == b"\x02A\x0341"
        with pytest.raises(WriteForbidden):
            port.write(MODEL)
        port.close()
