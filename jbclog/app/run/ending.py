"""The end of a run's record: its verdict, and the functions that close it.

Imported when the tools are safe: what reads sealed tables takes a tenth of a second and 18 MB.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jbclog.analysis.verdict import Evidence, PortJoints, Targets, asks_for_joints, judge
from jbclog.analysis.verdict.evidence import Joints
from jbclog.app.run.plan import Plan
from jbclog.core.errors import unexpected_error_text
from jbclog.core.outcome import Exit, findings, status
from jbclog.core.rows import StationFacts
from jbclog.record.conclude import conclude
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import Manifest

__all__ = ["conclude", "judge_run"]


def judge_run(
    folder: Path, plan: Plan, manifest: Manifest, record: str | None, cut_short: Exit | None
) -> None:
    """Add the verdict on the sealed rows to `manifest`; `record`: what the record lacks."""
    stations = manifest.stations
    exit_status = status(findings(stations, verdict=None, record=record, cut_short=cut_short))
    acceptance = {one.spec.name: one.recipe.acceptance for one in plan.stations}
    asking = [facts for facts in stations if asks_for_joints(acceptance[facts.name])]
    targets = {
        one.spec.name: Targets(one.recipe.heated_ports(), one.recipe.run.status)
        for one in plan.stations
    }
    evidence = Evidence(
        folder,
        stations,
        ledger_of(folder, stations),
        exit_status,
        record,
        manifest.verifications,
        _joints(folder, asking, manifest.t0_utc),
        manifest.goals,
        targets,
    )
    judgement = judge(evidence, acceptance)
    manifest.verdict = judgement.verdict.value
    manifest.verdict_rules = judgement.rules_as_dicts()


def _joints(folder: Path, stations: Sequence[StationFacts], t0_utc: float | None) -> Joints:
    """Return the joints of the stations whose recipes limit them; only these import the
    analysis.
    """
    if not stations:
        return {}
    try:
        from jbclog.analysis.joints.evidence import joint_evidence

        return joint_evidence(folder, stations, t0_utc)
    except Exception as error:  # an internal error; the record must still be concluded
        unknown = PortJoints(
            why=f"Its joints could not be looked for: {unexpected_error_text(error)}."
        )
        return {(facts.name, port): unknown for facts in stations for port in facts.ports}
