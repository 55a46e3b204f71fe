"""docs/reference/verdict.md: the rules of the verdict, its versions, deviations, and the
definitions of all metrics.
"""

from __future__ import annotations

from collections.abc import Mapping

from jbclog.analysis.rules_number import RULES as NUMBER
from jbclog.analysis.run import Run
from jbclog.analysis.verdict.rule import Result
from jbclog.analysis.verdict.rules import NOT_AS_PLANNED
from support.pages.md_table import MADE, code, codes, table

VERDICTS = """
| verdict | when |
| --- | --- |
| `ACCEPT` | at least one rule passes, none fails, no evidence is missing, nothing deviates |
| `ACCEPT WITH DEVIATIONS` | the same, but something deviates |
| `REJECT` | a rule fails |
| `INCONCLUSIVE` | no rule fails, but evidence is missing or no rule passes |
| `NOT JUDGED` | no recipe of the run has limits |
"""

RESULTS: Mapping[Result, str] = {
    Result.PASS: "the limit is met",
    Result.FAIL: "the limit is violated",
    Result.MISSING: "there is not enough evidence",
    Result.DEVIATION: "no limit is violated, but something was not as planned",
    Result.NOT_APPLICABLE: "the limit does not apply to the station",
}

RULES: Mapping[str, tuple[str, str]] = {
    "record": (
        "always",
        "The record runs from start to end. Ended early: a deviation. Cut off by a crash: missing.",
    ),
    "station": (
        "always",
        (
            "The station was recorded to the end. Stopped by a changed setting: fails. Refused,"
            " gone, failed: missing. Left out as allowed: a deviation."
        ),
    ),
    "settings": (
        "always",
        (
            "Every setting of the recipe is confirmed. Refused or different: fails. Not read back:"
            " missing. Unknown to the station: a deviation."
        ),
    ),
    "ports": ("always", "At least one port was recorded with a tool."),
    "no_tool": ("always", "A port that never had a tool is a deviation and is not judged."),
    "no_acceptance": (
        "always",
        (
            "A station whose recipe has no limit, or none that applies to it, is a deviation and is"
            " not judged."
        ),
    ),
    "confidence": (
        '`confidence = "none"`',
        "Judges bare figures, without bounds. This rule only states it.",
    ),
    "coverage": (
        "`coverage_percent`",
        (
            "Readings obtained / readings due. Readings that the host missed are missing evidence,"
            " not a failure. One isolated miss does not violate a limit in per cent."
        ),
    ),
    "longest_gap": (
        "`longest_gap_s`",
        (
            "The longest [gap](../explanation/record.md#gaps) in the temperature, from one reading"
            " to the next. It may be a period longer than the limit: any two readings are a period"
            " apart. Readings that the host missed are missing evidence, not a failure."
        ),
    ),
    "alarms": (
        "`alarms_max`",
        "Events `alarm.high` and `alarm.low`. Flags that were never read: missing.",
    ),
    "reached": (
        "`reached_within_c`, `at_work_percent`",
        (
            "A tool that was ordered to work reached its setpoint and kept working. Never ordered:"
            " missing."
        ),
    ),
    "idle_error": (
        "`idle_error_c`",
        (
            "Mean deviation of the tip at rest from its setpoint, with its 95 % bound. No rest of"
            " 5 min: missing."
        ),
    ),
    "idle_sd": ("`idle_sd_c`", "Standard deviation of the tip at rest, with its 95 % bound."),
    "verification": (
        "`verification_days`",
        (
            "The tip passed a verification, recently enough and with the run's adjustment. Failed:"
            " fails. None, too old, another tip, another adjustment: missing."
        ),
    ),
    "recovery_p95": (
        "`recovery_p95_s`",
        "95th percentile of the recovery time, with its 95 % bound. Fewer than 59 joints: missing.",
    ),
    "recovered_before_next": (
        "`recovered_before_next_percent`",
        "Share of the joints after which the tip recovered before the next one.",
    ),
    "joints_against_counter": (
        "`joints_against_counter_percent`",
        "`ale`: joints found by heat, compared with feeds counted.",
    ),
    "goal_units": (
        "`--until-units`",
        "The stated number of units was finished. Fewer: a deviation.",
    ),
    "goal_joints": (
        "`--until-joints`",
        "The stated number of joints was found. Fewer: a deviation.",
    ),
}
"""Rule -> the limit that it belongs to, and what it judges."""

INTRODUCTION = """
A verdict is the result of a list of rules. It depends only on the sealed record; `jbclog check RUN` recomputes it.
An estimated figure meets its limit if both the figure and its 95 % bound do. If only the figure does, or there is no bound, evidence
is missing ([decision 31](../decisions/0031-bounds-and-missing-evidence.md)).
"""

METRICS = (
    "Used by `run.metrics()`, `jbclog trend`, `jbclog chart` and the report. A metric that the data"
    " cannot support has no value, but a reason. A tool *works* in the rows in which its status is"
    " working (hot air: on) and the readings of tool and port error before and after show the same"
    " tool in a port that works."
)
DEVIATIONS = (
    "All events of severity error or critical that no rule judges, and warnings of these kinds:"
)
OF_NUMBER = (
    f"The key `rules` of the manifest is the number of the rules that judged the run. This version"
    f" has rules {NUMBER}: they are numbered 0 until 1.0. `check` recomputes a verdict by these rules;"
    " of one by others it says that this version does not have them, and the verdict stays as it is."
)


def page() -> str:
    """The whole page."""
    rules = [(code(name), limit, text) for name, (limit, text) in RULES.items()]
    results = [(code(one.value), RESULTS[one]) for one in Result]
    metrics = [
        (code(one.metric), one.uom, one.definition, one.applies_to)
        for one in Run.metric_definitions().itertuples()
    ]
    sections = {
        "Results of a rule": table(("result", "means"), results),
        "Rules": table(("rule", "limit in the recipe", "judges"), rules),
        "Deviations": f"{DEVIATIONS}\n\n{codes(sorted(NOT_AS_PLANNED))}",
        "Number of the rules": OF_NUMBER,
        "Metrics": f"{METRICS}\n\n{table(('metric', 'unit', 'definition', 'applies to'), metrics)}",
    }
    head = f"{MADE}\n\n# Verdict and metrics\n{INTRODUCTION}{VERDICTS}".strip()
    return (
        "\n\n".join([head, *(f"## {title}\n\n{text}" for title, text in sections.items())]) + "\n"
    )
