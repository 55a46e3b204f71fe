"""Counts the joints of a run beside its recorder: ``python -m jbclog.app.run.joint_counter RUN WANTED``.

It finds them as `Run.joints` does, in the committed part of the record. That needs pandas and more computing time than a
recorder has, so it is a process of lowest priority that only reads.

It writes a line for each count: how many joints have ended. A joint that ended less than `ENDED_S` before its port's last row
is not counted yet. After a line on stdin it counts all joints in the sealed record, writes ``= N``, and ends. It also ends when
stdin is closed. If it cannot count, it writes ``! why`` and ends.

The next count waits for the least time that the missing joints take, and at least `REST` times as long as the last count took.
"""

from __future__ import annotations

import os
import select
import sys
import time
import warnings
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import joint_count
from jbclog.core.errors import RecordError, unexpected_error_text

ENDED_S: Final = 1.5
LEAST_PAUSE_S, MOST_PAUSE_S = 1.0, 60.0
LEAST_JOINT_S: Final = 0.5
REST: Final = 9
NICENESS: Final = 19
BEGIN_S: Final = 5.0  # before the first joint is possible
STDIN: Final = 0


def pause_s(missing: int, ports: int, took_s: float) -> float:
    """Return how long to wait until all missing joints can have been made."""
    soonest = LEAST_JOINT_S * missing / max(ports, 1)
    return max(min(max(soonest, LEAST_PAUSE_S), MOST_PAUSE_S), REST * took_s)


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the run's folder, and the wanted number of joints."""
    folder, wanted = Path(arguments[0]), int(arguments[1])
    os.nice(NICENESS)
    pa.set_cpu_count(1)  # the recorder needs the cores
    pa.set_io_thread_count(1)
    warnings.simplefilter("ignore")  # of damage: missing data is not counted
    try:
        is_asked = _count_until_asked(folder, wanted)
        if is_asked:
            _write(f"= {joint_count(open_run(folder))}")
    except Exception as error:  # the recorder notes the reason and continues
        _write(f"! {error}" if isinstance(error, RecordError) else f"! internal error, {unexpected_error_text(error)}")
    return 0


def _count_until_asked(folder: Path, wanted: int) -> bool:
    """Count until a line on stdin asks for the last count; False if stdin was closed."""
    pause = BEGIN_S
    while True:
        if select.select([STDIN], [], [], pause)[0]:
            return bool(os.read(STDIN, 1))
        began, run = time.monotonic(), open_run(folder)
        count = joint_count(run, ENDED_S)
        _write(str(count))
        ports = sum(len(facts.ports) for facts in run.manifest.stations)
        pause = pause_s(wanted - count, ports, time.monotonic() - began)


def _write(text: str) -> None:
    sys.stdout.write(" ".join(text.split()) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
