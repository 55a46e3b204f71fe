"""The recorded examples of the notebooks: runs of virtual stations on a clock that jumps, kept in notebooks/data.

``python tests/support/notebook_data.py [NAME...]`` records them anew (all, or those named). The same program gives the same
values; bytes may differ with the versions of what writes them. What was put into each of them stands here, and
tests/docs/test_example_notebooks.py holds the notebooks against it.
"""

from __future__ import annotations

import lzma
import random
import shutil
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from recorded_run import RecordedRun

from jbclog import __version__, dossier
from jbclog.clock import VirtualClock
from jbclog.plan import Metadata, Wanted, make_plan
from jbclog.record import folder as folders

HOME = Path(__file__).parents[2] / "notebooks" / "data"

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
delay_s = 1.5

[alarm.low]
limit_c = 250
delay_s = 5.0
{more}
[run]
status = "working"

[acceptance]
coverage_percent = 95
longest_gap_s = 5
idle_error_c = 15
idle_sd_c = 5
alarms_max = 0
"""
FEEDER = """
[feeder]
mode = "discontinuous"
length_mm = 5.0
speed_mm_s = 10.0
diameter_mm = 1.0
"""
STATION = """
[[station]]
name = "{name}"
url = "/dev/serial/by-id/usb-{name}"
family = "{family}"
ports = {ports}
rated_power_w = 130

[station.sim]
noise_c = {noise_c}
{sim}
"""


@dataclass(frozen=True)
class Station:
    """A station of an example: what is told of it in the line file."""

    name: str
    sim: str
    family: str = "dde"
    ports: tuple[int, ...] = (1,)
    noise_c: float = 0.4

    @property
    def text(self) -> str:
        return STATION.format(name=self.name, family=self.family, ports=list(self.ports), noise_c=self.noise_c, sim=self.sim)


@dataclass(frozen=True)
class Example:
    """One run: when it began (UTC), how long it took, on what."""

    began: datetime
    seconds: float
    stations: tuple[Station, ...]
    recipe: str = RECIPE.format(more="")
    rate: float = 10.0
    metadata: Metadata = field(default_factory=Metadata)


# -- what is recorded -------------------------------------------------------------------------------------------------------------


def _fault(kind: str, at_s: float, for_s: float, more: str = "") -> str:
    return f'\n[[station.sim.fault]]\nkind = "{kind}"\nat_s = {at_s}\nfor_s = {for_s}\n{more}\n'


def alarm() -> Iterator[Example]:
    """Five excursions: plain, too short, with the cable out meanwhile, with its flag lost, with its samples lost."""
    sim = "joints_per_minute = 12\njoint_seconds = 1.5\n"
    sim += _fault("overheat", 20, 6, "by_c = 18.0")
    sim += _fault("overheat", 41.2, 1.2, "by_c = 25.0")
    sim += _fault("overheat", 60, 10, "by_c = 15.0") + _fault("dropout", 63, 3.5)
    sim += _fault("overheat", 90, 4, "by_c = 12.0") + _fault("silence", 90, 9, 'command = "alarm_flags"')
    sim += _fault("overheat", 111, 3, "by_c = 20.0") + _fault("silence", 110.5, 6.5, 'command = "tip_temperature"')
    told = Metadata("M. Weber", "88123", "controller C4")
    yield Example(datetime(2026, 11, 9, 6, 30, tzinfo=UTC), 130, (Station("dde-1", sim),), metadata=told)


def joints() -> Iterator[Example]:
    """Two minutes of joints with wire; in one of them the cable is out."""
    sim = 'model = "ALE"\njoints_per_minute = 10\njoint_seconds = 1.8\nfeed_each_joint = true\n' + _fault("dropout", 79.6, 3.2)
    told = Metadata("M. Weber", "88130", "controller C4", wire_lots=("W-2291",), tips=("T-0231",))
    recipe = RECIPE.format(more=FEEDER)
    yield Example(datetime(2026, 11, 10, 9, 15, tzinfo=UTC), 120, (Station("ale-1", sim, "ale"),), recipe, metadata=told)


NEW_TIP = 13
"""The run (counted from 0) before which the tip in port 1 was exchanged."""


def capability() -> Iterator[Example]:
    """Twenty days, a minute each: joints take dde-1 longer every day until its tip is exchanged, dde-2 stays as it is."""
    scatter = random.Random(20261019)
    for day in range(20):
        worn = day if day < NEW_TIP else day - NEW_TIP
        tips = (f"dde-1:1={'T-0231' if day < NEW_TIP else 'T-0244'}", "dde-2:1=T-0198")
        took = (1.3 + 0.05 * worn + scatter.gauss(0, 0.05), 1.4 + scatter.gauss(0, 0.02))
        sim = "joints_per_minute = 12\njoint_seconds = {:.3f}\nseed = {}"
        stations = (Station("dde-1", sim.format(took[0], 2 * day)), Station("dde-2", sim.format(took[1], 2 * day + 1)))
        began = datetime(2026, 10, 19, 7, 0, tzinfo=UTC) + timedelta(days=day)
        yield Example(began, 60, stations, metadata=Metadata("A. Rossi", "88140", "controller C4", tips=tips))


VISITS = (0, 41, 84, 125, 168, 209, 252, 293, 336, 380, 540, 582, 623, 666, 707, 728)
"""Days after the first of the counters' readings; for five months nobody looked."""
RESET, RESTARTED, REFUSED = 293, 270, 582  # the day it was seen, the day it was done; work hours are not told that day
FEEDS_A_DAY, MM_A_FEED = 190, 4.9
WORK_H_A_DAY = {"dde-1": 6.2, "ale-1": 4.4}


