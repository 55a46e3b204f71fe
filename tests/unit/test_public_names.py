"""Names that users import stay where they were, wherever the code behind them lives."""

from __future__ import annotations

import subprocess
import sys

import jbclog
import jbclog.spc
from jbclog.analysis import spc


def test_spc_is_public() -> None:
    assert set(jbclog.spc.__all__) == set(spc.__all__)
    assert [
        name for name in spc.__all__ if getattr(jbclog.spc, name) is not getattr(spc, name)
    ] == []


def test_the_package_runs_as_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "jbclog", "--version"],
        capture_output=True,
        text=True,
        check=True,
        timeout=200,
    )
    assert done.stdout == f"jbclog {jbclog.__version__}\n"
