"""The rules of a verdict in short: one line for each limit, how many kept it, and who was worst."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

NOT_APPLICABLE = "not applicable"
FEW = 12  # so many rules are read at a glance and need no summary

LEAST_IS_WORST = ("coverage", "reached", "recovered_before_next")

Rule = Mapping[str, object]


def summary(rules: Sequence[Rule]) -> list[dict[str, object]]:
    """Rules of the same name, limit and unit as one line; none where there are only a `FEW` rules."""
    if len(rules) <= FEW:
        return []
    alike: dict[tuple[object, ...], list[Rule]] = {}
    for rule in rules:
        alike.setdefault((rule["name"], rule["limit"], rule["unit"]), []).append(rule)
    return [_line(these) for these in alike.values()]


def _line(rules: Sequence[Rule]) -> dict[str, object]:
    worst = _worst(rules)
    results = [str(rule["result"]) for rule in rules if rule["result"] != NOT_APPLICABLE]
    usual = "pass" if results else NOT_APPLICABLE
    result = next((one for one in ("fail", "missing", "deviation") if one in results), usual)
    alike = len(rules) > 1 and len({rule["observed"] for rule in rules}) == 1  # nobody stands out
    named = None if alike else worst
    place = {"station": named["station"], "port": named["port"]} if named is not None else {"station": None, "port": None}
    observed = None if worst is None else worst["observed"]
    first = rules[0]
    return {
        "name": first["name"],
        "limit": first["limit"],
        "unit": first["unit"],
        "kept": results.count("pass"),
        "of": len(results),
        "worst": observed,
        "bound": None if worst is None else worst.get("bound"),
        **place,
        "result": result,
    }


def _worst(rules: Sequence[Rule]) -> Rule | None:
    """The one furthest on the wrong side; None where nothing is a number, or a word for having none at all."""
    if rules[0]["name"] in LEAST_IS_WORST and (without := [rule for rule in rules if isinstance(rule["observed"], str)]):
        return min(without, key=lambda rule: rule["result"] != "fail")
    measured = [rule for rule in rules if isinstance(rule["observed"], int | float)]
    if not measured:
        return None
    return (
        min(measured, key=_reading) if rules[0]["name"] in LEAST_IS_WORST else max(measured, key=lambda rule: abs(_reading(rule)))
    )


def _reading(rule: Rule) -> float:
    observed = rule["observed"]
    return float(observed) if isinstance(observed, int | float) else 0.0
