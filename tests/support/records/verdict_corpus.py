"""Small runs of every verdict. Those in tests/data/verdicts were made by the package of commit
9c5b716 and judged by its rules, 1; `noted.json` has what each was judged.

Each is a small run of virtual stations on a clock that jumps, packed. Between them they have every
verdict and most families.
"""

from __future__ import annotations

import json
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.core.clock import VirtualClock
from jbclog.record.annotations import append
from jbclog.record.manifest import read_manifest
from jbclog.report.write import write_report
from support.virtual.lines import fault
from support.virtual.recorded_run import RecordedRun

HOME = Path(__file__).parents[2] / "data" / "verdicts"
PROFILES = Path(__file__).parents[3] / "profiles" / "recipes"
EPOCH_S = 1_790_000_000.0

STATION = """
[[station]]
name = "{family}-1"
url = "{family}-1"
family = "{family}"

[station.sim]
seed = 4
turnaround_ms = 1.0
{sim}
"""
SOLDERING = """[recipe]
name = "{name}"
revision = 1
families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]

[temperature]
select_c = 350

[sleep]
delay_min = 5

[hibernation]
delay_min = 30

[alarm.high]
limit_c = 390
delay_s = 1.6
"""
WORKING = '\n[run]\nstatus = "working"\n'
ASKED = (
    "\n[acceptance]\ncoverage_percent = {coverage}\nlongest_gap_s = 5\nidle_error_c = 15\nidle_sd_c"
    " = 5\nalarms_max = 0\n"
)
ONLY_COVERAGE = "\n[acceptance]\ncoverage_percent = 99.5\n"
OF_JOINTS = ASKED + "recovery_p95_s = 4\njoints_against_counter_percent = 5\n"
HOT_AIR = """[recipe]
name = "air"
revision = 1
families = ["jtse"]

[air]
mode = "manual"
flow_permille = 600
temperature_c = 330

[run]
status = "on"

[acceptance]
coverage_percent = 99.5
longest_gap_s = 1
idle_error_c = 10
"""


class StallingClock(VirtualClock):
    """One that stands still for the program `for_s` at each of these seconds: the host was busy
    with something else.
    """

    def __init__(self, at_s: Sequence[float], for_s: float) -> None:
        super().__init__()
        self._at, self._for_s = [self.monotonic() + second for second in at_s], for_s

    def advance_to(self, moment: float) -> None:
        while self._at and self._at[0] <= moment:
            moment = max(moment, self._at.pop(0) + self._for_s)
        super().advance_to(moment)


@dataclass(frozen=True)
class Wish:
    """One run: its station, its recipe, and what befalls it."""

    family: str
    recipe: str
    seconds: float
    hz: float
    sim: str = ""
    stalls_s: tuple[float, ...] = ()
    has_report: bool = True


def _soldering(name: str, *parts: str, coverage: float = 99.5) -> str:
    return "".join([SOLDERING, *parts]).format(name=name, coverage=coverage)


RUNS = {
    "accepted": Wish("nae", _soldering("accepted", WORKING, ASKED), 60.0, 4.0, "tool = 2"),
    "deviations": Wish(
        "ale",
        _soldering("deviations", WORKING, OF_JOINTS, coverage=95),
        220.0,
        4.0,
        "joints_per_minute = 20\nfeed_each_joint = true\n"
        + fault("dropout", at_s=100.0, for_s=2.0),
    ),
    "rejected": Wish(
        "jtse", HOT_AIR, 40.0, 4.0, "tool = 1\n" + fault("dropout", at_s=25.0, for_s=3.0)
    ),
    "inconclusive": Wish(
        "soldering",
        _soldering("inconclusive", WORKING, ASKED),
        14.0,
        2.0,
        "tool = 2",
        has_report=False,
    ),
    "not_judged": Wish(
        "omega", (PROFILES / "omega-point.toml").read_text().split("[acceptance]")[0], 20.0, 1.0
    ),
    "cold": Wish("dde", _soldering("cold", ONLY_COVERAGE), 40.0, 4.0),
    "busy_host": Wish(
        "ucr",
        _soldering("busy", WORKING, ONLY_COVERAGE),
        48.5,
        4.0,
        "tool = 2",
        (15.0, 25.0, 35.0),
        False,
    ),
}
OMEGA_SIM = (
    'settings = { condition_101 = "0065 0  003 014 064 005 064  008 01E 050 005 064  00A 000 000'
    ' 00A 0C8" }'
)


