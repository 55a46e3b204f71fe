"""What the samples rest on, known before the first: errors that make a signal meaningless, and what no manual decides."""

from __future__ import annotations

from jbclog.commands.command import Command
from jbclog.effects import Steps
from jbclog.rows import Severity
from jbclog.session.columns import whole_of
from jbclog.session.order import Desk, PortState
from jbclog.session.watch import OBSERVERS

NO_UNIT = 33  # row of section B of the digest


def learn_provisos(desk: Desk) -> Steps[None]:
    """Read and tell them once. Raises `LinkError` or `StationError` where the station does not answer."""
    for port in desk.ports.values():
        if desk.family.port_errors.voids:
            error = yield from desk.agreed(desk.command("port_error"), port.number, known=port.error or 0)
            OBSERVERS["port_error"](desk, port, error)
        for command in desk.family.commands.values():
            if command.share_of is not None and command.name in port.held:
                _tell_share(desk, port, command)


def _tell_share(desk: Desk, port: PortState, command: Command) -> None:
    """No manual prints the unit: what is recorded as a share, and the numbers that it was made of."""
    raw, whole = port.held[command.name], whole_of(command, desk)
    name, greatest = command.name.replace("_", " "), str(command.share_of).replace("_", " ")
    text = f"No manual prints the unit of the {name} of port {port.number}; it is {raw}"
    if whole is None:
        text += f", and cannot be recorded as a share: the station does not tell its {greatest}."
    else:
        text += f" of a {greatest} of {whole}, and is recorded as that share, in per mille."
    desk.note("protocol.undecided", Severity.INFO, text, port=port.number, code=NO_UNIT, raw=f"{raw}/{whole or '?'}")
