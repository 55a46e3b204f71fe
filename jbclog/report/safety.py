"""The state in which the run left a tool, and the tip verification of its port, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final

from jbclog.core.rows import StationFacts, TipCheck
from jbclog.core.states import SafetyResult
from jbclog.protocol.commands.family import FAMILIES
from jbclog.report.text import Row

MEANINGS: Final[dict[str, str]] = {
    SafetyResult.VERIFIED: "The safe state was confirmed.",
    SafetyResult.SENT: "The safe state was ordered and could not be confirmed.",
    SafetyResult.FAILED: "The safe state could not be set.",
}
UNSAFE = (
    "The run used this tool, and the record shows no safe state afterwards. It may still be hot."
)
NO_SAFE_STATE = "It has no safe state that can be set; the run left it as it was."
UNTOUCHED = "The run changed nothing at this port."
UNTOUCHED_AS_FAR = "The record shows no change at this port; its end is missing."


@dataclass(frozen=True, slots=True)
class EndState:
    """The state in a word, its meaning, and whether somebody has to check the tool."""

    word: str
    meaning: str
    warn: bool


def end_state(
    facts: StationFacts, port: int, celsius: float | None, status: str | None, cut_off: bool
) -> EndState:
    """Return how the run left the tool in `port`; `celsius` and `status` are its last readings."""
    order = facts.safe_state.get(port)
    if order is not None:
        return EndState(
            order, MEANINGS.get(order, ""), order not in (SafetyResult.VERIFIED, SafetyResult.SENT)
        )
    family = FAMILIES.get(facts.family)
    if family is not None and not family.safe_states:
        return EndState("has none", NO_SAFE_STATE, False)
    if port not in facts.touched:
        return EndState("not touched", UNTOUCHED_AS_FAR if cut_off else UNTOUCHED, False)
    seen = [f"{celsius:.0f} °C"] if celsius is not None else []
    seen += [status] if status is not None else []
    return EndState(
        f"not made safe: last seen {', '.join(seen)}" if seen else "not made safe, never read",
        UNSAFE,
        True,
    )


RULE: Final = "verification"
NONE: Final = "none"
NOT_CITED: Final = "This record cites no verification of its tip."


def verification_facts(
    check: TipCheck | None, rules: Sequence[Mapping[str, object]], station: str, port: int
) -> Row:
    """Return the tip verification in the manifest, its `state` in the verdict (``expired``,
    ``adjusted since``), a sentence.
    """
    if check is None:
        return {"state": NONE, "text": NOT_CITED}
    judged = next(
        (
            rule
            for rule in rules
            if (rule["name"], rule["station"], rule["port"]) == (RULE, station, port)
        ),
        None,
    )
    observed = None if judged is None else judged["observed"]
    state = observed if isinstance(observed, str) else check.state
    text = judged["text"] if judged is not None and isinstance(observed, str) else _sentence(check)
    return {**asdict(check), "state": state, "text": text}


def _sentence(check: TipCheck) -> str:
    """Return which verification it was, if there is one."""
    if check.time is None or check.days is None:
        return check.text
    offset = (
        ""
        if check.offset_c is None
        else f", {check.offset_c:+.1f} °C from the station's own reading"
    )
    limit = "" if check.limit_c is None else f" (limit ±{check.limit_c:g} °C)"
    made = (
        f"Verified {age(check.days)} before the run with {check.instrument}, tip"
        f" {check.tip}{offset}{limit}."
    )
    return made if check.state == "pass" else f"{made} {check.text}"


def age(days: float) -> str:
    """Return ``11.0 d``, or ``3.2 h``."""
    return f"{days:.1f} d" if days >= 1 else f"{days * 24:.1f} h"


def short(facts: Mapping[str, object] | None) -> str:
    """Return ``pass, 11.0 d`` for a table; a dash for a port without a tip."""
    if facts is None:
        return "–"
    days, state = facts.get("days"), str(facts["state"])
    return f"{state}, {age(days)}" if isinstance(days, float) else state
