"""What a scan may send: by the tables, and never what clears, writes or moves."""

from __future__ import annotations

import pytest

from support.clients.talk import framed
from support.product import FAMILIES, ROBOT_PROTOCOL, Effect, Scope, is_harmless, question_text

HOST = {"source": 0, "target": 1}


@pytest.mark.parametrize(
    "family",
    [family for family in FAMILIES.values() if family.protocol == ROBOT_PROTOCOL],
    ids=lambda one: one.name,
)
def test_exactly_the_reads_that_change_nothing(family: object) -> None:
    from support.product import Family

    assert isinstance(family, Family)
    for command in family.commands.values():
        if command.scope is Scope.TOOL:
            continue
        code = command.code(None if command.scope is Scope.STATION else 1)
        may = command.readable and command.effect is Effect.NONE
        assert is_harmless(framed(f"R{code}", **HOST)) is may, command.name
        assert is_harmless(framed(f"R{code}", source=None)) is may
        assert not is_harmless(framed(f"W{code}00000", **HOST))


def test_alarm_flags_are_not_read_because_that_clears_them() -> None:
    assert not is_harmless(framed("RTA1", **HOST))  # manual 000, 4.8.27


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"\x020001RSMN\x03\x02", "model, to address 01"),
        (b"\x02RSMN\x03\x03", "model, without addresses"),
        (b"\x02RCT2\x03\x76", "tool of port 2, without addresses"),
        (b"\x02A\x0341", "information"),  # 003, 11.3.1
    ],
)
def test_questions_have_names(data: bytes, text: str) -> None:
    assert question_text(data) == text


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x020001RSMN\x03\x03",  # wrong check byte
        b"\x020001RSMN\x03\x02\x02",
        b"\x020001RXYZ\x03"
        + bytes(
            [0x02 ^ 0x31 ^ 0x30 ^ 0x30 ^ 0x30 ^ ord("R") ^ ord("X") ^ ord("Y") ^ ord("Z") ^ 0x03]
        ),
        b"\x02D0065\x030F",  # OMEGA: writes a condition
        b"\x02H0065\x0313",  # OMEGA: runs one
        b"RSMN",
    ],
)
def test_all_else_is_none(data: bytes) -> None:
    assert question_text(data) is None
