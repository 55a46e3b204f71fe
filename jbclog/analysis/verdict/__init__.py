"""Judge a sealed run against the limits of its recipes. Missing evidence is never a pass.

Start with `verdict.py`, then `rules.py`, `port_rules.py`, `joint_rules.py`, `reached.py`;
`samples.py` measures a run in one pass, with `idle.py` for the tip at rest; `bounds.py` and
`quantiles.py` have the statistics.
"""

from jbclog.analysis.rules_number import RULES
from jbclog.analysis.verdict.acceptance import asks_for_joints
from jbclog.analysis.verdict.bounds import Bound
from jbclog.analysis.verdict.evidence import Evidence, Feeds, Joints, PortJoints, Recovery
from jbclog.analysis.verdict.reached import Targets
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.analysis.verdict.samples import PortMeasure, judged_signals, measure
from jbclog.analysis.verdict.verdict import Judgement, Verdict, judge

__all__ = [
    "RULES",
    "Bound",
    "Evidence",
    "Feeds",
    "Joints",
    "Judgement",
    "PortJoints",
    "PortMeasure",
    "Recovery",
    "Result",
    "Rule",
    "Targets",
    "Verdict",
    "asks_for_joints",
    "judge",
    "judged_signals",
    "measure",
]
