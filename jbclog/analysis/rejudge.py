"""Judges a sealed run again from its record, and compares the result with its sealed verdict.

The comparison uses the version of the rules that gave the verdict (`rule_versions.py`). Rules that
this jbclog cannot apply as that version did are listed and never count against the verdict.
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
from jbclog.analysis.rule_versions import OF_JOINTS, is_known, not_kept
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

OF_RECOVERY: Final = (Verdict.INCONCLUSIVE, Verdict.NOT_JUDGED)
Place = tuple[str, str | None, int | None]
"""A rule's name, station and port."""
SealedRule = Mapping[str, object]
"""A rule as in the manifest."""
SAME: Final = 1e-6  # share by which figures of other libraries may differ


@dataclass(frozen=True, slots=True)
class VerdictCheck:
    """Comparison of a sealed verdict with its record: a sentence for each difference, and for each
    rule that could not be compared.
    """

    differing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def judge_again(
    folder: Path,
    manifest: Manifest,
    by: int | None = None,
    *,
    counts_lacking: bool = True,
    measuring: Measuring = measure,
) -> Judgement:
    """Judge a sealed run by the copies of its recipes and by version `by` of the rules; None: its
    own.

    An unreadable copy is missing evidence. `counts_lacking` as in `Evidence`, `measuring` as in
    `judge`.
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
        counts_lacking,
    )
    judgement = judge(evidence, acceptance, own_version(manifest) if by is None else by, measuring)
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


def own_version(manifest: Manifest) -> int:
    """Return the version of the rules that judged the run, or the latest if that is not known
    here.
    """
    return manifest.rules if is_known(manifest.rules) else RULES


def is_cut_off(manifest: Manifest) -> bool:
    """Whether the recorder crashed and `recover` wrote the record's end."""
    return manifest.exit_status == "lost"


def check_verdict(folder: Path, manifest: Manifest) -> VerdictCheck:
    """Compare a run's sealed verdict with that of its record by the same version of the rules; of a
    run that was cut off, with what `recover` gives.
    """
    if manifest.verdict is None:
        return VerdictCheck()
    if is_cut_off(manifest):
        return VerdictCheck([*_not_by_recovery(folder, manifest)])
    why = _why_not(folder, manifest)
    if why is not None:
        return VerdictCheck(
            notes=[f"verdict: judged by rules {manifest.rules}, not recomputable here: {why}"]
        )
    differing = _differing(manifest, judge_again(folder, manifest))
    if (
        differing
        and manifest.rules == 1
        and not _differing(manifest, judge_again(folder, manifest, counts_lacking=False))
    ):
        differing = []
    version = manifest.host.get("jbclog", "not known")
    by = "" if version == __version__ else f"; it was judged by jbclog {version}"
    notes = [
        f"verdict, {name}: judged by rules {manifest.rules}, not recomputable here"
        for name in _not_kept_rules(manifest)
    ]
    return VerdictCheck(
        [
            f"verdict{name}: was {was}, its record gives {gives}{by}"
            for name, was, gives in differing
        ],
        notes,
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
        and _why_not(folder, manifest) is None
        and judge_again(folder, manifest).verdict is not Verdict.NOT_JUDGED
    ):
        yield f"verdict: was {manifest.verdict}, but its recipes have limits"


def _not_kept_rules(manifest: Manifest) -> list[str]:
    """Return the rules of the sealed verdict that this jbclog cannot apply in their form of
    then.
    """
    return sorted(
        {name for name, *_ in _by_place(manifest.verdict_rules)} & not_kept(manifest.rules)
    )


def _differing(manifest: Manifest, judgement: Judgement) -> list[tuple[str, object, object]]:
    """Return what differs in the rules, each with the sealed and the new value: results first."""
    before, now = _by_place(manifest.verdict_rules), _by_place(judgement.rules_as_dicts())
    gone = not_kept(manifest.rules)
    places = [place for place in {**before, **now} if place[0] not in gone]
    found: list[tuple[str, object, object]] = [
        (_named(place), _result(before.get(place)), _result(now.get(place))) for place in places
    ]
    if not _not_kept_rules(manifest):
        found.insert(0, ("", manifest.verdict, judgement.verdict))
    if differing := [one for one in found if one[1] != one[2]]:
        return differing
    return [one for place in places for one in _other_figures(place, before[place], now[place])]


def _other_figures(
    place: Place, before: Sequence[SealedRule], now: Sequence[SealedRule]
) -> Iterator[tuple[str, object, object]]:
    """Yield limit and observed figure if they differ. Words are not compared, because a later
    jbclog may have others; nor figures of joints, whose search depends on the libraries.
    """
    for name in ("limit",) if place[0] in OF_JOINTS else ("limit", "observed"):
        for one, other in zip(before, now, strict=True):
            was, gives = one.get(name), other.get(name)
            if isinstance(gives, int | float) and not (
                isinstance(was, int | float) and isclose(was, gives, rel_tol=SAME, abs_tol=SAME)
            ):
                yield f"{_named(place)}, {name}", was, gives


def _why_not(folder: Path, manifest: Manifest) -> str | None:
    """Return why the verdict cannot be recomputed; None if it can."""
    if not is_known(manifest.rules):
        return f"this jbclog knows rules 1 to {RULES}"
    unread = [
        facts for facts in _recipes(folder, manifest)[1] if _is_as_sealed(folder, manifest, facts)
    ]
    if unread:
        return f"this jbclog cannot read the recipe of {', '.join(facts.name for facts in unread)}"
    return None


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
    """Return the rules of each place: one, unless somebody has added another. A forged rule may
    lack anything.
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
