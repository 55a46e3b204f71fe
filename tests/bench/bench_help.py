"""``jbclog --help`` as a person meets it: a fresh process, from start to end, the median of ten.

Beside it a Python that does nothing, which is what no program in Python can be faster than.
"""

from __future__ import annotations

import subprocess
import sys
import time
from statistics import median

from common import at_most, is_short, judge, show

HELP = [sys.executable, "-c", "from jbclog.cli import main; main()", "--help"]
NOTHING = [sys.executable, "-c", "pass"]


def main() -> int:
    times = 5 if is_short(__doc__) else 10
    nothing, ours = _median_ms(NOTHING, times), _median_ms(HELP, times)
    rows = [["python -c pass", nothing, 1.0], ["jbclog --help", ours, ours / nothing]]
    show(f"median of {times} processes", ("", "ms", "ratio"), rows)
    return judge([at_most("jbclog --help, of python -c pass", ours / nothing, 8.0)])


def _median_ms(command: list[str], times: int) -> float:
    _run_ms(command)  # once for the files' sake
    return median(_run_ms(command) for _ in range(times))


def _run_ms(command: list[str]) -> float:
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return (time.perf_counter() - began) * 1000


if __name__ == "__main__":
    sys.exit(main())
