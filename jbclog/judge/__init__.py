"""VERDICT. What a sealed run is worth against the limits that its recipes state.

Owns: the definitions of coverage, longest gap, idle error and counted alarms, and what is asked of joints; the rules; the verdict.
Never: measures what was not recorded, takes missing evidence for good, imports pandas or matplotlib (the
recorder calls it when a run has ended), writes a file.
May use: `rows`, `foreign` and `errors`; pyarrow and numpy.
Start reading: `verdict.py`, then `rules.py`; `samples.py`, `idle.py` and `bound.py` say how each figure is measured.
"""

from jbclog.judge.acceptance import Acceptance, Limits, asks_for_joints
from jbclog.judge.bound import Bound
from jbclog.judge.evidence import Evidence
from jbclog.judge.jointed import Feeds, Joints, PortJoints, Recovery
from jbclog.judge.reached import Asks
from jbclog.judge.rule import Result, Rule
from jbclog.judge.samples import PortMeasure, judged_signals, measure
from jbclog.judge.verdict import Judgement, Verdict, judge
from jbclog.judge.versions import RULES

__all__ = [
    "RULES",
    "Acceptance",
    "Asks",
    "Bound",
    "Evidence",
    "Feeds",
    "Joints",
    "Judgement",
    "Limits",
    "PortJoints",
    "PortMeasure",
    "Recovery",
    "Result",
    "Rule",
    "Verdict",
    "asks_for_joints",
    "judge",
    "judged_signals",
    "measure",
]
