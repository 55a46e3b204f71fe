"""The verdict of a report with its reasons, and its rules in short."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from jbclog.analysis.rejudge import is_cut_off, judge_again, other_rules
from jbclog.analysis.verdict import Result, Rule, Verdict
from jbclog.analysis.verdict.rules import CONFIDENCE, JUDGED_BARE
from jbclog.analysis.verdict.samples import Measuring
from jbclog.record.manifest import Manifest
from jbclog.report.facts import Reason, VerdictFacts
from jbclog.report.joint_words import jointed, never_back_at
from jbclog.report.text import RowView, row_views

NOT_APPLICABLE = "not applicable"
FEW = 12  # rules that need no summary

LEAST_IS_WORST = ("coverage", "reached", "recovered_before_next")


def summary(rules: Sequence[RowView]) -> list[dict[str, object]]:
    """Return one line for the rules of one limit: how many passed, and the worst; empty for at most
    `FEW` rules.
    """
    if len(rules) <= FEW:
        return []
    alike: dict[tuple[object, ...], list[RowView]] = {}
    for rule in rules:
        alike.setdefault((rule["name"], rule["limit_value"], rule["uom"]), []).append(rule)
    return [_line(these) for these in alike.values()]


def _line(rules: Sequence[RowView]) -> dict[str, object]:
    worst = _worst(rules)
    results = [str(rule["result"]) for rule in rules if rule["result"] != NOT_APPLICABLE]
    usual = "pass" if results else NOT_APPLICABLE
    result = next((one for one in ("fail", "missing", "deviation") if one in results), usual)
    alike = len(rules) > 1 and len({rule["observed"] for rule in rules}) == 1  # none stands out
    named = None if alike else worst
    place = (
        {"station": named["station"], "port": named["port"]}
        if named is not None
        else {"station": None, "port": None}
    )
    observed = None if worst is None else worst["observed"]
    first = rules[0]
    return {
        "name": first["name"],
        "limit_value": first["limit_value"],
        "uom": first["uom"],
        "kept": results.count("pass"),
        "of": len(results),
        "worst": observed,
        "bound": None if worst is None else worst.get("bound"),
        **place,
        "result": result,
    }


def _worst(rules: Sequence[RowView]) -> RowView | None:
    """Return the rule furthest on the wrong side, or one without any value; None if nothing is
    measured.
    """
    if rules[0]["name"] in LEAST_IS_WORST and (
        without := [rule for rule in rules if isinstance(rule["observed"], str)]
    ):
        return min(without, key=lambda rule: rule["result"] != "fail")
    measured = [rule for rule in rules if isinstance(rule["observed"], int | float)]
    if not measured:
        return None
    return (
        min(measured, key=_reading)
        if rules[0]["name"] in LEAST_IS_WORST
        else max(measured, key=lambda rule: abs(_reading(rule)))
    )


def _reading(rule: RowView) -> float:
    observed = rule["observed"]
    return float(observed) if isinstance(observed, int | float) else 0.0


EMPTY_RULE = Rule("", None, None, None, None, "", Result.MISSING, "").as_dict()
FINE = "All limits passed."
NO_RULES = "The manifest has this verdict without any rule."
CUT_OFF = "The recording was cut off before the run was judged."
JUDGED_HERE = "Limits are checked against the recorded part only; the missing part stays unknown."
NO_LIMITS = "The recipes state no limits; this is a record, not a release."


def verdict_facts(folder: Path, manifest: Manifest, measuring: Measuring) -> VerdictFacts:
    """Return the verdict with its reasons, the most severe first; `measuring` reads the samples if
    the run is judged here.
    """
    if is_cut_off(manifest):
        return _cut_off(folder, manifest, measuring)
    if manifest.verdict is not None:
        rules = [
            {**EMPTY_RULE, **rule} for rule in manifest.verdict_rules if isinstance(rule, dict)
        ]
        found = _facts(manifest, manifest.verdict, "with the run", rules)
        other = other_rules(manifest)
        if other is not None and manifest.verdict != Verdict.NOT_JUDGED:
            found.by_rules = f"{other[0].upper()}{other[1:]}."
        return found
    judgement = judge_again(folder, manifest, measuring=measuring)
    return _facts(manifest, judgement.verdict.value, "by this report", judgement.rules_as_dicts())


def _cut_off(folder: Path, manifest: Manifest, measuring: Measuring) -> VerdictFacts:
    """Return the verdict that `recover` gave, with the rules judged now on the existing record: a
    cut-off run is never accepted.
    """
    judgement = judge_again(folder, manifest, measuring=measuring)
    lost = [] if manifest.lost is None else [manifest.lost.text]
    judged = judgement.verdict is not Verdict.NOT_JUDGED
    first = Reason("missing", " ".join([CUT_OFF, *lost, *([JUDGED_HERE] if judged else [])]))
    found = _facts(
        manifest,
        manifest.verdict or judgement.verdict.value,
        "by recovery",
        judgement.rules_as_dicts(),
    )
    others = [reason for reason in found.reasons if reason.text not in lost]
    return replace(found, reasons=[first, *others])


def add_reasons(verdict: VerdictFacts, stations: Sequence[RowView], *, cut_off: bool) -> None:
    """Add a sentence for each port without recovery and, after a crash, for each tool that may
    still be hot.
    """
    first = 1 if cut_off else 0
    verdict.reasons[first:first] = [
        Reason("none", text) for text in never_back_at(jointed({"stations": stations}))
    ]
    if cut_off:  # the operator has had no message
        verdict.reasons[1:1] = _not_made_safe(stations)


def _not_made_safe(stations: Sequence[RowView]) -> list[Reason]:
    ports = [
        (station["name"], port) for station in stations for port in row_views(station["ports"])
    ]
    return [
        Reason("fail", f"{name} port {port['port']}: {port['left']}.")
        for name, port in ports
        if port["left_warns"]
    ]


def _facts(
    manifest: Manifest, word: str, decided: str, rules: list[dict[str, object]]
) -> VerdictFacts:
    urls = [facts.url for facts in manifest.stations if facts.url]
    reasons = [
        replace(reason, text=without_urls(reason.text, urls)) for reason in _reasons(word, rules)
    ]
    return VerdictFacts(word, decided, reasons, rules, summary(rules), manifest.rules)


def without_urls(text: str, urls: Sequence[str]) -> str:
    """Return a sentence without the device of its station, which the station's section and the
    events name.
    """
    for url in sorted(urls, key=len, reverse=True):
        if "/" in url:  # not a word that could stand anywhere
            text = re.sub(
                rf"(?: (?:on|at))? {re.escape(url)}(?=[ .,;]|$)|(?<= ){re.escape(url)}: ", "", text
            )
    return text


def _reasons(word: str, rules: list[dict[str, object]]) -> Iterator[Reason]:
    """Yield a sentence for each rule that did not pass, failures first; if there is none, a
    sentence about that.

    The first one states where a recipe has figures judged without their bounds.
    """
    if word == Verdict.NOT_JUDGED:
        yield Reason("none", NO_LIMITS)
        return
    sentences = {
        (result, _sentence(rule)): places
        for result in ("fail", "missing", "deviation")
        for rule in rules
        if rule.get("result") == result
        for places in [_places(rules, result, _sentence(rule))]
    }
    if bare := [str(rule["station"]) for rule in rules if rule.get("name") == CONFIDENCE]:
        yield Reason("none", f"{', '.join(bare)}: {JUDGED_BARE}")
    for (result, sentence), places in sentences.items():
        yield Reason(result, f"{places}: {sentence}" if places else sentence)
    if not sentences:
        yield Reason("pass", FINE) if rules else Reason("missing", NO_RULES)


def _sentence(rule: dict[str, object]) -> str:
    """Return the sentence of a rule without its place, with the number of its deviations."""
    text, observed = str(rule["text"]), rule.get("observed")
    bare = text.removeprefix(f"Port {rule.get('port')}: ")
    text = text if bare == text else bare[:1].upper() + bare[1:]
    often = rule.get("result") == "deviation" and isinstance(observed, int) and observed > 1
    return f"{text} ({observed} times)" if often else text


def _places(rules: list[dict[str, object]], result: str, sentence: str) -> str:
    """Return every station and port for which the sentence holds: ``dde-1 ports 1, 2; ucr-1``."""
    ports: dict[str, list[str]] = {}
    for rule in rules:
        if (
            rule.get("result") == result
            and rule.get("station") is not None
            and _sentence(rule) == sentence
        ):
            named = ports.setdefault(str(rule["station"]), [])
            if rule.get("port") is not None and str(rule["port"]) not in named:
                named.append(str(rule["port"]))
    return "; ".join(
        f"{station} port{'s' * (len(own) > 1)} {', '.join(own)}" if own else station
        for station, own in ports.items()
    )
