"""Judges a sealed run again from its record, and compares the result with its sealed verdict.

Only a verdict by the rules of this version (`rules_number.py`) can be compared. One by other rules
is not recomputed, and never counts as changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

from jbclog import __version__
from jbclog.analysis.joints.evidence import joint_evidence
from jbclog.analysis.verdict import (
    RULES,
    Evidence,
    Judgement,
    Result,
    Rule,
    Targets,
    Verdict,
    asks_for_joints,
    judge,
)
from jbclog.analysis.verdict.samples import Measuring, measure
from jbclog.core.errors import Problems, UsageError
from jbclog.core.files import Kind, read_regular
from jbclog.core.rows import StationFacts
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import Manifest

if TYPE_CHECKING:
    from jbclog.config.recipe import Recipe

OF_JOINTS: Final = ("recovery_p95", "recovered_before_next", "joints_against_counter")
OF_RECOVERY: Final = (Verdict.INCONCLUSIVE, Verdict.NOT_JUDGED)
Place = tuple[str, str | None, int | None]
"""A rule's name, station and port."""
SealedRule = Mapping[str, object]
"""A rule as in the manifest."""
SAME: Final = 1e-6  # share by which figures of other libraries may differ


@dataclass(frozen=True, slots=True)
class VerdictCheck:
    """Comparison of a sealed verdict with its record: a sentence for each difference, and why it
    was not compared.
    """

    differing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def judge_again(folder: Path, manifest: Manifest, *, measuring: Measuring = measure) -> Judgement:
    """Judge a sealed run by the copies of its recipes. An unreadable copy is missing evidence;
    `measuring` as in `judge`.
    """
    recipes, unread = _recipes(folder, manifest)
    acceptance = {
        name: None if recipe is None else recipe.acceptance for name, recipe in recipes.items()
    }
    targets = {
        name: Targets(recipe.heated_ports(), recipe.run.status)
        for name, recipe in recipes.items()
        if recipe is not None
    }
    lost = None if manifest.lost is None else manifest.lost.text
    asking = [facts for facts in manifest.stations if asks_for_joints(acceptance.get(facts.name))]
    joints, checks = joint_evidence(folder, asking, manifest.t0_utc), manifest.verifications
    evidence = Evidence(
        folder,
        manifest.stations,
        manifest.ledger,
        manifest.exit_status,
        lost,
        checks,
        joints,
        manifest.goals,
        targets,
    )
    judgement = judge(evidence, acceptance, measuring)
    return _without(unread, judgement) if unread else judgement


def _without(unread: Sequence[StationFacts], judgement: Judgement) -> Judgement:
    """Return the judgement with the recipes of these stations as missing evidence."""
    text = "The copy of its recipe cannot be read, so its limits are not known."
    rules = [
        Rule("recipe", facts.name, None, "readable", None, "", Result.MISSING, text)
        for facts in unread
    ]
    verdict = Verdict.REJECT if judgement.verdict is Verdict.REJECT else Verdict.INCONCLUSIVE
    return Judgement(verdict, (*rules, *judgement.rules))


def other_rules(manifest: Manifest) -> str | None:
    """Return the sentence that the verdict is by other rules than this version has; None if it is
    not.
    """
    if manifest.rules == RULES:
        return None
    return f"judged by rules {manifest.rules}, which this version does not have"


def is_cut_off(manifest: Manifest) -> bool:
    """Whether the recorder crashed and `recover` wrote the record's end."""
    return manifest.exit_status == "lost"


def check_verdict(folder: Path, manifest: Manifest) -> VerdictCheck:
    """Compare the sealed verdict of a run that is otherwise intact with that of its record; of a
    run that was cut off, with what `recover` gives.
    """
    if manifest.verdict is None:
        return VerdictCheck()
    if is_cut_off(manifest):
        return VerdictCheck([*_not_by_recovery(folder, manifest)])
    other = other_rules(manifest)
    if other is not None:
        return VerdictCheck(notes=[f"verdict: {other}; its record is intact"])
    unread = _not_taken(folder, manifest)
    if unread:
        return VerdictCheck(
            notes=[f"verdict: not recomputed: this version cannot read the recipe of {unread}"]
        )
    version = manifest.host.get("jbclog", "not known")
    by = "" if version == __version__ else f"; it was judged by jbclog {version}"
    differing = _differing(manifest, judge_again(folder, manifest))
    return VerdictCheck(
        [
            f"verdict{name}: was {was}, its record gives {gives}{by}"
            for name, was, gives in differing
        ]
    )


