"""The library that makes a disk fail (`failing_disk.c`), made once for the tests that need it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import failing_run
import pytest

COMPILER = shutil.which("cc") or shutil.which("gcc")


@pytest.fixture(scope="module")
def failing_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """To be preloaded (LD_PRELOAD)."""
    if COMPILER is None:
        pytest.skip("needs a C compiler, for a disk that fails")
    made = tmp_path_factory.mktemp("disk") / "failing_disk.so"
    source = Path(failing_run.__file__).with_name("failing_disk.c")
    subprocess.run([COMPILER, "-O1", "-shared", "-fPIC", "-o", made, source, "-ldl"], check=True)
    return made
