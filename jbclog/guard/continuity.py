"""When a port certainly still leads to the station that the run identified, although it does not
answer; and which orders that allows.

A station whose answers are lost may still hear. The recorder's own end orders a silent station too;
so does the guard, within narrow limits, because another cable may be plugged in by now:

1. This run proved model and software on this very device, and the last valid answer came at most
   `PROVEN_FOR_S` ago. The time includes suspension.
2. The device is the same (`transport.device`).
3. The tool was at work when its status was last read, or its status was never read: an order to
   stand would warm a tip that rests.
4. No station of the line, nor of another run's open lease, takes the same bytes otherwise: 00001 is
   *stand* for soldering tools and *on* for hot air. On such a mixed line only 00010 is sent, which
   heats neither, and it does not count as safe.
5. At most `MOST_ORDERS` times within `ORDER_FOR_S` after the recorder's death, because each *stand*
   begins the sleep delay again; and never again once another station was identified.

Wherever a guard asks which station it is, model, software and the plugged hours that the run read
must fit (`identifying.py`).

The facts are in the guard's memory only: a lease read from disk proves nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from jbclog.core.json_files import builder
from jbclog.guard.lease import StationLease
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.protocol.commands.status import NO_STATUS, StatusWord
from jbclog.transport.device import PortDevice

PROVEN_FOR_S: Final = 30.0
ORDER_FOR_S: Final = 10.0
MOST_ORDERS: Final = 3


Hours = Mapping[int, tuple[int, float]]
"""Plugged hours by port, each with the time of its reading (`clock.elapsed`)."""


@dataclass(frozen=True, slots=True)
class Proof:
    """A station was identified on `device`, and last answered at `answered_at` (`clock.elapsed`).

    `statuses`: the last status word of each touched port; None if it was never read, or is not
    known since it was ordered. `hours`: of the ports where the run read them.
    """

    station: str
    device: PortDevice
    answered_at: float
    statuses: Mapping[int, StatusWord | None] = field(default_factory=dict)
    hours: Hours = field(default_factory=dict)


build_proof: Final = builder(Proof)
"""Builds a proof from parsed JSON; raises ValueError."""


class Continuity:
    """What a guard knows about the stations of its run, to tell each from another, and to order one
    that does not answer.

    `families`: names of all families of the line file, recorded or not; None until the recorder has
    sent them. `died_at`: when the recorder was gone. `orders`: how often a station was ordered
    without an answer, and `ordered` how often each tool, with the last state, by station and port.
    `others`: what was found in a station's place. `hours`: of each station, also when its proof no
    longer counts.
    """

    def __init__(self) -> None:
        self.proofs: dict[str, Proof] = {}
        self.families: tuple[str, ...] | None = None
        self.died_at = 0.0
        self.orders: Counter[str] = Counter()
        self.ordered: dict[tuple[str, int], tuple[StatusWord, int]] = {}
        self.others: dict[str, str] = {}
        self.hours: dict[str, Hours] = {}

    def note_proof(self, proof: Proof) -> None:
        """Register that a station was identified."""
        self.proofs[proof.station] = proof
        self.hours[proof.station] = proof.hours

    def note_answers(self, times: Mapping[str, float]) -> None:
        """Register later answers of stations on the same devices."""
        for station, answered_at in times.items():
            proof = self.proofs.get(station)
            if proof is not None:
                self.proofs[station] = replace(proof, answered_at=answered_at)

    def note_order(self, station: str, port: int, word: StatusWord) -> None:
        """Register that a tool was ordered without an answer."""
        _, times = self.ordered.get((station, port), (word, 0))
        self.ordered[station, port] = word, times + 1

    def has_changed(self, station: str, device: PortDevice | None) -> bool:
        """Return True if `device` is known to be another one than when the station was proven."""
        proof = self.proofs.get(station)
        return proof is not None and device is not None and device != proof.device

    def may_rest(self, lease: StationLease) -> bool:
        """Return True if a leased tool was at rest when its status was last read."""
        family = FAMILIES.get(lease.family)
        proof = self.proofs.get(lease.name)
        if family is None or proof is None:
            return False
        statuses = [proof.statuses.get(port) for port in lease.ports]
        return any(why_left_alone(family, status) for status in statuses)

    def has_orders_left(self, station: str, now: float) -> bool:
        """Return True if an order without an answer may still become possible."""
        is_in_time = now <= self.died_at + ORDER_FOR_S
        is_proven = station in self.proofs and station not in self.others
        return is_in_time and is_proven and self.orders[station] < MOST_ORDERS

    def why_not(self, lease: StationLease, device: PortDevice | None, now: float) -> str | None:
        """Return why nothing may be sent to a station that does not answer; None if it may."""
        name = lease.name
        if name in self.others:
            return f"on {lease.url} there is now {self.others[name]}"
        why = why_unproven(self.proofs.get(name), device, now)
        if why is None and self.orders[name] >= MOST_ORDERS:
            return f"it was ordered {MOST_ORDERS} times"
        if why is None and now > self.died_at + ORDER_FOR_S:
            return f"the recorder ended more than {ORDER_FOR_S:g} s ago"
        return why


def why_unproven(proof: Proof | None, device: PortDevice | None, now: float) -> str | None:
    """Return why `device` is not certain to lead to the station of `proof`; None if it is."""
    if proof is None:
        return "the run had not proven which station it is"
    silent_s = now - proof.answered_at
    if silent_s > PROVEN_FOR_S:
        return f"it last answered {silent_s:.0f} s ago, more than {PROVEN_FOR_S:g} s"
    if device is None or device != proof.device:
        return "its port is not known to be the same device as before"
    return None


def is_mixed(families: Collection[str] | None, elsewhere: Collection[str] | None) -> bool:
    """Return True if stations of these families may take the same bytes otherwise. `elsewhere`: of
    other runs' leases. None, and a family that is not known, count as mixed.
    """
    if families is None or elsewhere is None:
        return True
    names = {*families, *elsewhere}
    if not names <= FAMILIES.keys():
        return True
    tables = [FAMILIES[name].status for name in names]
    kinds = {table.names for table in tables if table is not NO_STATUS}
    return len(kinds) > 1


def why_left_alone(family: Family, status: StatusWord | None) -> str | None:
    """Return why a tool is left alone; None if it was at work, or its status is not known."""
    if status is None or family.status.is_working(status):
        return None
    return f"it was last read in {family.status.shown(status)}, which an order could warm"
