"""The short form of every benchmark with claims: ``pytest -m bench tests/bench``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

NAMES = (
    "wire_use",
    "own_profile",
    "many_stations",
    "one_unpaced",
    "memory",
    "start",
    "wire_record",
    "open_run",
    "watch",
    "many_runs",
    "store",
    "audit",
    "old_ledger",
    "instructions",
    "growth",
)
LONGEST_S = 300


@pytest.mark.bench
@pytest.mark.timeout(LONGEST_S)
@pytest.mark.parametrize("name", NAMES)
def test_short_form_holds_its_claims(name: str) -> None:
    script = Path(__file__).with_name(f"bench_{name}.py")
    done = subprocess.run(
        [sys.executable, str(script), "--short"],
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
