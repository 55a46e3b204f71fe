"""The command `jbclog` in a process of its own that is measured, and stopped where it takes far too
much.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from math import inf
from pathlib import Path
from typing import Final, NamedTuple

ADDRESSES: Final = 4 << 30  # of addresses, which are more than memory
MOST_CPU_S: Final = 60
# its own figure of its peak: the one of `wait4` has the memory of whoever started it
PROGRAM: Final = """
import atexit, re, sys
from pathlib import Path
peak = Path(sys.argv.pop(1))
status = lambda: Path("/proc/self/status").read_text()
atexit.register(lambda: peak.write_text(re.search(r"VmHWM:\\s+(\\d+)", status())[1]))
from jbclog.cli import main
main()
"""


class Measured(NamedTuple):
    """What it said, its seconds of processor time, and its memory in MB, infinite where it was
    killed.
    """

    code: int
    text: str
    cpu_s: float
    peak_mb: float


def measured(*arguments: str | Path) -> Measured:
    """Run the command to its end."""
    with tempfile.TemporaryFile() as said, tempfile.TemporaryDirectory() as folder:
        peak = Path(folder) / "peak"
        command = [sys.executable, "-c", PROGRAM, str(peak), *map(str, arguments)]
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, preexec_fn=_limited
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace")
        peak_mb = int(peak.read_text()) / 1024 if peak.exists() else inf
    return Measured(process.returncode, text, used.ru_utime + used.ru_stime, peak_mb)


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
