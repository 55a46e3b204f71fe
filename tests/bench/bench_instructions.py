"""Instructions per exchange, counted by valgrind: of a session without a driver, and of the reactor
without a session, with answers whole and in two pieces.

They are compared with a small program of the same kind in the same run, so another build of Python
changes the ratio little. A rise of 5 % fails. Kernel and waiting are not counted.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from common import at_most, is_short, judge, show

PROGRAM = Path(__file__).with_name("instructions.py")
RISE = 1.05
# of the yardstick, on 29 November 2026 with Python 3.11.7; with a 2, where answers come in two
# pieces. A session had 0.66 and 1.12 before each answer waited for a second one that contradicts it
# (docs/reference/faults.md, F-50), and 0.81 and 1.33, the reactor 0.31 and 0.57, before sessions
# were coroutines (docs/decisions/0001-sessions-are-coroutines.md); the reactor 0.34 and 0.60 before
# the usual exchange took the one path of all (docs/decisions/0062-an-event-loop-of-our-own.md). A
# session had 0.84 and 1.38 until then. What the one path costs: a frame for each function between
# the run and the request, results and requests that are made as what they are
AS_MEASURED = {"session": 0.95, "session 2": 1.40, "drive": 0.41, "drive 2": 0.75}
FEW, MANY = 200, 800


def main() -> int:
    is_short(__doc__)
    parts = ("yardstick", *AS_MEASURED)
    with ThreadPoolExecutor(2) as threads:
        counted = dict(zip(parts, threads.map(an_exchange, parts), strict=True))
    yardstick = counted["yardstick"]
    rows = [[part, count, count / yardstick] for part, count in counted.items()]
    show("instructions an exchange", ("", "instructions", "of the yardstick"), rows)
    return judge(
        [
            at_most(f"{part}, of the yardstick", counted[part] / yardstick, most * RISE)
            for part, most in AS_MEASURED.items()
        ]
    )


def an_exchange(part: str) -> float:
    """Return the instructions of one more exchange; the start is in both runs."""
    return (_counted(part, MANY) - _counted(part, FEW)) / (MANY - FEW)


def _counted(part: str, exchanges: int) -> int:
    name, *pieces = part.split()
    command = [
        "valgrind",
        "--tool=callgrind",
        "--callgrind-out-file=/dev/null",
        sys.executable,
        str(PROGRAM),
        name,
        str(exchanges),
        *pieces,
    ]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "0"},
    )
    found = re.search(r"Collected : (\d+)", done.stderr)
    assert found is not None, done.stderr
    return int(found[1])


if __name__ == "__main__":
    sys.exit(main())
