"""The tip verification that a port stood on when its run began, in a sentence (`verifying`, `manifest.verifications`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Final

from jbclog.core.rows import TipCheck

RULE: Final = "verification"
NONE: Final = "none"
NOT_CITED: Final = "This record cites no verification of its tip."

Row = dict[str, object]


def verification_facts(check: TipCheck | None, rules: Sequence[Mapping[str, object]], station: str, port: int) -> Row:
    """What the manifest cites, its `state` as the verdict took it (``expired``, ``adjusted since``), and a sentence."""
    if check is None:
        return {"state": NONE, "text": NOT_CITED}
    judged = next((rule for rule in rules if (rule["name"], rule["station"], rule["port"]) == (RULE, station, port)), None)
    observed = None if judged is None else judged["observed"]
    state = observed if isinstance(observed, str) else check.state
    text = judged["text"] if judged is not None and isinstance(observed, str) else _sentence(check)
    return {**asdict(check), "state": state, "text": text}


def _sentence(check: TipCheck) -> str:
    """Which one it was, where it is one."""
    if check.time is None or check.days is None:
        return check.text
    offset = "" if check.offset_c is None else f", {check.offset_c:+.1f} °C from the station's own reading"
    limit = "" if check.limit_c is None else f" (limit ±{check.limit_c:g} °C)"
    made = f"Verified {age(check.days)} before the run with {check.instrument}, tip {check.tip}{offset}{limit}."
    return made if check.state == "pass" else f"{made} {check.text}"


def age(days: float) -> str:
    """``11.0 d``, or ``3.2 h``."""
    return f"{days:.1f} d" if days >= 1 else f"{days * 24:.1f} h"


def short(facts: Mapping[str, object] | None) -> str:
    """For a table: ``pass, 11.0 d``; a dash for a port without a tip."""
    if facts is None:
        return "–"
    days, state = facts.get("days"), str(facts["state"])
    return f"{state}, {age(days)}" if isinstance(days, float) else state
