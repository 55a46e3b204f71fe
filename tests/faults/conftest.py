"""Shared by several files here, made once each: libraries that make a disk or memory fail
(`failing_disk.c`, `failing_alloc.c`), and a served line.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.faults import failing_run
from support.virtual.served_line import ServedLine

COMPILER = shutil.which("cc") or shutil.which("gcc")


@pytest.fixture(scope="module")
def failing_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library for LD_PRELOAD: a disk that fails."""
    return made("failing_disk", tmp_path_factory)


@pytest.fixture(scope="module")
def starving_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library for LD_PRELOAD: memory requests that fail."""
    return made("failing_alloc", tmp_path_factory)


def made(name: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if COMPILER is None:
        pytest.skip("needs a C compiler, for what fails below the program")
    library = tmp_path_factory.mktemp(name) / f"{name}.so"
    source = Path(failing_run.__file__).with_name(f"{name}.c")
    subprocess.run([COMPILER, "-O1", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedLine]:
    """Four stations that outlive all runs of a file, with their logs."""
    with ServedLine(tmp_path_factory.mktemp("line"), logs=True) as served:
        yield served
