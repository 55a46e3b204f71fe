"""Libraries that make a disk or memory fail (`failing_disk.c`, `failing_alloc.c`), made once for
the tests that need them.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from support.faults import failing_run

COMPILER = shutil.which("cc") or shutil.which("gcc")


@pytest.fixture(scope="module")
def failing_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """To be preloaded (LD_PRELOAD): a disk that fails."""
    return made("failing_disk", tmp_path_factory)


@pytest.fixture(scope="module")
def starving_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """To be preloaded: memory that is refused."""
    return made("failing_alloc", tmp_path_factory)


def made(name: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if COMPILER is None:
        pytest.skip("needs a C compiler, for what fails below the program")
    library = tmp_path_factory.mktemp(name) / f"{name}.so"
    source = Path(failing_run.__file__).with_name(f"{name}.c")
    subprocess.run([COMPILER, "-O1", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library