def _not_by_recovery(folder: Path, manifest: Manifest) -> Iterator[str]:
    """Yield why `recover` never gave the verdict of this cut-off run: it accepts and rejects
    nothing, and judges each run with limits.
    """
    if manifest.verdict not in OF_RECOVERY:
        given = " or ".join(OF_RECOVERY)
        yield f"verdict: was {manifest.verdict}, but a run that was cut off is {given}"
    elif (
        manifest.verdict == Verdict.NOT_JUDGED
        and other_rules(manifest) is None
        and not _not_taken(folder, manifest)
        and judge_again(folder, manifest).verdict is not Verdict.NOT_JUDGED
    ):
        yield f"verdict: was {manifest.verdict}, but its recipes have limits"


def _differing(manifest: Manifest, judgement: Judgement) -> list[tuple[str, object, object]]:
    """Return what differs in the rules, each with the sealed and the new value: results first."""
    before, now = _by_place(manifest.verdict_rules), _by_place(judgement.rules_as_dicts())
    places = [*{**before, **now}]
    found: list[tuple[str, object, object]] = [("", manifest.verdict, judgement.verdict)]
    found += [
        (_named(place), _result(before.get(place)), _result(now.get(place))) for place in places
    ]
    if differing := [one for one in found if one[1] != one[2]]:
        return differing
    return [one for place in places for one in _other_figures(place, before[place], now[place])]


def _other_figures(
    place: Place, before: Sequence[SealedRule], now: Sequence[SealedRule]
) -> Iterator[tuple[str, object, object]]:
    """Yield limit and observed figure if they differ. Words are not compared, because another
    version may have others; nor figures of joints, whose search depends on the libraries.
    """
    for name in ("limit_value",) if place[0] in OF_JOINTS else ("limit_value", "observed"):
        for one, other in zip(before, now, strict=True):
            was, gives = one.get(name), other.get(name)
            if isinstance(gives, int | float) and not (
                isinstance(was, int | float) and isclose(was, gives, rel_tol=SAME, abs_tol=SAME)
            ):
                yield f"{_named(place)}, {name}", was, gives


def _not_taken(folder: Path, manifest: Manifest) -> str:
    """Return the stations whose recipes this version cannot read although they are as sealed."""
    unread = _recipes(folder, manifest)[1]
    return ", ".join(facts.name for facts in unread if _is_as_sealed(folder, manifest, facts))


def _recipes(
    folder: Path, manifest: Manifest
) -> tuple[dict[str, Recipe | None], list[StationFacts]]:
    """Return each station's recipe, and the stations whose recipe cannot be read."""
    # a run judged by these rules needs none for its report, and importing the models takes a tenth
    # of the time of a short run's report
    from jbclog.config.load_recipe import load_recipe

    recipes: dict[str, Recipe | None] = {}
    unread: list[StationFacts] = []
    for facts in manifest.stations:
        try:
            recipes[facts.name] = (
                None
                if facts.recipe is None
                else load_recipe(recipe_copy(folder, facts.recipe), links=False)
            )
        except (Problems, UsageError, OSError):
            unread.append(facts)
    return recipes, unread


def _is_as_sealed(folder: Path, manifest: Manifest, facts: StationFacts) -> bool:
    """Whether the copy of the recipe is unchanged, so that it is this jbclog that refuses it."""
    try:
        path = recipe_copy(folder, facts.recipe or "")
        found = hashlib.sha256(read_regular(path, Kind.SETTINGS)).hexdigest()
    except OSError:
        return False
    return any(
        found == recipe.sha256 and path.name == Path(recipe.file).name
        for recipe in manifest.recipes
    )


def _by_place(rules: Sequence[SealedRule]) -> dict[Place, list[SealedRule]]:
    """Return the rules of each place, usually one. A rule of a damaged manifest may lack
    anything.
    """
    found: dict[Place, list[SealedRule]] = {}
    for rule in rules:
        place = str(rule.get("name")), rule.get("station"), rule.get("port")
        found.setdefault(cast("Place", place), []).append(rule)
    return found


def _result(rules: Sequence[SealedRule] | None) -> str | None:
    return None if rules is None else " and ".join(str(rule.get("result")) for rule in rules)


def _named(place: Place) -> str:
    name, station, port = place
    of = "" if station is None else f" of {station}"
    return f", {name}{of}{'' if port is None else f' port {port}'}"
