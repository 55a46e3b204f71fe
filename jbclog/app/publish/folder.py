"""Publishes the sealed runs of a folder; a run that fails does not block the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.app.publish.publisher import Outcome, Publisher
from jbclog.core.errors import RecordError, StoreError
from jbclog.record.find_runs import SEALED, Found, find

NOT_SEALED: Final = "is not sealed: it is being recorded, or it crashed; then run `jbclog recover`"


@dataclass(frozen=True, slots=True)
class Skipped:
    """A folder that was not published, and why. A run that is still open is not a failure."""

    folder: Path
    why: str
    is_open: bool = False

    def __str__(self) -> str:
        return self.why if self.why.startswith(str(self.folder)) else f"{self.folder}: {self.why}"


def publish_all(publisher: Publisher, folder: Path) -> Iterator[Outcome | Skipped]:
    """Publish the sealed runs directly below `folder`, or `folder` itself; yield the outcome of
    each.

    Raises `StoreError`: if the store cannot be reached, no other run is tried.
    """
    for one in find(folder):
        if not isinstance(one, Found):
            yield Skipped(one.folder, one.why)
        elif one.state != SEALED:
            yield Skipped(one.folder, NOT_SEALED, is_open=True)
        else:
            yield _published(publisher, one.folder)


def _published(publisher: Publisher, folder: Path) -> Outcome | Skipped:
    try:
        return publisher.publish(folder)
    except StoreError:
        raise
    except RecordError as error:
        return Skipped(folder, str(error))
