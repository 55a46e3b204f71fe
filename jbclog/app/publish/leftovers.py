"""Removes the rows of publications that are not in `runs`: a publisher's own after an error,
others' in `store check`.

First a commit to `runs` records which publications are dead (`commits.fence`), so that no slow
publisher and no late commit names rows that are gone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet

from jbclog.analysis.store.place import Place
from jbclog.analysis.store.reader import Store
from jbclog.app.publish.commits import fence, remove

Left = Mapping[str, AbstractSet[str]]
"""Publications, and the tables in which they may have rows."""


def swept(place: Place, left: Left) -> Iterator[tuple[str, str]]:
    """Remove the rows of those publications that `runs` does not name; yield table and publication.

    Raises `StoreError`.
    """
    for publication in (
        fence(place, lambda runs: left.keys() - named(Store(place, runs))) if left else ()
    ):
        for table in sorted(left[publication]):
            remove(place, table, publication)
            yield table, publication


def named(store: Store) -> set[str]:
    """Return the publications that count, or counted at an older version of their run."""
    return {name for one in store.every_version() for name in (one.record, one.findings)}
