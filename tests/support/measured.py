"""The command `jbclog` in a process of its own that is measured, and stopped where it takes far too much."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

ADDRESSES: Final = 4 << 30  # of addresses, which are more than memory
MOST_CPU_S: Final = 60


class Measured(NamedTuple):
    """What it said, its seconds of processor time, and its memory in MB."""

    code: int
    text: str
    cpu_s: float
    peak_mb: float


def measured(*arguments: str | Path) -> Measured:
    """Run the command to its end."""
    command = [sys.executable, "-c", "from jbclog.cli import main; main()", *map(str, arguments)]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, preexec_fn=_limited)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return Measured(process.returncode, text, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
