from __future__ import annotations

import pytest

from support.command import jbclog
from support.readers.texts import Demo


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """One demo for all tests that only look at it."""
    place = tmp_path_factory.mktemp("newcomer")
    said = jbclog("demo", "--seconds", "14", cwd=place)
    assert said.returncode == 0, said.stderr
    (run,) = (place / "demo-runs").iterdir()
    return Demo(place, said, run)
