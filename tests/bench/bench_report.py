"""CPU of `report` with imports. One port: at most 8 s for eight hours at 10 Hz, 2 s for 20 s, and
the CPU and memory of `LENGTHS` for a day and a week.

32 ports: at most `MOST_FIGURES` times the CPU of one plain matplotlib figure (the report itself has
66 figures). A day of 32 ports: `PORTS_DAY`.

``python tests/bench/bench_report.py`` prints the figures (``--week`` includes a week, ``--ports`` a
day of 32 ports at 5 and 10 Hz); ``pytest -m bench tests/bench/bench_report.py`` checks the limits.
"""

from __future__ import annotations

import io
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))

from bench_growth import sealed, shifted, spent
from common import in_own_process

from jbclog.analysis.rules_number import RULES
from support.records.sealed_run import alarm, limit, lose, samples, seal, station, table

ROWS = 8 * 3600 * 10
LIMIT_S = 8.0
STATIONS, SHORT_ROWS = 16, 1200  # four minutes at 5 Hz, two ports each
MOST_FIGURES = 140
SHORT_S = 2.0
DAY_S, WEEK_S = 86_400, 604_800
LENGTHS = {DAY_S: (9.0, 340.0), WEEK_S: (30.0, 450.0)}
"""Length in s, with a joint each five seconds -> the most CPU in s and memory in MB."""
PORTS_DAY = (60.0, 600.0)
"""The same for a day of 32 ports."""
REPORT = "import sys; from jbclog.report.write import write_report; write_report(sys.argv[1])"


def eight_hours(out: Path) -> Path:
    """The run: joints all day, an alarm, ten outages, lost readings."""
    columns = samples(ROWS)
    columns["temperature_c"][100_000:100_020] = 392
    for start in range(20_000, ROWS, 27_000):
        lose(columns, slice(start, start + 30))
    for row in range(5_000, ROWS, 997):
        lose(columns, slice(row, row + 1), "timeout")
    return seal(
        out,
        [station(rows=ROWS)],
        table(columns),
        [alarm(10_002)],
        [limit("high", "380"), limit("low", "300")],
        rules=RULES,
    )


def measured(run: Path) -> float:
    """Return the seconds of a whole process that makes the report."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", REPORT, str(run)], check=True)
    return time.perf_counter() - start


def twenty_seconds(out: Path) -> Path:
    """The run: joints, no alarm."""
    return seal(
        out,
        [station(rows=200)],
        table(samples(200)),
        [],
        [limit("high", "380"), limit("low", "300")],
        rules=RULES,
    )


def cpu_of(run: Path) -> float:
    """Return the CPU seconds of a whole process that makes the report, minimum of three."""
    took = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        measured(run)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(took)


def of_length(out: Path, seconds: int) -> tuple[float, float]:
    """Return CPU in s and memory in MB of the report of one port, in its own process."""
    cost = spent(["report", str(in_own_process(sealed, out, 10 * seconds))])
    return cost["CPU"], cost["MB"]


def day_of_ports(out: Path, hz: float) -> str:
    """Seal a day of 32 ports, an hour repeated: joints all day; return its folder."""
    names = [f"dde-{number}" for number in range(1, STATIONS + 1)]
    hour = table(
        *(
            samples(round(3600 * hz), name, port, hz, seed)
            for seed, name in enumerate(names)
            for port in (1, 2)
        )
    )
    hour = hour.take(pa.array(np.argsort(hour["tick"].to_numpy(), kind="stable")))
    hour, rows = hour.combine_chunks(), round(DAY_S * hz)
    day = pa.concat_tables([shifted(hour, number, hz) for number in range(24)])
    facts = [station(name, (1, 2), rows, hz) for name in names]
    return str(seal(out, facts, day, rules=RULES))


def of_ports(out: Path, hz: float) -> tuple[float, float]:
    """Return CPU in s and memory in MB of the report of a day of 32 ports, in its own process."""
    cost = spent(["report", in_own_process(day_of_ports, out, hz)])
    return cost["CPU"], cost["MB"]


def sixteen_stations(out: Path) -> Path:
    """The run: joints on 32 ports, an alarm on one of them."""
    names = [f"dde-{number}" for number in range(1, STATIONS + 1)]
    columns = [
        samples(SHORT_ROWS, name, port, 5.0, seed)
        for seed, name in enumerate(names)
        for port in (1, 2)
    ]
    columns[21]["temperature_c"][600:640] = 392
    facts = [station(name, (1, 2), SHORT_ROWS, 5.0) for name in names]
    limits = [
        limit(side, text, station_name=name)
        for name in names
        for side, text in (("high", "380"), ("low", "300"))
    ]
    return seal(out, facts, table(*columns), [alarm(124, "dde-11")], limits, rules=RULES)


def cpu_s(what: Callable[[], object]) -> float:
    """Return the minimum CPU of three."""
    took = []
    for _ in range(3):
        start = time.process_time()
        what()
        took.append(time.process_time() - start)
    return min(took)


def a_figure() -> None:
    """Draw temperature and power of one port with plain matplotlib."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    second = np.arange(SHORT_ROWS) / 5
    figure = Figure(figsize=(7.4, 3.7))
    for row, level in enumerate((350, 80), 1):
        axes = figure.add_subplot(2, 1, row)
        axes.plot(second, level + np.sin(second))
        axes.axhline(level)
        axes.set_ylabel("value")
        axes.grid()
    FigureCanvasSVG(figure)
    figure.savefig(io.StringIO(), format="svg")


