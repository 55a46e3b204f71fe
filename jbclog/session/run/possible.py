"""What a reading of this station can be at all: what no station can say (`commands.possible`), and what this one cannot.

Anything else is no value, however often it is said. It is asked again before that is believed, too (`second_look.py`).
"""

from __future__ import annotations

from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.possible import Possible, is_share, possible_as
from jbclog.session.run.columns import whole_of
from jbclog.session.run.context import SessionContext
from jbclog.session.scheduler import Reading


def possible_of(context: SessionContext, reading: Reading) -> Possible | None:
    """What tells whether an answer to `reading` can be true; None where nothing is known to be impossible."""
    possible = possible_as(reading.name, context.family)
    if possible is None and reading.command.share_of is not None:
        return _share_of(reading.command, context)
    return possible


def _share_of(command: Command, context: SessionContext) -> Possible:
    """Not much more than the whole, as soon as that is known."""

    def possible(value: Value) -> bool:
        whole = whole_of(command, context)
        return whole is None or is_share(value, whole)

    return possible
