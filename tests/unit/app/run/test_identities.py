"""What a recorder sends its guard as proof of a station, and when it stops."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from jbclog.app.run import identities as identities_itself
from jbclog.app.run.identities import Identities
from jbclog.guard.continuity import Proof
from jbclog.protocol.commands.status import STAND, WORKING

Station = Any  # a `SessionContext`, as far as `Identities` looks at it
OPENED_AT = 50.0


@pytest.fixture
def terminal() -> Iterator[int]:
    far, near = pty.openpty()
    yield near
    os.close(far)
    os.close(near)


def station(**changes: object) -> Station:
    """A station at work, identified after its port was opened."""
    port = SimpleNamespace(number=1, touched=True, status=WORKING, held={})
    state = {
        "ports": {1: port},
        "stranger": None,
        "identity_at": {"model": 60.0, "software_version": 61.0},
        "is_proven": True,
        "has_ordered_status": True,
        "plugged_hours": {1: (1200, 55.0)},
        "facts": SimpleNamespace(family="ucr"),
    }
    return SimpleNamespace(
        name="ucr-1",
        order=SimpleNamespace(url="/dev/ttyUSB0"),
        station=SimpleNamespace(heard=70.0),
        state=SimpleNamespace(**(state | changes)),
    )


def made(context: Station, terminal: int, monkeypatch: pytest.MonkeyPatch) -> Identities:
    monkeypatch.setattr(identities_itself, "elapsed", lambda: OPENED_AT)
    others = [SimpleNamespace(name="jtse-1", family="jtse"), SimpleNamespace(name="ucr-1")]
    found = Identities(SimpleNamespace(stations=others), [context])  # type: ignore[arg-type]
    found.note_opened("ucr-1", SimpleNamespace(fileno=lambda: terminal))  # type: ignore[arg-type]
    return found


def test_a_station_at_work_is_proven_at_its_last_answer(
    terminal: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = made(station(), terminal, monkeypatch)
    (proof,) = found.proofs()
    assert (proof.station, proof.answered_at, proof.statuses) == ("ucr-1", 70.0, {1: WORKING})
    assert proof.hours == {1: (1200, 55.0)}
    assert proof.device.number == os.fstat(terminal).st_rdev
    assert found.families() == ["jtse", "ucr"]  # the one that is not recorded, too


@pytest.mark.parametrize(
    "changes",
    [
        {"is_proven": False},
        {"identity_at": {"model": 60.0, "software_version": 49.0}},  # before this opening
        {"ports": {1: SimpleNamespace(number=1, touched=False, status=WORKING, held={})}},
        {"stranger": "a DDE, not the UCR"},
        {"identity_at": {}},
    ],
)
def test_nothing_is_proven_without_an_identity_since_the_port_was_opened(
    terminal: int, monkeypatch: pytest.MonkeyPatch, changes: dict[str, object]
) -> None:
    assert made(station(**changes), terminal, monkeypatch).proofs() == []


@pytest.mark.parametrize(
    ("changes", "is_kept"),
    [
        ({"is_proven": False}, True),  # it is away: the last answer counts
        ({"stranger": "a DDE, not the UCR"}, False),
        ({"identity_at": {}}, False),  # signs of another station
    ],
)
def test_the_last_proof_stays_while_a_station_is_away_and_not_once_another_is_there(
    terminal: int, monkeypatch: pytest.MonkeyPatch, changes: dict[str, object], is_kept: bool
) -> None:
    context = station()
    found = made(context, terminal, monkeypatch)
    before = found.proofs()
    assert "ucr-1" in found
    vars(context.state).update(changes)
    context.station.heard = 99.0
    assert found.proofs() == (before if is_kept else [])


@pytest.mark.parametrize(
    ("status", "before", "has_ordered", "known"),
    [
        (None, STAND, False, STAND),  # read at the start
        (None, STAND, True, None),  # ordered since
        (None, None, False, None),
        (WORKING, STAND, True, WORKING),
    ],
)
def test_a_status_that_was_ordered_and_not_read_since_is_not_known(
    terminal: int,
    monkeypatch: pytest.MonkeyPatch,
    status: object,
    before: object,
    has_ordered: bool,
    known: object,
) -> None:
    port = SimpleNamespace(number=1, touched=True, status=status, held={"status": before})
    context = station(ports={1: port}, has_ordered_status=has_ordered)
    (proof,) = made(context, terminal, monkeypatch).proofs()
    assert proof == replace(proof, statuses={1: known})
    assert isinstance(proof, Proof)
