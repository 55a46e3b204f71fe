"""What may go out over a port that an audit has open: questions, and of these none that changes anything by being asked (R-TA)."""

from __future__ import annotations

from functools import cache

from jbclog.app import connection
from jbclog.protocol.commands.command import Effect, Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.session.manual.contact import PORTS
from jbclog.transport.read_only import OnlyReads


def harmless_for(family: Family | None) -> OnlyReads:
    """Whether these bytes are such a question in the protocol of `family`."""
    only_reads, clearing = connection.only_reads_for(family), _clearing()
    return lambda data: only_reads(data) and not any(code in data for code in clearing)


@cache
def _clearing() -> frozenset[bytes]:
    """Every question of any family that does more than ask, at every port."""
    commands = [one for family in FAMILIES.values() for one in family.commands.values()]
    doing = [one for one in commands if one.readable and one.effect is not Effect.NONE and one.scope is Scope.PORT]
    return frozenset(f"R{one.code(port)}".encode() for one in doing for port in PORTS)
