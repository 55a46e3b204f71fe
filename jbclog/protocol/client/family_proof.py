"""Whether a station is of the kind that the line file says, by reads whose letters no other kind has.

A model name that the line file accepts proves nothing, and status 00001 lets a soldering tool rest and switches hot air on. So
before the first status order the station answers what only its kind answers (`Family.answered_by_kind`), twice each, and none
of what only another kind does.
"""

from __future__ import annotations

from typing import Final

from jbclog.core.errors import StationError
from jbclog.core.io_requests import Steps
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.patient_reads import START_TRIES, patiently
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.models import foreign_reads

NOT_DRIVEN: Final = "Nothing was written to it: correct `family`, or the cable"


def why_not_borne_out(client: Client, family: Family, port: int) -> Steps[str | None]:
    """Why the station is not of the kind of `family`, in words; None where it is. Raises `LinkError`."""
    why = yield from why_not_answering(client, family, port, START_TRIES)
    for command in foreign_reads(family) if why is None else ():
        if (yield from _refusal(client, command, port, tries=1)) is None:
            return f"it answers R-{_code(command, port)}, which only another kind of station does"
    return why


def why_not_answering(client: Client, family: Family, port: int, tries: int = 1) -> Steps[str | None]:
    """As `why_not_borne_out`, by the family's own reads alone: where there is no time for those that must not be answered."""
    for command in (family.commands[name] for name in 2 * family.answered_by_kind):
        error = yield from _refusal(client, command, port, tries)
        if error is not None:
            return f"it does not answer R-{_code(command, port)}, as a {family.name} does ({error})"
    return None


def _refusal(client: Client, command: Command, port: int, tries: int) -> Steps[StationError | None]:
    """What came in place of a value; None where a value came."""
    try:
        yield from patiently(client, lambda: client.read(command, _port(command, port)), tries)
    except StationError as error:
        return error
    return None


def _port(command: Command, port: int) -> int | None:
    return port if command.scope is Scope.PORT else None


def _code(command: Command, port: int) -> str:
    return command.code(_port(command, port))
