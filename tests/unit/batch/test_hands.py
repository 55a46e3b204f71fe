"""What came of a process that was told to end before its run began: the work of who told it, and no failure of the record."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jbclog.batch.entry import State
from jbclog.foreman.hands import Came, ProcessHands


def came(hands: ProcessHands) -> Came:
    while hands.runs("a", 1) or (came := hands.came("a", 1)) is None:
        time.sleep(0.005)
    return came


def hands_with(folder: Path, process: subprocess.Popen[bytes]) -> ProcessHands:
    hands = ProcessHands(folder, {})
    hands._children[hands.papers("a", 1).folder] = process
    return hands


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)])
def test_told_to_end_before_its_run_began(tmp_path: Path, number: signal.Signals, code: int) -> None:
    hands = hands_with(tmp_path, subprocess.Popen([sys.executable, "-S", "-c", "import signal; signal.pause()"]))
    assert hands.ask_to_end("a", 1, number)
    text = f"{number.name} ended it before its run began; no station was touched"
    assert came(hands) == Came(State.HALF, code, text)


def test_dead_by_itself_before_its_run_began(tmp_path: Path) -> None:
    hands = hands_with(tmp_path, subprocess.Popen([sys.executable, "-S", "-c", "raise SystemExit(1)"]))
    assert came(hands) == Came(State.FAILED, 4, "its process ended before its run began")
