"""Floods on links of a real run: other stations are no later, the run ends in time, the guard does
not act, memory is bounded.

``pytest -n0 -s -m campaign tests/faults/test_flood_campaign.py`` crosses bytes a second, shapes,
rates, numbers of flooded links and transports; the default slice is one run. Lateness is that of
the rows of the stations without a flood, compared with the same run without floods on the same
machine.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pandas as pd
import pytest

from support.campaigns.awaited import NOT_STARTED
from support.command import WireLog
from support.links.flooders import Flooded, Flooders
from support.links.flooding import SHAPES
from support.product import MAIN, SimProcess, check_run, read_manifest
from support.virtual.lines import line
from support.virtual.virtual_run import RECIPE

STATIONS: Final = 4
SECONDS: Final = 5
BEGIN_S: Final = 1.5  # after the order to work: the run is sampling by then
LATER_MS: Final = 50.0
ENDS_WITHIN_S: Final = 10.0
MOST_MB: Final = 40.0  # more than without a flood
AS_MANY_AS_TAKEN: Final = 0.0
FOR_EVER: Final = 1e6


@dataclass(frozen=True)
class Case:
    """One run."""

    transport: str = "tcp"
    shape: str = "copies of an answer"
    bytes_per_s: float = AS_MANY_AS_TAKEN
    rate: float = 5.0
    flooders: int = 2
    piece: int = 4096
    end_s: float = FOR_EVER
    capture: bool = False

    def __str__(self) -> str:
        return (
            f"{self.transport}, {self.shape}, {self.bytes_per_s:g} B/s in {self.piece},"
            f" {self.rate:g} Hz, {self.flooders}"
        )


class TooBusy(Exception):
    """The machine is so busy that stations answered too late for the rate."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run."""

    late_ms: float  # the latest row of the stations that are not flooded
    before_ms: float  # the same of the rows before the flood
    skipped: int  # of theirs
    over_s: float  # from the last of these rows to the end of the process
    peak_mb: float
    flooded: int  # stations with link.flooded
    kinds: frozenset[str]
    captured_kb: float
    unsafe: int


def run(case: Case, folder: Path, *, flooded: bool = True) -> Outcome:
    """Record a line whose first stations are flooded; safe orders must reach each of them."""
    names = [f"dde-{number}" for number in range(1, STATIONS + 1)]
    source = line(*("" for _ in names)).replace('family = "dde"', 'family = "dde"\nports = [1]')
    (folder / "source.toml").write_text(source)
    (folder / "recipe.toml").write_text(RECIPE + 'on_difference = "continue"\n')
    log = folder / "wire.jsonl"
    with SimProcess(folder / "source.toml", folder / "sim", log=log) as sim:
        plans = [
            Flooded(
                str(folder / f"near-{name}") if case.transport == "pty" else "",
                str(folder / "sim" / name),
                case.shape,
                case.bytes_per_s,
                BEGIN_S if flooded else FOR_EVER,
                case.end_s,
                case.piece,
                after="WPS1",
            )
            for name in names[: case.flooders]
        ]
        text = sim.line_path.read_text()
        with Flooders(folder / "flooders.json", plans) as served:
            for name, url in zip(names, served.urls, strict=False):
                text = re.sub(rf'(name = "{name}"\n(?:.*\n)*?url = )".*?"', rf'\1"{url}"', text)
            (folder / "sim" / "flooded.toml").write_text(text)
            ended = _recorded(folder, case)
            if NOT_STARTED in (folder / "said").read_text():
                raise TooBusy
        wire = WireLog(log)
        for name in names:
            told = [text for text in wire.writes(name) if text.startswith("WPS")]
            assert "WPS100001" in told, f"{name} was not told to stand: {told}"
    return _outcome(case, names, *ended)


def _recorded(folder: Path, case: Case) -> tuple[Path, float, float]:
    """Return the run's folder, the moment at which its process ended, and its peak memory in MB."""
    command = [
        sys.executable,
        "-c",
        MAIN,
        "run",
        str(folder / "recipe.toml"),
    ]
    command += [
        "--line",
        str(folder / "sim" / "flooded.toml"),
        "--out",
        str(folder / "runs"),
        "-d",
        f"{SECONDS}s",
    ]
    command += ["--rate", f"{case.rate:g}", *(["--capture"] if case.capture else [])]
    with (folder / "said").open("w") as said:
        process = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
        _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0  # it was waited for
    (run_folder,) = [path for path in (folder / "runs").iterdir() if path.is_dir()]
    return run_folder, pd.Timestamp.now("UTC").timestamp(), used.ru_maxrss / 1024