def worked_days() -> list[float]:
    """How many days each station had worked by each visit."""
    days, pace = [0.0], random.Random(20241118)
    for before, after in pairwise(VISITS):
        days.append(days[-1] + (after - before) * 5 / 7 * pace.uniform(0.8, 1.15))
    return days


def counters() -> Iterator[Example]:
    """Two years in sixteen glances: dde-1 is reset, the feeder's cycles of ale-1 roll over after 99999, an answer is refused."""
    days = worked_days()
    for day, worked in zip(VISITS, days, strict=True):
        since = worked if day < RESET else worked - float(np.interp(RESTARTED, VISITS, days))
        fed = round(worked * FEEDS_A_DAY)
        dde = _counts(4200 if day < RESET else 0, since, 9.0, WORK_H_A_DAY["dde-1"])
        ale = _counts(900, worked, 9.0, WORK_H_A_DAY["ale-1"]) | {
            "dispensed_cycles": (31_000 + fed) % 100_000,
            "dispensed_length": round((31_000 + fed) * MM_A_FEED, 1),
        }
        refused = _fault("nak", 0, 60, 'command = "work_hours"\ncode = 3') if day == REFUSED else ""
        stations = (
            Station("dde-1", _told(dde)),
            Station("ale-1", 'model = "ALE"\n' + _told(ale) + refused, "ale"),
        )
        began = datetime(2024, 11, 18, 6, 0, tzinfo=UTC) + timedelta(days=day)
        yield Example(began, 4, stations, rate=1.0, metadata=Metadata("maintenance"))


def _counts(before_h: float, days: float, plugged: float, work: float) -> dict[str, float]:
    """What a station shows after so many working days of so many hours."""
    return {
        "plugged_hours": int(before_h + days * plugged),
        "work_hours": int((before_h + days * plugged) * work / plugged),
        "sleep_hours": int((before_h + days * plugged) * (plugged - work) / plugged * 0.8),
        "sleep_cycles": int((before_h / plugged + days) * 14),
    }


def _told(counts: Mapping[str, float]) -> str:
    return "joints_per_minute = 0\n[station.sim.counters]\n" + "\n".join(f"{name} = {value}" for name, value in counts.items())


EXAMPLES: dict[str, Callable[[], Iterator[Example]]] = {
    "alarm": alarm,
    "joints": joints,
    "capability": capability,
    "counters": counters,
}


# -- recording it -----------------------------------------------------------------------------------------------------------------


@contextmanager
def _nowhere(seed: int) -> Iterator[None]:
    """The record names no machine, and the letters at the end of its name are the same each time."""
    letters = random.Random(seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dossier, "_host", lambda: {"name": "bench-pc", "system": "virtual", "jbclog": __version__})
        patch.setattr(folders.secrets, "choice", letters.choice)
        yield


def record(one: Example, out: Path, seed: int) -> Path:
    """The run's folder below `out`."""
    with tempfile.TemporaryDirectory() as aside, _nowhere(seed):
        line, recipe = Path(aside, "line.toml"), Path(aside, "recipe.toml")
        line.write_text('[line]\nname = "bench-3"\n' + "".join(station.text for station in one.stations))
        recipe.write_text(one.recipe)
        plan = make_plan(Wanted(line, recipe, duration_s=one.seconds, rate=one.rate, metadata=one.metadata))
        return RecordedRun(plan, out, VirtualClock(utc=one.began.timestamp())).result.folder


def pack(folder: Path) -> None:
    """Many runs as one file, which is a twentieth of their size; the same runs give the same bytes."""
    with (
        lzma.open(folder.with_suffix(".tar.xz"), "wb") as out,
        tarfile.open(fileobj=out, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for path in sorted(folder.rglob("*")):
            tar.add(path, path.relative_to(folder), recursive=False, filter=_of_nobody)
    shutil.rmtree(folder)


def _of_nobody(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    entry.uid = entry.gid = entry.mtime = 0
    entry.uname = entry.gname = ""
    entry.mode = 0o755 if entry.isdir() else 0o644
    return entry


def main(names: list[str], home: Path = HOME) -> None:
    for name in names or EXAMPLES:
        shutil.rmtree(home / name, ignore_errors=True)
        for number, one in enumerate(EXAMPLES[name]()):
            print(record(one, home / name, number))
        if number:
            pack(home / name)


if __name__ == "__main__":
    main(sys.argv[1:])
