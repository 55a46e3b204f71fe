"""Four runs whose reports are to be looked at: a calm one, a bad one, eight hours, and one of
sixteen stations.

``python tests/support records.report_runs DIR [NAME...]`` records them on virtual stations and a
clock that jumps, and writes their reports. Eight hours take minutes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import make_plan
from jbclog.report.write import write_report
from support.virtual.lines import fault
from support.virtual.recorded_run import RecordedRun

RECIPE = """[recipe]
name = "sn100c-tht"
revision = 7
families = ["dde", "ale"]

[temperature]
select_c = 350

[sleep]
delay_min = 5

[hibernation]
delay_min = 30

[alarm.high]
limit_c = 380
delay_s = 1.6

[alarm.low]
limit_c = 300
delay_s = 5.0

[run]
status = "working"

[acceptance]
coverage_percent = 99.5
longest_gap_s = 5
idle_error_c = 15
idle_sd_c = 5
alarms_max = 0
"""
STATION = """
[[station]]
name = "{family}-{number}"
url = "{family}-{number}"
family = "{family}"
rated_power_w = 130

[station.sim]
seed = {number}
turnaround_ms = 1.0
noise_c = 0.7
{sim}
"""
SAID = Metadata("M. Weber", "WO-88123", "PCB-4711 rev C", (), {"shift": "B", "wire_lot": "SN-2211"})

BAD = (
    fault("flip", at_s=20.0, every=60)
    + fault("dropout", at_s=60.0, for_s=9.5)
    + fault("overheat", at_s=130.0, for_s=9.0, port=1, by_c=25.0)
    + fault("tool", at_s=190.0, for_s=12.0, port=2, code=0)
)
DAY = (
    fault("silence", at_s=100.0, only="read", every=499)
    + fault("dropout", at_s=7_000.0, for_s=3.9)
    + fault("overheat", at_s=16_000.0, for_s=8.0, by_c=15.0)
    + fault("dropout", at_s=21_000.0, for_s=48.0)
)


@dataclass(frozen=True)
class Wish:
    """A run: its stations' families with what befalls them, how long and how fast."""

    stations: tuple[tuple[str, str], ...]
    seconds: float
    hz: float


RUNS = {
    "calm": Wish((("dde", ""),), 150.0, 10.0),
    "bad": Wish(
        (("dde", BAD), ("ale", "feed_each_joint = true\n" + fault("nak", at_s=40.0, for_s=30.0))),
        240.0,
        10.0,
    ),
    "eight_hours": Wish((("ale", "feed_each_joint = true\n" + DAY),), 8 * 3600.0, 5.0),
    "sixteen": Wish(
        tuple(("dde", BAD if number == 11 else "") for number in range(16)), 240.0, 5.0
    ),
}


def recorded(name: str, out: Path) -> Path:
    """Record one of `RUNS` below `out`; give its folder."""
    request, home = RUNS[name], out / name
    home.mkdir(parents=True)
    line, recipe = home / "line.toml", home / "tht.toml"
    stations = [
        STATION.format(family=family, number=n, sim=sim)
        for n, (family, sim) in enumerate(request.stations, 1)
    ]
    line.write_text('[line]\nname = "bench-3"\n' + "".join(stations))
    recipe.write_text(RECIPE)
    plan = make_plan(
        RunOptions(line, recipe, duration_s=request.seconds, rate=request.hz, metadata=SAID)
    )
    return RecordedRun(plan, home / "runs").result.folder


if __name__ == "__main__":
    for one in sys.argv[2:] or RUNS:
        folder = recorded(one, Path(sys.argv[1]))
        print(write_report(folder))
