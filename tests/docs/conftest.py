from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest

from support.command import jbclog
from support.readers.texts import Demo


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """One demo for all tests that only look at it, whichever worker they run in."""
    place = (
        tmp_path_factory.getbasetemp().parent
        / f"newcomer-{os.environ.get('PYTEST_XDIST_TESTRUNUID', os.getpid())}"
    )
    with Path(f"{place}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # the first worker makes it, the others wait for it
        if not place.exists():
            place.mkdir()
            # as long as by itself: in less, the first fault hits the start on a busy machine
            made = jbclog("demo", cwd=place)
            assert made.returncode == 0, made.stderr
            (place / "said.txt").write_text(made.stdout, encoding="utf-8")
    (run,) = (place / "demo-runs").iterdir()
    return Demo(place, (place / "said.txt").read_text(encoding="utf-8"), run)
