"""The suite started by `nohup` in the background, held by `tests/conftest.py`: the programs that it
starts hear every signal.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

CONFTEST = Path(__file__).parents[2] / "conftest.py"
OF_THE_TERMINAL = (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP)
TEST = """
import os, signal, subprocess, sys

def test_it():
    heard = "import signal; print(*(signal.getsignal(n) is signal.SIG_IGN for n in (2, 3, 1)))"
    command = [sys.executable, "-S", "-c", heard]
    child = subprocess.run(command, capture_output=True, text=True, check=True)
    assert child.stdout == "False False False\\n"
    for number in (2, 3, 1):
        os.kill(os.getpid(), number)
"""


def ignore() -> None:
    for number in OF_THE_TERMINAL:
        signal.signal(number, signal.SIG_IGN)


def test_programs_that_tests_start_hear_what_nohup_ignores_and_the_suite_does_not(
    tmp_path: Path,
) -> None:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_made_up.py").write_text(TEST)
    told = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("JBCLOG", "PYTEST"))
    }
    told |= {"PYTHONPATH": str(CONFTEST.parent)}  # where its `support` is
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=told,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        preexec_fn=ignore,
    )
    assert done.returncode == 0, done.stdout
