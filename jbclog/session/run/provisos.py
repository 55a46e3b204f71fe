"""What the samples rest on and must be known before the first of them: errors that make a signal meaningless."""

from __future__ import annotations

from jbclog.core.io_requests import Steps
from jbclog.session.run.context import SessionContext
from jbclog.session.run.watch import OBSERVERS


def learn_provisos(context: SessionContext) -> Steps[None]:
    """Read the port errors, and tell them, where one of them voids a signal (docs/reference/contradictions.md, B-44).

    Raises `LinkError` or `StationError` where the station does not answer.
    """
    if not context.family.port_errors.voids:
        return
    for port in context.ports.values():
        error = yield from context.agreed(context.command("port_error"), port.number, known=port.error or 0)
        OBSERVERS["port_error"](context, port, error)
