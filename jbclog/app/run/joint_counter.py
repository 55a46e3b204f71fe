"""Counts the joints of a run that goes on, beside its recorder: ``python -m jbclog.app.run.joint_counter RUN``.

They are found as `Run.joints` finds them afterwards, in the record as far as it is committed. That takes pandas, and more
computing than a recorder has to spare, so it is a process of its own, of the lowest priority, which only reads.

It writes a line for each look: how many joints have ended. A joint that ended less than `ENDED_S` before its port's last row may
not have. Asked for the last count (a line on stdin), it counts all that is in the sealed record, writes ``= N``, and ends. It ends
as well when its stdin is closed: nobody waits for it then. Where it cannot count it writes ``! why`` and ends.

The next look waits as long as the joints that are missing take at the least, and `REST` times as long as the last one took.
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
BEGIN_S: Final = 5.0  # before there can be anything to find
STDIN: Final = 0


def pause_s(missing: int, ports: int, took_s: float) -> float:
    """How long to wait before the next look can find all that are missing."""
    soonest = LEAST_JOINT_S * missing / max(ports, 1)
    return max(min(max(soonest, LEAST_PAUSE_S), MOST_PAUSE_S), REST * took_s)


def main(arguments: list[str]) -> int:
    """The process. `arguments`: the run's folder, and how many joints are wanted."""
    folder, wanted = Path(arguments[0]), int(arguments[1])
    os.nice(NICENESS)
    pa.set_cpu_count(1)  # beside a recorder that needs its cores
    pa.set_io_thread_count(1)
    warnings.simplefilter("ignore")  # of damage: what is not there is not counted
    try:
        asked = _look_on(folder, wanted)
        if asked:
            _say(f"= {joint_count(open_run(folder))}")
    except Exception as error:  # whatever it is, the recorder says it and goes on
        _say(f"! {error}" if isinstance(error, RecordError) else f"! internal error, {unexpected_error_text(error)}")
    return 0


def _look_on(folder: Path, wanted: int) -> bool:
    """Look until somebody asks for the last count; False where nobody will."""
    pause = BEGIN_S
    while True:
        if select.select([STDIN], [], [], pause)[0]:
            return bool(os.read(STDIN, 1))
        began, run = time.monotonic(), open_run(folder)
        count = joint_count(run, ENDED_S)
        _say(str(count))
        ports = sum(len(facts.ports) for facts in run.manifest.stations)
        pause = pause_s(wanted - count, ports, time.monotonic() - began)


def _say(text: str) -> None:
    sys.stdout.write(" ".join(text.split()) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
