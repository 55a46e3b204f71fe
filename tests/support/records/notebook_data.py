"""The recorded examples of the notebooks: runs of virtual stations on a clock that jumps, kept in
notebooks/data.

``python tests/support records.notebook_data [NAME...]`` records them anew (all, or those named).
The same program gives the same values; bytes may differ with the versions of what writes them. What
was put into each of them stands here, and tests/docs/test_notebooks.py holds the notebooks against
it.
"""

from __future__ import annotations

import lzma
import random
import shutil
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from jbclog import __version__
from jbclog.app.run import run_record
from jbclog.app.run.options import Metadata
from jbclog.core.clock import VirtualClock
from jbclog.maintenance.counter_totals.observed import Fact, Observation
from jbclog.maintenance.ledger import add
from jbclog.record import folder as folders
from support.fleets.audit_fleet import Fleet, SimStation, iso
from support.virtual.recorded_run import RecordedRun, plan_in

HOME = Path(__file__).parents[3] / "notebooks" / "data"

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
        return STATION.format(
            name=self.name,
            family=self.family,
            ports=list(self.ports),
            noise_c=self.noise_c,
            sim=self.sim,
        )


@dataclass(frozen=True)
class Example:
    """One run: when it began (UTC), how long it took, on what."""

    began: datetime
    seconds: float
    stations: tuple[Station, ...]
    recipe: str = RECIPE.format(more="")
    rate: float = 10.0
    metadata: Metadata = field(default_factory=Metadata)


# -- what is recorded ------------------------------------------------------------------------------


def _fault(kind: str, at_s: float, for_s: float, more: str = "") -> str:
    return f'\n[[station.sim.fault]]\nkind = "{kind}"\nat_s = {at_s}\nfor_s = {for_s}\n{more}\n'


def alarm() -> Iterator[Example]:
    """Five excursions: plain, too short, with the cable out meanwhile, with its flag lost, with its
    samples lost.
    """
    sim = "joints_per_minute = 12\njoint_seconds = 1.5\n"
    sim += _fault("overheat", 20, 6, "by_c = 18.0")
    sim += _fault("overheat", 41.2, 1.2, "by_c = 25.0")
    sim += _fault("overheat", 60, 10, "by_c = 15.0") + _fault("dropout", 63, 3.5)
    sim += _fault("overheat", 90, 4, "by_c = 12.0") + _fault(
        "silence", 90, 9, 'command = "alarm_flags"'
    )
    sim += _fault("overheat", 111, 3, "by_c = 20.0") + _fault(
        "silence", 110.5, 6.5, 'command = "tip_temperature"'
    )
    told = Metadata("M. Weber", "88123", "controller C4")
    yield Example(
        datetime(2026, 11, 9, 6, 30, tzinfo=UTC), 130, (Station("dde-1", sim),), metadata=told
    )


def joints() -> Iterator[Example]:
    """Two minutes of joints with wire; in one of them the cable is out."""
    sim = (
        'model = "ALE"\njoints_per_minute = 10\njoint_seconds = 1.8\nfeed_each_joint = true\n'
        + _fault("dropout", 79.6, 3.2)
    )
    told = Metadata("M. Weber", "88130", "controller C4", wire_lots=("W-2291",), tips=("T-0231",))
    recipe = RECIPE.format(more=FEEDER)
    yield Example(
        datetime(2026, 11, 10, 9, 15, tzinfo=UTC),
        120,
        (Station("ale-1", sim, "ale"),),
        recipe,
        metadata=told,
    )


NEW_TIP = 13
"""The run (counted from 0) before which the tip in port 1 was exchanged."""


def capability() -> Iterator[Example]:
    """Twenty days, a minute each: joints take dde-1 longer every day until its tip is exchanged,
    dde-2 stays as it is.
    """
    scatter = random.Random(20261019)
    for day in range(20):
        worn = day if day < NEW_TIP else day - NEW_TIP
        tips = (f"dde-1:1={'T-0231' if day < NEW_TIP else 'T-0244'}", "dde-2:1=T-0198")
        took = (1.3 + 0.05 * worn + scatter.gauss(0, 0.05), 1.4 + scatter.gauss(0, 0.02))
        sim = "joints_per_minute = 12\njoint_seconds = {:.3f}\nseed = {}"
        stations = (
            Station("dde-1", sim.format(took[0], 2 * day)),
            Station("dde-2", sim.format(took[1], 2 * day + 1)),
        )
        began = datetime(2026, 10, 19, 7, 0, tzinfo=UTC) + timedelta(days=day)
        yield Example(
            began, 60, stations, metadata=Metadata("A. Rossi", "88140", "controller C4", tips=tips)
        )


