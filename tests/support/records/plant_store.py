"""A store of a plant with runs in it."""

from __future__ import annotations

from pathlib import Path

from jbclog.analysis.store.place import Place, place_of
from jbclog.app.publish.folder import publish_all
from jbclog.app.publish.publisher import Publisher, Result


def published(store: Path, *folders: Path) -> Place:
    """A store with these runs, or with all of these folders: each is published, none was before."""
    place = place_of(store)
    with Publisher(place) as publisher:
        done = [one for folder in folders for one in publish_all(publisher, folder)]
    assert {getattr(one, "result", one) for one in done} == {Result.PUBLISHED}
    return place
