"""`report` of an eight-hour run of one port at 10 Hz: at most 8 s, imports included.

``python tests/bench/bench_report.py`` prints the figures; ``pytest -m bench tests/bench/bench_report.py`` holds the limit.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from sealed_run import alarm, limit, lose, samples, seal, station, table

ROWS = 8 * 3600 * 10
LIMIT_S = 8.0
REPORT = "import sys; from jbclog.report import write_report; write_report(sys.argv[1])"


def eight_hours(out: Path) -> Path:
    """The run: joints all day, an alarm, ten outages, lost readings."""
    columns = samples(ROWS)
    columns["temperature_c"][100_000:100_020] = 392
    for start in range(20_000, ROWS, 27_000):
        lose(columns, slice(start, start + 30))
    for row in range(5_000, ROWS, 997):
        lose(columns, slice(row, row + 1), "timeout")
    return seal(out, [station(rows=ROWS)], table(columns), [alarm(10_002)], [limit("high", "380"), limit("low", "300")])


def measured(run: Path) -> float:
    """Seconds of a whole process that makes the report."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", REPORT, str(run)], check=True)
    return time.perf_counter() - start


@pytest.mark.bench
def test_report_of_eight_hours(tmp_path: Path) -> None:
    seconds = measured(eight_hours(tmp_path))
    print(f"report of {ROWS} rows: {seconds:.2f} s, limit {LIMIT_S} s")
    assert seconds <= LIMIT_S


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        run = eight_hours(Path(folder))
        took = [measured(run) for _ in range(3)]
        size = (run / "report.html").stat().st_size
        print(f"report of {ROWS} rows: {min(took):.2f} to {max(took):.2f} s of at most {LIMIT_S} s, page {size / 1e6:.2f} MB")
