"""Writes the derived tables of a finished run into its folder: ``python -m jbclog.app.run.derive
RUN``.

They need pandas and seconds of CPU time, so a process of the lowest priority computes them. It
starts when the tools are safe and the run is sealed, and nothing waits for it: if it is missing or
killed, readers compute the same from the record, and `jbclog report` writes them.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.record.manifest import Manifest

OFF: Final = "JBCLOG_NO_DERIVED"
NICENESS: Final = 19
MOST_S: Final = 3600  # lifetime; a week of one port takes half a minute
WAIT_S: Final = 10.0
MOST_SCORE: Final = b"1000"  # when memory is short, the system ends this process first
OWN_SCORE: Final = Path("/proc/self/oom_score_adj")


def start_derive(folder: Path, manifest: Manifest) -> subprocess.Popen[bytes] | None:
    """Start the process for a run with samples, and return it. Waits for it only if it would be
    ended together with this one.
    """
    has_samples = any(facts.first_tick is not None for facts in manifest.stations)
    if os.environ.get(OFF) or not manifest.is_sealed or not has_samples:
        return None
    child = None
    with suppress(OSError, subprocess.TimeoutExpired):  # missing tables are no failure
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", "jbclog.app.run.derive", str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        if _is_of_a_service():
            child.wait(WAIT_S)
    return child


def _is_of_a_service() -> bool:
    """Whether the system ends all other processes with this one: the first of a container, or a
    service's main process (systemd).
    """
    return os.getpid() == 1 or os.environ.get("SYSTEMD_EXEC_PID") == str(os.getpid())


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the run's folder."""
    os.nice(NICENESS)
    signal.alarm(MOST_S)
    with suppress(OSError):
        OWN_SCORE.write_bytes(MOST_SCORE)
    warnings.simplefilter("ignore")  # about damage: missing data is not counted
    import pyarrow as pa  # the recorder must not import these

    from jbclog.analysis.derived_files import Origin, derived_files, write_derived
    from jbclog.analysis.run import open_run
    from jbclog.analysis.run_derived import derived_tables
    from jbclog.analysis.run_metrics import joints_and_metrics

    pa.set_cpu_count(1)
    folder = Path(arguments[0])
    try:
        origin = Origin.of(folder)
        run = open_run(folder)
        tables = derived_tables(run, joints_and_metrics(run), run.alarm_findings())
        files = derived_files(tables, origin)
        if Origin.of(folder) == origin:  # else a report of what was added is newer
            write_derived(folder, files)
    except (RecordError, OSError) as error:  # the run was moved, or the disk is full
        return error.exit_code if isinstance(error, RecordError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
