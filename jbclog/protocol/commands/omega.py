"""Apollo Seiko OMEGA: what its controller can be asked and told.

Manual 003, one page of it, has the frame, the sum and A, which is answered by a; it prints no digit behind that. The other
commands stand on its pages 6 to 10, which are not here; they are taken from a public description of them
(docs/reference/manuals.md), and are marked so. No row
of its table is more certain than that. So a controller that answers A with a, and nothing else, is driven all the same.

It tells no temperature, no model and no error number, and refuses by saying nothing.
"""

from __future__ import annotations

from types import MappingProxyType

from jbclog.core.quantities import Quantity
from jbclog.protocol.commands.command import Command, Effect, Limits, Scope
from jbclog.protocol.commands.omega_values import MODES, ConditionNumber, Digit, StoredCondition
from jbclog.protocol.commands.robot import ErrorTable
from jbclog.protocol.commands.signals import Pace, Signal

INFORMATION = Digit(("normal", "solder shortage", "solder clogged", "solder shortage and clogged"), may_lack=True)
CONTROL = Digit(("ready", "preparing or error"))
AT_TEMPERATURE = Digit(("in range", "out of range"))

SAYS_YES = MappingProxyType(
    {
        "solder_shortage": frozenset((INFORMATION.names[1], INFORMATION.names[3])),
        "clogged": frozenset(INFORMATION.names[2:]),
        "preparing": frozenset(CONTROL.names[1:]),
        "in_range": frozenset(AT_TEMPERATURE.names[:1]),
    }
)
"""The answers that make a column true."""


def _unseen(section: str) -> str:
    return f"003 p. 6-10, not seen here: {section}"


def _told(name: str, letters: str, quantity: Quantity, manual: str, note: str = "") -> Command:
    return Command(name, letters, Scope.STATION, quantity, "r", manual, answer_digits=1, note=note)


def _order(name: str, letters: str, quantity: Quantity, limits: Limits, note: str) -> Command:
    return Command(name, letters, Scope.STATION, quantity, "w", _unseen(letters), limits, Effect.MOVES, True, 0, note)


OMEGA = (
    _told(
        "information",
        "A",
        INFORMATION,
        "003 11.3.1",
        "B-48: printed as 41H(''), and answered by a; its digit is of A.13",
    ),
    _told("temperature_control", "B", CONTROL, _unseen("B"), "one digit for preparing and for errors: it cannot tell them apart"),
    Command(
        "condition",
        "C",
        Scope.CONDITION,
        StoredCondition(),
        "r",
        _unseen("C"),
        answer_digits=None,
        note="B-49, B-50, B-51; an unknown number is ignored",
    ),
    _order("store_condition", "D", StoredCondition(), Limits(), "B-50, B-52; d only when it was taken, else silence"),
    _told("set_temperature_state", "F", AT_TEMPERATURE, _unseen("F"), "whether it is within the alarm range"),
    _told("mode", "G", Digit(MODES), _unseen("G"), "of the conditions 301 to 399"),
    _order(
        "run_condition",
        "H",
        ConditionNumber(),
        Limits(101, 399, 1),
        "B-52; h when a point is done, i after the first stage of a slide, late; an unknown number is ignored",
    ),
)

OMEGA_SIGNALS = (
    Signal("information", ("solder_shortage", "clogged"), Pace.FAST),
    Signal("temperature_control", ("preparing",), Pace.FAST),
    Signal("set_temperature_state", ("in_range",), Pace.FAST),
)

LATE = MappingProxyType({"h": "soldering a point is completed", "i": "the first stage of slide soldering is over"})
"""What the controller says by itself once it is there, long after H."""

NO_ERRORS = ErrorTable("OMEGA", MappingProxyType({}))
