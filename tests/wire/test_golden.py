"""Every frame and every example that the manuals print, read and written byte for byte."""

from __future__ import annotations

import pytest
from golden import Golden, seed_000, seed_002, seed_004, with_check_byte

from jbclog.commands.command import Command
from jbclog.commands.family import FAMILIES, Family
from jbclog.protocol.frame import Frame
from jbclog.protocol.reader import FrameReader

ALL = [*seed_000.FRAMES, *seed_002.FRAMES, *seed_004.FRAMES]
FAMILIES_OF = {"000": ("soldering",), "002": ("dde", "nae", "dme", "hde", "ucr", "ale"), "004": ("ucr",)}

every = pytest.mark.parametrize("golden", ALL, ids=lambda golden: f"{golden.where} {golden.text}")


def _commands(golden: Golden) -> list[tuple[Family, Command]]:
    families = [FAMILIES[name] for name in FAMILIES_OF[golden.seed]]
    return [(family, family.commands[golden.command]) for family in families if golden.command in family.commands]


def _code(golden: Golden, command: Command) -> str:
    return command.code(golden.port, golden.tool)


def test_the_two_frames_that_are_printed_whole() -> None:
    """ "Sending code: 0230303031574D41543030333735033E" and "02574D41543030333735033F" (seeds 002 and 004, "Examples")."""
    with_addresses = bytes.fromhex("0230303031574D41543030333735033E")
    without = bytes.fromhex("02574D41543030333735033F")
    assert FrameReader().feed(with_addresses) == [Frame("W", "MAT00375", 0, 1)]
    assert FrameReader().feed(without) == [Frame("W", "MAT00375")]
    assert Frame("W", "MAT00375", 0, 1).encode() == with_addresses
    assert Frame("W", "MAT00375").encode() == without
    assert [golden.addressed for golden in ALL if golden.text == "WMAT00375"] == [with_addresses] * 3


@every
def test_the_check_byte_is_the_xor_of_all_before_it(golden: Golden) -> None:
    assert with_check_byte(golden.bare[:-1]) == golden.bare


@every
def test_it_is_read(golden: Golden) -> None:
    header, text = golden.text[0], golden.text[1:]
    pair = (0, 1) if header in "RW" else (1, 0)
    for wire, addresses in ((golden.bare, (None, None)), (golden.addressed, pair)):
        reader = FrameReader()
        assert reader.feed(wire) == [Frame(header, text, *addresses)]
        assert reader.garbage == 0
        assert reader.reset() == 0


@every
def test_it_is_written(golden: Golden) -> None:
    header, text = golden.text[0], golden.text[1:]
    pair = (0, 1) if header in "RW" else (1, 0)
    assert Frame(header, text).encode() == golden.bare
    assert Frame(header, text, *pair).encode() == golden.addressed


@every
def test_the_tables_know_it(golden: Golden) -> None:
    known = _commands(golden)
    assert known
    for _, command in known:
        code = _code(golden, command)
        assert golden.text[1:].startswith(code)
        assert {"R": command.readable, "W": command.writable, "A": True}[golden.text[0]]


@every
def test_its_value_has_its_type(golden: Golden) -> None:
    for _, command in _commands(golden):
        data = golden.text[1 + len(_code(golden, command)) :]
        if golden.value is None:
            assert data in ("", "00000")  # a question, an acknowledgement, an order
            continue
        value = command.quantity.decode(data)
        assert value == golden.value
        assert type(value) is type(golden.value)
        if not golden.written_otherwise:
            assert command.quantity.encode(golden.value) == data


@every
def test_what_is_printed_for_writing_is_within_the_limits(golden: Golden) -> None:
    for _, command in _commands(golden):
        if golden.text[0] == "W" and golden.value is not None:
            assert command.limits.problem(golden.value) is None


@pytest.mark.parametrize(
    ("seed", "printed"), [(seed, code) for seed in (seed_000, seed_002, seed_004) for code in seed.CODES.split()], ids=str
)
def test_every_code_that_is_printed_is_in_the_tables(seed: object, printed: str) -> None:
    families = [FAMILIES[name] for name in FAMILIES_OF[str(seed.__name__)[-3:]]]  # type: ignore[attr-defined]  # a module
    found = [command for family in families for command in family.commands.values() if printed[1:] in _codes(command)]
    assert found
    assert all({"R": command.readable, "W": command.writable, "A": True}[printed[0]] for command in found)


def _codes(command: Command) -> set[str]:
    """All codes of a command on the ports and tools that the examples use."""
    if command.scope.value == "station":
        return {command.code()}
    return {command.code(port, 2) for port in (1, 3)}


@pytest.mark.parametrize(
    ("wire", "meaning"),
    [
        # digest A.14; the identification is the first command of every run, and its check byte is ETX or STX
        (b"\x02RSMN\x03\x03", Frame("R", "SMN")),
        (b"\x020001RSMN\x03\x02", Frame("R", "SMN", 0, 1)),
        (b"\x020100ASMN JTSE\x03\x39", Frame("A", "SMN JTSE", 1, 0)),
        (b"\x02AA12\x03\x02", Frame("A", "A12")),
        (b"\x020100AA12\x03\x03", Frame("A", "A12", 1, 0)),
        (b"\x020001RMIT\x03\x02", Frame("R", "MIT", 0, 1)),
        (b"\x02RS11\x03\x00", Frame("R", "S11")),
        (b"\x02NTT100004\x03\x4b", None),  # the addressed one's check byte: a misprint must not pass
        (b"\x02NTT100004\x03\x4a", Frame("N", "TT100004")),
        (b"\x02ATT00045\x03\x71", Frame("A", "TT00045")),
    ],
)
def test_completed_frames(wire: bytes, meaning: Frame | None) -> None:
    found = [one for one in FrameReader().feed(wire) if isinstance(one, Frame)]
    assert found == ([] if meaning is None else [meaning])