def _outcome(case: Case, names: list[str], folder: Path, ended_s: float, peak_mb: float) -> Outcome:
    assert check_run(folder) == []
    samples, events = pd.read_parquet(folder / "samples"), pd.read_parquet(folder / "events")
    others = samples[~samples["station"].isin(names[: case.flooders])]
    last = others["time"].max()
    facts = {one.name: one for one in read_manifest(folder).stations}
    assert {facts[name].outcome for name in names[case.flooders :]} == {"completed"}, facts
    floods = events[events["kind"] == "link.flooded"]["time"]
    before = (
        others["late_us"][others["time"] < floods.min() - pd.Timedelta(seconds=1.5)]
        if len(floods)
        else others["late_us"]
    )
    return Outcome(
        late_ms=float(others["late_us"].max()) / 1000,
        before_ms=float(before.dropna().max()) / 1000 if before.notna().any() else 0.0,
        skipped=int((others["quality"] == "skipped").sum())
        + sum(facts[name].skipped for name in names[case.flooders :]),
        over_s=ended_s - last.timestamp(),
        peak_mb=peak_mb,
        flooded=events[events["kind"] == "link.flooded"]["station"].nunique(),
        kinds=frozenset(events["kind"]),
        captured_kb=sum(path.stat().st_size for path in folder.glob("wire/*")) / 1024,
        unsafe=sum(len(facts[name].unsafe) for name in names),
    )


@cache
def sound(transport: str, rate: float, again: int = 0) -> Outcome:
    """The same run without a flood."""
    with TemporaryDirectory() as folder:
        return run(Case(transport, rate=rate), Path(folder), flooded=False)


def look_at(case: Case, folder: Path) -> tuple[Outcome, Outcome]:
    """Run the case; if the machine delayed others, run it and its reference run again."""
    for again in range(4):
        (folder / str(again)).mkdir()
        try:
            found, control = run(case, folder / str(again)), sound(case.transport, case.rate, again)
        except TooBusy:
            continue
        if found.late_ms - control.late_ms < LATER_MS and found.skipped <= control.skipped:
            break
    assert found.late_ms - control.late_ms < LATER_MS, (found, control)
    assert found.skipped <= control.skipped, (found, control)
    assert found.peak_mb - control.peak_mb < MOST_MB
    assert_bounded(
        found,
        case.flooders,
        is_flood=case.bytes_per_s >= A_FLOOD or case.bytes_per_s == AS_MANY_AS_TAKEN,
    )
    assert control.flooded == 0
    return found, control


def assert_bounded(found: Outcome, flooders: int, *, is_flood: bool = True) -> None:
    """The run ended in time and reported each flood, and nothing else."""
    assert found.over_s < ENDS_WITHIN_S
    assert found.flooded == flooders or (found.flooded < flooders and not is_flood)
    assert {
        kind for kind in found.kinds if kind.startswith(("guard.", "host.suspended", "run.failed"))
    } == set()


def test_two_servers_without_end_delay_nobody(tmp_path: Path) -> None:
    """From the first report: others were 1.4 s late, it took 62 s instead of 15, the guard killed
    the recorder.
    """
    for again in range(3):
        (tmp_path / str(again)).mkdir()
        with suppress(TooBusy):
            found = run(Case(capture=True), tmp_path / str(again))
            if found.late_ms - found.before_ms < LATER_MS:
                break
    assert found.late_ms - found.before_ms < LATER_MS
    assert_bounded(found, 2)
    assert found.unsafe == 2  # ordered, and not verified: each of their tools
    assert found.captured_kb < 1024


SPEEDS: Final = (3_000.0, 15_000.0, AS_MANY_AS_TAKEN)
# at 5 Hz answers of some 300 bytes are due each second; three thousand may be none
A_FLOOD: Final = 15_000.0


def cases() -> Iterator[Case]:
    """Yield each speed with each shape and transport; rates, numbers and pieces alternate."""
    turns = product((5.0, 1.0, 2.0), (1, 2, 3), (4096, 16, 64))
    others = list(turns)
    for number, (transport, speed, shape) in enumerate(product(("tcp", "pty"), SPEEDS, SHAPES)):
        rate, flooders, piece = others[(number * 5) % len(others)]
        yield Case(transport, shape, speed, rate, flooders, piece)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_every_speed_and_shape_over_every_transport(
    tmp_path: Path, counted: Callable[..., None]
) -> None:
    failed = []
    print(HEAD, flush=True)
    for number, case in enumerate(cases()):
        (tmp_path / str(number)).mkdir()
        try:
            print(_row(case, *look_at(case, tmp_path / str(number))), flush=True)
        except AssertionError as error:
            failed.append(f"{case}: {error}")
            print(failed[-1], flush=True)
        counted(runs=1)
    assert failed == []


HEAD: Final = """\
| transport | shape | bytes/s | piece | Hz | noticed | others later, ms | end behind last row, s | memory, MB |
|---|---|---|---|---|---|---|---|---|"""  # noqa: E501


def _row(case: Case, found: Outcome, control: Outcome) -> str:
    """Return a row of the table; differences are from the run without a flood."""
    speed = f"{case.bytes_per_s:g}" if case.bytes_per_s else "all that is taken"
    later, more = found.late_ms - control.late_ms, found.peak_mb - control.peak_mb
    told = f"{found.flooded} of {case.flooders}"
    cells = (
        case.transport,
        case.shape,
        speed,
        case.piece,
        f"{case.rate:g}",
        told,
        f"{later:+.1f}",
        f"{found.over_s:.1f}",
    )
    return "| " + " | ".join(map(str, (*cells, f"{more:+.0f}"))) + " |"