# -- a ledger of the counter audit -----------------------------------------------------------------

LOOKED_AT = {"ale-1": (32, 48), "dde-1": (2, 168), "dde-2": (3, 168), "ucr-1": (38, 168)}
"""The stations of the ledger: which of the simulated fleet's each is, and how many hours lie
between two looks. One has a feeder whose counters run over, one was reset twice, one was exchanged
and nobody told, at one nothing happened."""

TASKS = """# What has to be done after how much use.
[[task]]
name = "tip-change"
title = "Change the tip"
counter = "work_h"
life_h = 300

[[task]]
name = "handpiece"
title = "Change the handpiece"
counter = "plugged_h"
life_h = 3200

[[task]]
name = "rollers"
title = "Change the feeder's rollers"
counter = "dispensed_mm"
life_m = 3000

[[task]]
name = "verification"
title = "Verify the tip temperature"
life_days = 90
"""


def simulated() -> dict[str, SimStation]:
    """Two years of audits, with the truth beside."""
    return {
        name: Fleet(every_h=every_h, years=2, misread=0, clocks=0.15).station(11, number)
        for name, (number, every_h) in LOOKED_AT.items()
    }


def ledger(home: Path = HOME) -> None:
    """The ledger and its tasks file, as one file."""
    folder = home / "counters"
    folder.mkdir(parents=True, exist_ok=True)
    told = sorted(
        (one for name, station in simulated().items() for one in _told(name, station)),
        key=lambda one: one[0],
    )
    add(folder / "counters.jsonl", [entry for _, entry in told])
    (folder / "tasks.toml").write_text(TASKS)
    pack(folder)


def _told(name: str, station: SimStation) -> list[tuple[str, Observation | Fact]]:
    """What was seen, what people told of it, and that they changed each tip when it was nearly used
    up; each with when it was.

    That is not the time that a line has: the clock was wrong now and then.
    """
    facts = list(station.facts)
    for port in sorted({port for port, _ in station.grown}):
        worked = station.true((port, "work_h"), station.moments[-1])
        facts += [_changed(station, port, number) for number in range(1, int(worked / 290) + 1)]
    seen = zip(map(iso, station.moments), station.seen, strict=True)
    entries: list[tuple[str, Observation | Fact]] = [*seen, *((fact.time, fact) for fact in facts)]
    return [(when, replace(one, line="bench-3", station=name)) for when, one in entries]


def _changed(station: SimStation, port: int, number: int) -> Fact:
    when = iso(station.when((port, "work_h"), 290.0 * number))
    return Fact(when, when, "A. Rossi", "", "", "tip-change", port, f"T-{100 * port + number}")


EXAMPLES: dict[str, Callable[[], Iterator[Example]]] = {
    "alarm": alarm,
    "joints": joints,
    "capability": capability,
}


# -- recording it ----------------------------------------------------------------------------------


@contextmanager
def _nowhere(seed: int) -> Iterator[None]:
    """The record names no machine, and the letters at the end of its name are always the same."""
    letters = random.Random(seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            run_record,
            "_host",
            lambda: {"name": "bench-pc", "system": "virtual", "jbclog": __version__},
        )
        patch.setattr(folders.secrets, "choice", letters.choice)
        yield


def record(one: Example, out: Path, seed: int) -> Path:
    """The run's folder below `out`."""
    with tempfile.TemporaryDirectory() as aside, _nowhere(seed):
        line = '[line]\nname = "bench-3"\n' + "".join(station.text for station in one.stations)
        plan = plan_in(
            Path(aside), line, one.recipe, one.seconds, rate=one.rate, metadata=one.metadata
        )
        return RecordedRun(plan, out, VirtualClock(utc=one.began.timestamp())).result.folder


def pack(folder: Path) -> None:
    """Many runs as one file, a twentieth of their size; the same runs give the same bytes."""
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
    if not names or "counters" in names:
        ledger(home)
    for name in [name for name in names if name != "counters"] or ([] if names else EXAMPLES):
        shutil.rmtree(home / name, ignore_errors=True)
        for number, one in enumerate(EXAMPLES[name]()):
            print(record(one, home / name, number))
        if number:
            pack(home / name)


if __name__ == "__main__":
    main(sys.argv[1:])
