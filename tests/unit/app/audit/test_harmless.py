"""The port of an audit lets nothing out but questions that change nothing, whoever asks."""

from __future__ import annotations

import pytest

from jbclog.app.audit.questions import harmless_for
from jbclog.protocol.commands.family import FAMILIES
from support.clients.talk import framed

DDE, OMEGA = FAMILIES["dde"], FAMILIES["omega"]


@pytest.mark.parametrize("text", ["RSMN", "RCW1", "RCP4", "RA12", "RHA1", "RTT", "RSER"])
@pytest.mark.parametrize("address", [1, None])
def test_questions_go_out(text: str, address: int | None) -> None:
    target = 0 if address is None else address
    assert harmless_for(DDE)(framed(text, None if address is None else 0, target))
    assert harmless_for(None)(framed(text, None if address is None else 0, target))


@pytest.mark.parametrize(
    "text",
    [
        "RTA1",
        "RTA2",
        "RTA3",
        "RTA4",
        "WST100350",
        "WPS100000",
        "WRSP00000",
        "ATT100183",
        "H0101",
        "",
    ],
)
@pytest.mark.parametrize("family", [DDE, None, FAMILIES["soldering"], FAMILIES["jtse"], OMEGA])
def test_nothing_else_does(text: str, family: object) -> None:
    for frame in (framed(text, 0, 1), framed(text, None)):
        assert not harmless_for(family)(frame)  # type: ignore[arg-type]  # a family, or None


def test_omega_is_asked_what_it_tells_and_told_nothing() -> None:
    # manual 003, 11.3.1: the sum of one character is its code
    assert harmless_for(OMEGA)(b"\x02A\x0341")
    assert not harmless_for(OMEGA)(b"\x02H0065\x0313")
