"""A process whose interpreter turns on the spot is ended; one that is busy is not."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

# CPython 3.11 repeats itself where it has no memory for the place (beyond 256) at which an
# exception passes a `finally`
SPINNING = """
import _testcapi
from jbclog.transport.cpu_limit import cpu_limit
lines = "".join(f"        x{number} = {number}\\n" for number in range(200))
exec(f"def spin():\\n    try:\\n{lines}        bytes(1000)\\n    finally:\\n        x = None\\n")
with cpu_limit(0.5, 0.1):
    _testcapi.set_nomemory(0)
    try:
        spin()
    except MemoryError:
        pass
    _testcapi.remove_mem_hooks()
print("it came out of it")
"""
BUSY = """
import time
from jbclog.transport.cpu_limit import cpu_limit
with cpu_limit(0.3, 0.05):
    while time.process_time() < 0.9:
        pass
while time.process_time() < 1.3:
    pass
"""


def ended(code: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )
    return done.returncode, done.stdout


def test_one_that_never_comes_out_of_a_refusal_is_ended() -> None:
    """Unless its Python does come out of it."""
    pytest.importorskip("_testcapi")
    assert ended(SPINNING) in ((-signal.SIGPROF, ""), (0, "it came out of it\n"))


def test_one_that_is_busy_is_left_alone() -> None:
    assert ended(BUSY)[0] == 0
