from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app.run.runner import CUT_SHORT
from support.transcripts.stage import Stage


@pytest.fixture
def stage(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Stage]:
    """An empty folder with the program in it. `run` ignores signals at its end."""
    before = {number: signal.getsignal(number) for number in CUT_SHORT}
    played = Stage(tmp_path, tmp_path_factory, monkeypatch)
    yield played
    for end in played.at_end:
        end()
    for number, handler in before.items():
        signal.signal(number, handler)
