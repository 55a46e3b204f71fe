"""How cost grows: ``python tests/bench/bench_growth.py [PART...] [--out FOLDER] [--page] [--tiny |
--short]``.

Each part varies one thing (stations, rate, length of a run, runs in a folder) and
measures CPU, time, memory, bytes and lateness at each size. Each point becomes a line of
FOLDER/growth.jsonl, which is part of the repository, as soon as it is measured. So the program can
be stopped at any time; run again, it measures what is missing. ``--again`` measures the named parts
anew, ``--most N`` leaves out sizes beyond N. ``--page`` writes the reference page "How cost grows"
and its pictures from all points. ``--tiny`` tries everything with the smallest sizes, in a separate
file; ``--short`` does so in a temporary folder.

Run it on an idle machine. Stations and rates take 16 recordings of a minute (``--seconds``); the
week takes longest of the rest.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics as st
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[1]))

import pyarrow as pa
import pyarrow.compute as pc
from bench_many_runs import copies
from common import RECIPE, in_own_process, virtual_stations
from growth_page import Point, write_page
from recorder import record

from jbclog.analysis.rules_number import RULES
from jbclog.report.write import write_report
from support.records.sealed_run import samples, seal, station, table
from support.records.small_run import make_run

Figures = dict[str, float]
HOUR_ROWS: Final = 36_000
TIMES: Final = 3
HOME: Final = Path(__file__).parent
PEAK: Final = "VmHWM:"
PROGRAM: Final = f"""
import atexit, sys
from jbclog.cli import main
status = open("/proc/self/status")
peak = lambda: "".join(line for line in status if line.startswith("{PEAK}"))
atexit.register(lambda: sys.stderr.write(peak()))
main()
"""


@dataclass(frozen=True, slots=True)
class Part:
    """A series of points. `measure` takes a size and the seconds of a recording."""

    sizes: Sequence[int]
    tiny: Sequence[int]
    measure: Callable[[int, float], Figures]

    @property
    def about(self) -> str:
        """What is varied, and how it is measured, as the page says it."""
        return " ".join((self.measure.__doc__ or "").split())


def of_stations(count: int, seconds: float) -> Figures:
    """One port of each station, three fast reads at 10 Hz, on wires paced at 19200 8N1."""
    with virtual_stations(count) as stations:
        return in_own_process(
            recorded, stations.line, stations.recipe(), stations.folder / "runs", seconds
        )


def of_rates(hertz: int, seconds: float) -> Figures:
    """Ten stations at 115200 bit/s, on links that take no time: at 19200 bit/s a plan refuses more
    than 23 Hz.
    """
    with virtual_stations(10, wire=False, baudrate=115_200) as stations:
        recipe = stations.folder / "rate.toml"
        recipe.write_text(RECIPE.format(hz=hertz, alarms_every_s=2.0))
        return in_own_process(recorded, stations.line, recipe, stations.folder / "runs", seconds)


def recorded(line: Path, recipe: Path, out: Path, seconds: float) -> Figures:
    """Record a run in this process; CPU as a share of one core while all stations sample."""
    ours = record(line, recipe, out, seconds)
    return {
        "recorded, s": seconds,
        "CPU, % of a core": ours.cpu_us * ours.exchanges / ours.seconds / 1e4,
        "CPU of an exchange, µs": ours.cpu_us,
        "late, median, ms": ours.late_ms[0],
        "late, 99 %, ms": st.median(ours.late_tenths_ms),
        "late, 99 % of the worst tenth, ms": ours.late_tenths_ms[-1],
        "skipped, % of ticks": 100 * ours.ticks_skipped / ours.rows,
        "memory, MB": ours.peak_mb,
        "bytes of a row": size_of(out) / ours.rows,
    }


def of_lengths(seconds_long: int, _: float) -> Figures:
    """One port at 10 Hz, a joint each five seconds; made, not recorded."""
    with TemporaryDirectory(prefix="jbclog-growth-") as made:
        run = Path(in_own_process(sealed, Path(made), seconds_long * 10))
        found: Figures = {"record, MB": size_of(run) / 1e6}
        out = Path(made) / "out"
        for name, words in {
            "check": ["check", str(run)],
            "report": ["report", str(run)],
            "export csv": [
                "export",
                str(run),
                "--to",
                "csv",
                "--out",
                str(out),
                "--unchecked",
                "--force",
            ],
            "export mf4": [
                "export",
                str(run),
                "--to",
                "mf4",
                "--out",
                f"{out}.mf4",
                "--unchecked",
                "--force",
            ],
        }.items():
            cost = spent(words)
            found |= {f"{name}, s of CPU": cost["CPU"], f"{name}, MB": cost["MB"]}
        return found


def sealed(out: Path, rows: int) -> str:
    """Seal a run of that many rows, an hour repeated; return its folder."""
    hour = table(samples(min(rows, HOUR_ROWS)))
    pieces = [shifted(hour, number) for number in range(-(-rows // HOUR_ROWS))]
    return str(seal(out, [station(rows=rows)], pa.concat_tables(pieces)[:rows], rules=RULES))


def shifted(hour: pa.Table, number: int, hz: float = 10.0) -> pa.Table:
    """Return the rows of an hour, that many hours later."""
    ticks = pc.add(hour["tick"], round(number * 3600 * hz))
    moments = pc.add(hour["time"].cast(pa.int64()), number * 3_600_000_000).cast(
        hour.schema.field("time").type
    )
    return hour.set_column(1, hour.schema.field("tick"), ticks).set_column(
        0, hour.schema.field("time"), moments
    )


def of_folders(count: int, _: float) -> Figures:
    """Runs with the record of one, of two stations with its report; `again`: nothing has changed
    since the call before. Calls that change nothing are made three times; the least counts.
    """
    with TemporaryDirectory(prefix="jbclog-growth-") as made:
        folder = Path(made) / "runs"
        in_own_process(copied, Path(made) / "first", folder, count)
        cache = {"XDG_CACHE_HOME": str(Path(made) / "cache")}
        found: Figures = {}
        runs, trend = ["runs", str(folder)], ["trend", str(folder), "--metric", "recovery_s"]
        used = ["where-used", str(folder), "--station", "dde-1", "--since", "2040-01-01"]
        for name, words, times in (
            ("runs", runs, TIMES),
            ("where-used", used, TIMES),
            ("trend", trend, 1),
            ("trend again", trend, TIMES),
        ):
            calls = [spent(words, cache) for _ in range(times)]
            cost = {figure: min(call[figure] for call in calls) for figure in calls[0]}
            found |= {
                f"{name}, s": cost["s"],
                f"{name}, s of CPU": cost["CPU"],
                f"{name}, MB": cost["MB"],
            }
        return found


def copied(first: Path, folder: Path, count: int) -> None:
    """Make a run with its report, and that many with the same record (links take no space)."""
    run = make_run(first, 20.0)
    write_report(run)
    copies(run, folder, count)


PARTS: Final[Mapping[str, Part]] = {
    "stations": Part((1, 2, 5, 10, 25, 50, 100, 175, 250), (1, 2), of_stations),
    "rates": Part((1, 2, 5, 10, 20, 35, 50), (5, 50), of_rates),
    "lengths": Part((60, 600, 3_600, 28_800, 86_400, 604_800), (60, 120), of_lengths),
    "folders": Part((10, 100, 1_000, 3_000, 10_000), (2, 4), of_folders),
}
"""What is varied. Another part is another row."""


def spent(words: Sequence[str], environment: Mapping[str, str] | None = None) -> Figures:
    """Run the command in its own process; return seconds, CPU seconds and peak MB. The process
    reports its memory itself, because the system's count for a child starts with the parent's.
    """
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command, around = [sys.executable, "-c", PROGRAM, *words], os.environ | (environment or {})
    ended = subprocess.run(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=around,
        check=False,
    )
    took, used = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.returncode not in (0, 1):  # 1: a finding
        raise RuntimeError(
            f"{' '.join(words)} ended with {ended.returncode}: {ended.stderr[-500:]}"
        )
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    return {"s": took, "CPU": cpu, "MB": int(ended.stderr.rpartition(PEAK)[2].split()[0]) / 1024}


def size_of(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def measured(path: Path) -> list[Point]:
    """Return the points so far; a truncated line does not count."""
    lines = path.read_text().splitlines() if path.exists() else []
    points = []
    for line in lines:
        try:
            points.append(Point(**json.loads(line)))
        except (ValueError, TypeError):
            print(f"{path}: a line that was cut off is left out", file=sys.stderr)
    return points


def keep(path: Path, points: Sequence[Point]) -> None:
    """Write all points, or leave the file as before."""
    aside = path.with_suffix(".tmp")
    aside.write_text(
        "".join(json.dumps(point._asdict(), ensure_ascii=False) + "\n" for point in points)
    )
    aside.replace(path)


def measure(
    names: Sequence[str], path: Path, *, tiny: bool, again: bool, most: float, seconds: float
) -> list[Point]:
    """Measure what these parts lack; store each point at once."""
    points = [point for point in measured(path) if not (again and point.part in names)]
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    for name in names:
        part = PARTS[name]
        for size in part.tiny if tiny else part.sizes:
            if size > most or any((point.part, point.size) == (name, size) for point in points):
                continue
            figures = part.measure(size, seconds)
            points.append(
                Point(
                    name,
                    size,
                    figures,
                    machine,
                    time.strftime("%Y-%m-%d", time.gmtime()),
                    part.about,
                )
            )
            keep(path, points)
            print(
                f"{name} {size}: "
                + "; ".join(f"{figure} {value:.4g}" for figure, value in figures.items()),
                flush=True,
            )
    return points


def main() -> int:
    options = _options()
    out = Path(options.out or ("build/growth" if options.tiny else HOME))
    if options.short:
        with TemporaryDirectory(prefix="jbclog-growth-") as made:
            return _run(replace_out(options, made), Path(made))
    out.mkdir(parents=True, exist_ok=True)
    return _run(options, out)


def replace_out(options: argparse.Namespace, made: str) -> argparse.Namespace:
    return argparse.Namespace(**(vars(options) | {"out": made, "tiny": True, "page": True}))


def _run(options: argparse.Namespace, out: Path) -> int:
    path = out / ("growth-tiny.jsonl" if options.tiny else "growth.jsonl")
    seconds = 4.0 if options.tiny else options.seconds
    names = options.part or [*PARTS]
    points = measure(
        names, path, tiny=options.tiny, again=options.again, most=options.most, seconds=seconds
    )
    if options.page:
        docs = out if options.tiny else Path(__file__).parents[2] / "docs"
        for written in write_page(points, PARTS, docs):
            print(written)
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="*", choices=[*PARTS, []], help="only these parts")
    parser.add_argument("--out", help="folder of the points, if not that of the repository")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each recording")
    parser.add_argument("--most", type=float, default=float("inf"), help="leave out larger sizes")
    parser.add_argument("--again", action="store_true", help="measure these parts anew")
    parser.add_argument("--page", action="store_true", help="write the page and its pictures")
    parser.add_argument("--tiny", action="store_true", help="the smallest sizes, to try it")
    parser.add_argument("--short", action="store_true", help="the same in a folder that is removed")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
