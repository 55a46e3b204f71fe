"""A store of a plant with one run, for what other programs may do to it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.records.many_runs import many_runs
from support.records.plant_store import published


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return many_runs(tmp_path_factory.mktemp("runs"), [0.2])[0]


@pytest.fixture(scope="module")
def filled(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(published(tmp_path_factory.mktemp("plant") / "store", run).url)


@pytest.fixture
def store(filled: Path, tmp_path: Path) -> Path:
    return shutil.copytree(filled, tmp_path / "store")