GAP = "\n[acceptance]\ncoverage_percent = 80\nlongest_gap_s = 5\n"
ALARMS = "\n[acceptance]\nalarms_max = 0\n"
MORE_RUNS = {
    "rested": Wish(
        "nae", _soldering("rested", WORKING, ASKED), 330.0, 4.0, "tool = 2\njoints_per_minute = 0"
    ),
    "alarm": Wish(
        "dde",
        _soldering("alarm", WORKING, ALARMS),
        40.0,
        4.0,
        "tool = 2\n" + fault("overheat", at_s=20.0, for_s=8.0, port=1, by_c=30.0),
    ),
    "flags_not_read": Wish(
        "dde",
        _soldering("flags", WORKING, ALARMS),
        20.0,
        4.0,
        "tool = 2\n" + fault("nak", command="alarm_flags"),
    ),
    "bare_figures": Wish(
        "nae",
        _soldering("bare", WORKING, ASKED + 'confidence = "none"\n'),
        30.0,
        4.0,
        "tool = 2\njoints_per_minute = 0",
    ),
    "off_by_20": Wish(
        "dde",
        _soldering("off", WORKING, ASKED),
        90.0,
        4.0,
        "tool = 2\njoints_per_minute = 0\nnoise_c = 9.0\n"
        + fault("overheat", at_s=20.0, port=2, by_c=5.0),
    ),
    "gap": Wish(
        "dde",
        _soldering("gap", WORKING, GAP),
        60.0,
        4.0,
        "tool = 2\n" + fault("dropout", at_s=25.0, for_s=7.0),
    ),
    "short_gap": Wish(
        "dde",
        _soldering("short", WORKING, GAP),
        60.0,
        4.0,
        "tool = 2\n" + fault("dropout", at_s=25.0, for_s=1.0),
    ),
    "gone": Wish(
        "dde",
        _soldering("gone", WORKING, ONLY_COVERAGE),
        20.0,
        4.0,
        "tool = 2\n" + fault("dropout", at_s=10.0, for_s=500.0),
    ),
    "no_robot_mode": Wish(
        "dde", _soldering("robot", WORKING, ONLY_COVERAGE), 10.0, 4.0, "robot_mode = false"
    ),
    "no_tool_in_port_2": Wish(
        "dde",
        _soldering("tool", WORKING + "require_tool = false\n", ONLY_COVERAGE),
        30.0,
        4.0,
        "tools = {1 = 2, 2 = 0}",
    ),
    "not_verified": Wish(
        "dde",
        _soldering("verified", WORKING, "\n[acceptance]\nverification_days = 30\n"),
        20.0,
        4.0,
        "tool = 2",
    ),
    "recovery": Wish(
        "dde",
        _soldering(
            "recovery",
            WORKING,
            "\n[acceptance]\nrecovery_p95_s = 4\nrecovered_before_next_percent = 90\n",
        ),
        240.0,
        5.0,
        "tool = 2\njoints_per_minute = 20",
    ),
    "restarted": Wish(
        "dde",
        _soldering("restarted", WORKING, ONLY_COVERAGE),
        40.0,
        4.0,
        "tool = 2\n" + fault("restart", at_s=20.0, for_s=3.0),
    ),
    "setting_not_taken": Wish(
        "dde",
        _soldering("setting", WORKING, ONLY_COVERAGE).replace("delay_min = 5", "delay_min = 4"),
        20.0,
        4.0,
        "tool = 2\n" + fault("nak", command="sleep_delay", only="write"),
    ),
    "stuck_cold": Wish(
        "dde",
        _soldering("stuck", WORKING, ONLY_COVERAGE),
        48.5,
        4.0,
        "tool = 2\n" + fault("stuck", at_s=0.0, port=1),
    ),
}
"""Runs for rules and results that none of `RUNS` has."""


def record(name: str, home: Path) -> Path:
    """Record one of `RUNS` or `MORE_RUNS` below `home`; give its folder, with a note and, where it
    has one, a report.
    """
    request, folder = (RUNS | MORE_RUNS)[name], judge_new(name, home)
    append(
        folder,
        who="A. Rossi",
        what="SN-001 was scrapped",
        why="cracked joint",
        utc_s=EPOCH_S + 1000,
    )
    if request.has_report:
        write_report(folder)
    return folder


def judge_new(name: str, home: Path) -> Path:
    """Record and judge one of `RUNS` or `MORE_RUNS` below `home`; give its folder."""
    request = (RUNS | MORE_RUNS)[name]
    sim = request.sim or (OMEGA_SIM if request.family == "omega" else "")
    line, recipe = home / "line.toml", home / f"{name}.toml"
    line.write_text('[line]\nname = "bench"\n' + STATION.format(family=request.family, sim=sim))
    recipe.write_text(request.recipe)
    said = Metadata("M. Weber", "WO-88123", "PCB-4711 rev C", ("SN-001",), {"shift": "B"})
    plan = make_plan(
        RunOptions(line, recipe, duration_s=request.seconds, rate=request.hz, metadata=said)
    )
    return RecordedRun(plan, home / "runs", StallingClock(request.stalls_s, 0.6)).result.folder


def judged(folder: Path) -> dict[str, object]:
    """Its verdict and the result of each rule, as its manifest says."""
    manifest = read_manifest(folder)
    rules = [
        " ".join(str(rule[key]) for key in ("name", "station", "port", "result"))
        for rule in manifest.verdict_rules
    ]
    return {"verdict": manifest.verdict, "exit_code": manifest.exit_code, "rules": rules}


def rules_text(folder: Path) -> str:
    """The verdict, and a rule a line. Figures have the digits that each computer gives alike."""
    manifest = read_manifest(folder)
    lines = [f"{manifest.verdict}, exit code {manifest.exit_code}"]
    for rule in manifest.verdict_rules:
        figures = {
            key: float(f"{value:.6g}") if isinstance(value, float) else value
            for key, value in rule.items()
        }
        lines.append(json.dumps(figures, ensure_ascii=False))
    return "\n".join(lines) + "\n"


def unpack(archive: Path, out: Path) -> Path:
    """The run in it, below `out`."""
    with tarfile.open(archive) as kept:
        # Python before 3.11.4 has none
        kept.extraction_filter = getattr(tarfile, "data_filter", None)
        kept.extractall(out)
        return out / kept.getnames()[0]