def in_figures(run: Path) -> tuple[float, float]:
    """Return the CPU of a report without imports, in seconds and in matplotlib figures."""
    from jbclog.report.write import write_report

    report_s, figure_s = cpu_s(lambda: write_report(run)), cpu_s(a_figure)
    return report_s, report_s / figure_s


@pytest.mark.bench
def test_report_of_sixteen_stations(tmp_path: Path) -> None:
    seconds, figures = in_figures(sixteen_stations(tmp_path))
    print(
        f"report of {2 * STATIONS} ports: {seconds:.2f} s of CPU, as much as {figures:.0f} figures"
        " of matplotlib"
    )
    assert figures <= MOST_FIGURES


@pytest.mark.bench
def test_report_of_twenty_seconds(tmp_path: Path) -> None:
    seconds = cpu_of(twenty_seconds(tmp_path))
    print(f"report of 20 s of one port: {seconds:.2f} s of CPU, limit {SHORT_S} s")
    assert seconds <= SHORT_S


@pytest.mark.bench
def test_report_of_eight_hours(tmp_path: Path) -> None:
    seconds = measured(eight_hours(tmp_path))
    print(f"report of {ROWS} rows: {seconds:.2f} s, limit {LIMIT_S} s")
    assert seconds <= LIMIT_S


@pytest.mark.bench
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seconds", [*LENGTHS])
def test_report_of_a_day_and_a_week(seconds: int, tmp_path: Path) -> None:
    cpu, memory = of_length(tmp_path, seconds)
    print(f"report of {seconds} s: {cpu:.1f} s of CPU, {memory:.0f} MB; limits {LENGTHS[seconds]}")
    assert cpu <= LENGTHS[seconds][0]
    assert memory <= LENGTHS[seconds][1]


@pytest.mark.bench
@pytest.mark.timeout(1200)
def test_report_of_a_day_of_ports(tmp_path: Path) -> None:
    """At 5 Hz, which a link carries for two ports."""
    cpu, memory = of_ports(tmp_path, 5.0)
    print(f"report of a day of 32 ports: {cpu:.1f} s of CPU, {memory:.0f} MB; limits {PORTS_DAY}")
    assert cpu <= PORTS_DAY[0]
    assert memory <= PORTS_DAY[1]


if __name__ == "__main__":
    for hz in (5.0, 10.0) if "--ports" in sys.argv else ():
        with tempfile.TemporaryDirectory() as folder:
            cpu, memory = of_ports(Path(folder), hz)
            print(
                f"report of a day of 32 ports at {hz:g} Hz: {cpu:.1f} s of CPU, {memory:.0f} MB (at"
                f" most {PORTS_DAY[0]} s and {PORTS_DAY[1]} MB)"
            )
    for seconds in LENGTHS if "--week" in sys.argv else [DAY_S]:
        with tempfile.TemporaryDirectory() as folder:
            cpu, memory = of_length(Path(folder), seconds)
            print(
                f"report of {seconds} s: {cpu:.1f} s of CPU, {memory:.0f} MB (at most"
                f" {LENGTHS[seconds][0]} s and {LENGTHS[seconds][1]} MB)"
            )
    with tempfile.TemporaryDirectory() as folder:
        run = eight_hours(Path(folder))
        took = [measured(run) for _ in range(3)]
        size = (run / "report.html").stat().st_size
        print(
            f"report of {ROWS} rows: {min(took):.2f} to {max(took):.2f} s of at most {LIMIT_S} s,"
            f" page {size / 1e6:.2f} MB"
        )
    with tempfile.TemporaryDirectory() as folder:
        seconds, figures = in_figures(sixteen_stations(Path(folder)))
        print(
            f"report of {2 * STATIONS} ports: {seconds:.2f} s of CPU, as much as {figures:.0f}"
            f" figures (at most {MOST_FIGURES})"
        )
