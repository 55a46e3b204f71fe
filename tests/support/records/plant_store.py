"""A store of a plant with runs in it, and the fixtures of one with one run: a conftest imports
them.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from jbclog.analysis.store.place import Place, place_of
from jbclog.app.publish.folder import publish_all
from jbclog.app.publish.publisher import Publisher, Result
from support.records.many_runs import many_runs


def published(store: Path, *folders: Path) -> Place:
    """A store with these runs, or with all of these folders: each is published, none was before."""
    place = place_of(store)
    with Publisher(place) as publisher:
        done = [one for folder in folders for one in publish_all(publisher, folder)]
    assert {getattr(one, "result", one) for one in done} == {Result.PUBLISHED}
    return place


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return many_runs(tmp_path_factory.mktemp("runs"), [0.2])[0]


@pytest.fixture(scope="module")
def filled(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(published(tmp_path_factory.mktemp("plant") / "store", run).url)


@pytest.fixture
def store(filled: Path, tmp_path: Path) -> Path:
    """A copy, to change."""
    return shutil.copytree(filled, tmp_path / "store")
