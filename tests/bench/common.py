"""Shared by the benchmarks: virtual stations, contenders in their own processes, claims that pass
or fail.

Each benchmark is a script, ``python tests/bench/bench_NAME.py [--short]``. It serves virtual
stations in a process of their own and runs each contender on the same stations in a fresh process
(`in_own_process`). It prints a table and then a line ``PASS`` or ``FAIL`` per claim, and ends with
1 if one failed. ``--short`` is for CI and for a quick look: the same claims on a shorter run.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ParamSpec, TypeVar

from jbclog.core.serial_line import LineFormat
from jbclog.sim.process import SimProcess

sys.path.insert(0, str(Path(__file__).parents[1]))  # `support`: a script has only its own folder

LINE = LineFormat()
READ_S = LINE.read_s()  # 14.06 ms: an addressed read and its answer at 19200 8N1
HZ = 10

P = ParamSpec("P")
T = TypeVar("T")

RECIPE = """
[recipe]
name = "bench"
revision = 1
families = ["dde"]

[temperature]
select_c = 350

[sleep]
delay_min = 5

[hibernation]
delay_min = 30

[alarm.high]
limit_c = 450
delay_s = 1.00

[run]
status = "working"

[sampling]
rate_hz = {hz}
alarms_every_s = {alarms_every_s}
"""


# -- the virtual stations --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Bench:
    """Virtual stations while they are served: the line file for a run, and the ports for a bare
    loop.
    """

    folder: Path
    line: Path
    ports: list[str]
    wire_log: Path  # exists if requested

    def recipe(self, *, alarms_every_s: float = 2.0) -> Path:
        """Write a recipe file for them."""
        path = self.folder / "bench.toml"
        path.write_text(RECIPE.format(hz=HZ, alarms_every_s=alarms_every_s))
        return path


@contextmanager
def virtual_stations(
    count: int,
    *,
    ports: str = "[1]",
    turnaround_ms: float = 0.0,
    wire: bool = True,
    log: bool = False,
    baudrate: int = LINE.baudrate,
) -> Iterator[Bench]:
    """Serve `count` stations of family dde during the `with`; their sensors have a little noise."""
    with TemporaryDirectory(prefix="jbclog-bench-") as made:
        folder = Path(made)
        names = [f"dde-{number:03d}" for number in range(1, count + 1)]
        text = line_text(names, ports, turnaround_ms, wire, baudrate)
        (folder / "line.toml").write_text(text)
        wire_log = folder / "wire.jsonl"
        with SimProcess(
            folder / "line.toml", folder / "served", log=wire_log if log else None
        ) as stations:
            urls = [str(stations.line_path.parent / name) for name in names]
            yield Bench(folder, stations.line_path, urls, wire_log)


def line_text(
    names: Sequence[str],
    ports: str = "[1]",
    turnaround_ms: float = 0.0,
    wire: bool = True,
    baudrate: int = LINE.baudrate,
) -> str:
    """Return a line file of such stations."""
    station = """
[[station]]
name = "{name}"
url = "{name}"
family = "dde"
baudrate = {baudrate}
ports = {ports}
[station.sim]
turnaround_ms = {turnaround_ms}
wire = {wire}
noise_c = 0.5
"""
    tables = (
        station.format(
            name=name,
            baudrate=baudrate,
            ports=ports,
            turnaround_ms=turnaround_ms,
            wire=str(wire).lower(),
        )
        for name in names
    )
    return '[line]\nname = "bench"\n' + "".join(tables)


# -- processes and measurements --------------------------------------------------------------------


def in_own_process(call: Callable[P, T], *args: P.args, **keys: P.kwargs) -> T:
    """Return what `call` returns in a fresh Python process, in its main thread."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as own:
        return own.submit(call, *args, **keys).result()


def cpu_s() -> float:
    """Return the CPU seconds of this process with all its threads and its ended children."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the value that `percent` % of `values` do not exceed."""
    return sorted(values)[min(int(len(values) * percent / 100), len(values) - 1)]


# -- results ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Claim:
    """A promise: `holds` says whether this run meets it, `figure` by how much."""

    text: str
    holds: bool
    figure: str

    def __str__(self) -> str:
        return f"{'PASS' if self.holds else 'FAIL'}  {self.text}: {self.figure}"


def at_most(text: str, value: float, limit: float, unit: str = "") -> Claim:
    return Claim(text, value <= limit, f"{value:.3g}{unit} of at most {limit:g}{unit}")


def at_least(text: str, value: float, limit: float, unit: str = "") -> Claim:
    return Claim(text, value >= limit, f"{value:.4g}{unit} of at least {limit:g}{unit}")


def bytes_allow(who: str, shortest_s: float, least_s: float = READ_S) -> Claim:
    """The pacing must hold, or a ratio says nothing. `least_s` is the time of the bytes."""
    text = f"{who}: no exchange took less than its bytes allow"
    return Claim(
        text,
        shortest_s >= least_s,
        f"shortest {shortest_s * 1000:.2f} ms of at least {least_s * 1000:.2f} ms",
    )


def is_short(about: str | None) -> bool:
    """Read the command line: whether ``--short`` was given."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--short", action="store_true", help="the same claims on a shorter run")
    return bool(parser.parse_args().short)


def show(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table; its first column is text, the others are figures."""
    cells = [list(columns), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(row[place]) for row in cells) for place in range(len(columns))]
    print(title)
    for first, *others in cells:
        figures = "  ".join(
            text.rjust(width) for text, width in zip(others, widths[1:], strict=True)
        )
        print(f"  {first.ljust(widths[0])}  {figures}")


def _cell(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def judge(claims: Sequence[Claim]) -> int:
    """Print the claims; return the exit code."""
    print(*claims, sep="\n")
    return 0 if all(claim.holds for claim in claims) else 1
