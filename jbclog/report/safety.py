"""How a tool was left: in its safe state, not, or not known. What was not proved safe is never called untouched."""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.core.rows import StationFacts
from jbclog.protocol.commands.family import FAMILIES

MEANINGS = {
    "verified": "The order was read back.",
    "sent": "The order was sent and could not be read back.",
    "failed": "The tool could not be put in its safe state.",
}
UNSAFE = "The run put this tool to work, and nothing in the record says that it was put in its safe state. It may still be hot."
NO_SAFE_STATE = "It has no safe state that could be ordered; the run left it as it was."
UNTOUCHED = "The run changed nothing at this port."
UNTOUCHED_AS_FAR = "Nothing in the record says that the run changed anything at this port; the record's end is missing."


@dataclass(frozen=True, slots=True)
class Left:
    """The word for it, what it means, and whether it calls for somebody to go and look."""

    word: str
    meaning: str
    warn: bool


def left(facts: StationFacts, port: int, celsius: float | None, status: str | None, cut_off: bool) -> Left:
    """How the tool in `port` was left; `celsius` and `status` are the last that were read of it."""
    order = facts.safe_state.get(port)
    if order is not None:
        return Left(order, MEANINGS.get(order, ""), order not in ("verified", "sent"))
    family = FAMILIES.get(facts.family)
    if family is not None and not family.safe_states:
        return Left("has none", NO_SAFE_STATE, False)
    if port not in facts.touched:
        return Left("not touched", UNTOUCHED_AS_FAR if cut_off else UNTOUCHED, False)
    seen = [f"{celsius:.0f} °C"] if celsius is not None else []
    seen += [status] if status is not None else []
    return Left(f"not made safe: last seen {', '.join(seen)}" if seen else "not made safe, never read", UNSAFE, True)
