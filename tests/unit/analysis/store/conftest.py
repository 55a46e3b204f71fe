"""A store of a plant with one run, for what other programs may do to it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from jbclog.analysis.store.place import place_of
from jbclog.app.publish.publisher import Publisher
from support.records.many_runs import many_runs


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return many_runs(tmp_path_factory.mktemp("runs"), [0.2])[0]


@pytest.fixture(scope="module")
def filled(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = place_of(tmp_path_factory.mktemp("plant") / "store")
    with Publisher(place) as publisher:
        publisher.publish(run)
    return Path(place.url)


@pytest.fixture
def store(filled: Path, tmp_path: Path) -> Path:
    return shutil.copytree(filled, tmp_path / "store")
