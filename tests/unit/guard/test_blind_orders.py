"""Orders to a station that does not answer, in one or more take-overs, on a clock that jumps."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest

from support.clients.making_safe import ASKED_AT, Cable, FloodedCable, Silent, station, task
from support.product import (
    EXTRACTOR,
    MOST_ORDERS,
    ORDER_FOR_S,
    STAND,
    WORKING,
    BlindOrders,
    Continuity,
    PortDevice,
    Proof,
    SafetyTask,
    StationLease,
    StatusWord,
    VirtualStation,
    secure,
)

PORTS = (1, 2, 3, 4)
LEASE = StationLease(
    "dme-1", "/dev/ttyUSB0", 19200, "8N1", 1, "dme", "DME", "1.0", "stand", PORTS, False
)
DEVICE = PortDevice(None, 48128, 17, "1-4", "FT1")
OTHER_DEVICE = replace(DEVICE, changed_ns=18)


@dataclass
class Death:
    """A recorder died at `died_at`; take-overs find `device` behind the port."""

    died_at: float = ASKED_AT
    device: PortDevice = DEVICE
    is_mixed: bool = False
    known: Continuity = field(default_factory=Continuity)

    def __post_init__(self) -> None:
        self.known.died_at = self.died_at
        self.known.note_proof(Proof("dme-1", DEVICE, ASKED_AT, dict.fromkeys(PORTS, WORKING)))

    def taken_over(self, cable: Cable) -> SafetyTask:
        blind = BlindOrders(LEASE, self.known, lambda: self.is_mixed, lambda: cable.now)
        blind.device = self.device
        made = task(*PORTS, family="dme", is_proven=False)
        made.prove = lambda: blind.prove(made)
        cable.pull(secure(made))
        return made


def orders(device: VirtualStation) -> list[tuple[int, object]]:
    return [
        (write.port, write.value) for write in device.log.written("status") if write.at >= ASKED_AT
    ]


@pytest.mark.parametrize(("is_mixed", "word"), [(False, STAND), (True, EXTRACTOR)])
def test_over_a_flooded_link_it_is_ordered_three_times_at_most(
    is_mixed: bool, word: StatusWord
) -> None:
    device, death = station("dme", PORTS), Death(is_mixed=is_mixed)
    cable = FloodedCable(device, b"\xaa")
    for _ in range(4):
        death.taken_over(cable)
    assert {value for _, value in orders(device)} == {word}
    for port in PORTS:
        assert 1 <= orders(device).count((port, word)) <= MOST_ORDERS


@pytest.mark.parametrize("is_mixed", [False, True])
def test_over_a_flooded_link_another_device_gets_no_order(is_mixed: bool) -> None:
    device, death = station("dme", PORTS), Death(device=OTHER_DEVICE, is_mixed=is_mixed)
    death.taken_over(FloodedCable(device, b"\xaa"))
    assert orders(device) == []


def test_over_a_flooded_link_a_mixed_line_gets_no_stand_after_its_time_is_over() -> None:
    device, death = station("dme", PORTS), Death(ASKED_AT - ORDER_FOR_S - 1.0, is_mixed=True)
    death.taken_over(FloodedCable(device, b"\xaa"))
    assert orders(device) == []


def test_each_tool_is_ordered_only_while_the_station_is_still_proven() -> None:
    """The time ends between two of its tools."""
    end = ASKED_AT + 0.5
    silent, asked = Silent(), list[tuple[str, float]]()
    cable = Cable(silent, before=lambda text: asked.append((text, cable.now)))
    Death(end - ORDER_FOR_S).taken_over(cable)
    ordered = [(text, at) for text, at in asked if text.startswith("WPS")]
    assert 1 <= len(ordered) < len(PORTS)
    assert all(at <= end for _, at in ordered)


def test_another_station_that_answered_gets_no_order_when_its_link_is_flooded_later() -> None:
    nae, death = station("nae"), Death()
    death.taken_over(Cable(nae))
    assert death.known.others == {"dme-1": "a NAE, not the DME"}
    death.taken_over(FloodedCable(nae, b"\xaa"))
    assert orders(nae) == []
