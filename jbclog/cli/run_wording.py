"""The result of a run, as sentences for the terminal: the findings, the verdict's reasons."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

GRAVEST_FIRST = ("fail", "missing", "deviation")

RuleFacts = dict[str, object]
"""One of the manifest's `verdict_rules`."""


def reasons_told(rules: Iterable[RuleFacts]) -> list[str]:
    """What the rules found wrong or missing, each sentence once with its places and the rules' names, the gravest first."""
    broken = sorted((rule for rule in rules if rule["result"] in GRAVEST_FIRST), key=_gravity)
    same: dict[tuple[str, str], list[RuleFacts]] = {}
    for rule in broken:
        same.setdefault((str(rule["result"]), _sentence(rule)), []).append(rule)
    return [_told(result, sentence, alike) for (result, sentence), alike in same.items()]


def _gravity(rule: RuleFacts) -> int:
    return GRAVEST_FIRST.index(str(rule["result"]))


def _sentence(rule: RuleFacts) -> str:
    """The rule's sentence without its place."""
    text = str(rule["text"])
    bare = text.removeprefix(f"Port {rule['port']}: ")
    return text if bare == text else bare[:1].upper() + bare[1:]


def _told(result: str, sentence: str, rules: list[RuleFacts]) -> str:
    places = "; ".join(_places(rules))
    names = ", ".join(dict.fromkeys(str(rule["name"]) for rule in rules))
    return f"{result}: {places + ': ' if places else ''}{sentence} ({names})"


def _places(rules: Iterable[RuleFacts]) -> Iterator[str]:
    """``dde-1 ports 1, 2``, ``ucr-1``."""
    ports: dict[str, dict[str, None]] = {}
    for rule in rules:
        if rule["station"] is not None:
            own = ports.setdefault(str(rule["station"]), {})
            own |= {} if rule["port"] is None else {str(rule["port"]): None}
    for station, own in ports.items():
        yield f"{station} port{'s' if len(own) > 1 else ''} {', '.join(own)}" if own else station
