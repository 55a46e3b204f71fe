"""Publishes sealed runs into a store: each once, whole, and again after annotations were added.

A run is looked up, checked, written table by table under a unique publication name, and named in
`runs` last. Rows that are not named there do not count, and are removed: by this publisher, or by
`store check` if it was killed.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import pyarrow as pa

from jbclog.analysis.rejudge import check_verdict
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.store.contents import partition_of, rows_of, run_row, small_files, stamped
from jbclog.analysis.store.identity import Identity, Step, identity_of
from jbclog.analysis.store.place import Place, expect_library
from jbclog.analysis.store.reader import Published, Store, opened
from jbclog.analysis.store.schema import DATA, FINDINGS, RUNS
from jbclog.app.publish.commits import append, commit_run, create_tables, remove
from jbclog.app.publish.lease import Lease
from jbclog.app.publish.leftovers import swept
from jbclog.app.publish.safe_place import expect_safe
from jbclog.core.errors import RecordError, StoreError
from jbclog.record.check import check
from jbclog.record.find_runs import Found, summary_of
from jbclog.record.manifest import read_manifest

if TYPE_CHECKING:
    from deltalake import DeltaTable

TRIES: Final = 3


class Result(StrEnum):
    """What happened to a run."""

    PUBLISHED = "published"
    VERSIONED = "new version"
    THERE = "already there"
    OLDER = "the store has a newer version"


DONE: Final = {Step.NOTHING: Result.THERE, Step.OLDER: Result.OLDER}


@dataclass(frozen=True, slots=True)
class Outcome:
    """A run, its result, and its version in the store."""

    run: str
    result: Result
    version: int

    def __str__(self) -> str:
        return f"{self.run}: {self.result} (version {self.version})"


class Publisher(AbstractContextManager["Publisher"]):
    """Publishes runs into the store at `place`, created if missing; holds a lease within a `with`
    block.

    Raises `UsageError` for a place where commits are not safe, `RecordError` for one that cannot be
    written.
    """

    def __init__(self, place: Place) -> None:
        expect_library()
        expect_safe(place)
        self.place = place
        self._lease = Lease(place)
        self._left: dict[str, set[str]] = {}
        create_tables(place)
        self._seen = {one.identity.run: one for one in Store(place).runs()}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(StoreError):
            self._sweep()
        self._lease.release()

    def publish(self, folder: Path) -> Outcome:
        """Publish the sealed run in `folder`.

        Raises `RecordError` for a run that is not sealed, not whole, or not the one in the store;
        `StoreError` if the store cannot be reached.
        """
        for _ in range(TRIES):
            identity = identity_of(folder)
            known, step = self._known(identity)
            if known is not None and step in DONE:
                return Outcome(identity.run, DONE[step], known.version)
            expect_whole(folder)
            self._sweep()
            writing = _Writing(
                self.place, self._lease, open_run(folder), _summary(folder), identity
            )
            try:
                found = writing.publish(known if step is Step.FINDINGS else None)
            finally:
                self._left |= writing.left
                self._seen.pop(identity.run, None)
            if found is not None:
                return found
        raise RecordError(
            f"{folder}: annotations were added while it was published; publish it again"
        )

    def renew(self) -> None:
        """Renew this publisher's lease."""
        self._lease.renew()

    def reopen(self) -> None:
        """Try a store that was lost.

        Never creates it: a share that is not mounted is an empty folder. Raises `StoreError` if it
        is still lost, `UsageError` if commits are not safe there now.
        """
        opened(self.place, RUNS)
        expect_safe(self.place)

    def _sweep(self) -> None:
        """Remove what this publisher left in the store when it could not be written."""
        if self._left:
            for _ in swept(self.place, self._left):
                self._lease.renew()
            self._left.clear()

    def _known(self, identity: Identity) -> tuple[Published | None, Step]:
        """Return the run as the store has it, and what is left to publish. Runs never leave a
        store, so what was seen there stays.
        """
        known = self._seen.get(identity.run)
        step = identity.step(known.identity if known else None)
        if step not in DONE:
            known = Store(self.place).newest(identity.run)
            step = identity.step(known.identity if known else None)
        if known is not None:
            self._seen[identity.run] = known
        return known, step


class _Writing:
    """One publication of a run."""

    def __init__(
        self, place: Place, lease: Lease, run: Run, found: Found, identity: Identity
    ) -> None:
        self._place, self._lease, self._run, self._found, self._identity = (
            place,
            lease,
            run,
            found,
            identity,
        )
        self._publication = lease.new_publication()
        self._files: list[tuple[str, bytes]] = []
        self._written: dict[str, int] = {}
        self._begun: set[str] = set()  # tables that may have rows which do not count
        self._decided: tuple[Outcome, frozenset[str]] | None = None

    def publish(self, known: Published | None) -> Outcome | None:
        """Publish the run whole, or only what is new against `known`; None if the run was annotated
        meanwhile.

        After an error of the commit to `runs` it is not known whether it was made: then nothing is
        removed here, see `left`.
        """
        try:
            for table in DATA if known is None else FINDINGS:
                self._begun.add(table)
                self._written[table] = self._append(table)
            self._files = _files_of(self._run)
            is_same = identity_of(self._run.folder) == self._identity
        except BaseException:
            self._remove(frozenset())
            raise
        if is_same:
            commit_run(self._place, self._publication, self._row)
        outcome, named = self._decided or (None, frozenset())
        self._remove(named)
        return outcome

    @property
    def left(self) -> dict[str, set[str]]:
        """The publication, with the tables in which it may have rows that do not count."""
        return {self._publication: self._begun} if self._begun else {}

    def _append(self, table: str) -> int:
        def rows() -> Iterator[pa.RecordBatch]:
            pieces = self._renewing(rows_of(self._run, table))
            return stamped(
                pieces, table, self._identity.run, self._publication, partition_of(self._found)
            )

        return append(self._place, table, self._publication, rows)

    def _renewing(self, pieces: Iterator[pa.Table]) -> Iterator[pa.Table]:
        for piece in pieces:
            self._lease.renew()
            yield piece

    def _row(self, runs: DeltaTable) -> pa.Table | None:
        """Return the row for `runs` in its current state; None if nothing is left to commit."""
        known = Store(self._place, runs).newest(self._identity.run)
        if known is not None and known.findings == self._publication:
            return None  # the commit before was made, and only its answer was lost
        step = self._identity.step(known.identity if known else None)
        if known is not None and step in DONE:
            self._decided = Outcome(self._identity.run, DONE[step], known.version), frozenset()
            return None
        return self._new_row(known)

    def _new_row(self, known: Published | None) -> pa.Table:
        ours, version = self._publication, 1 if known is None else known.version + 1
        if known is None and self._written.keys() != set(DATA):
            raise StoreError(
                f"{self._place}: {self._identity.run} was removed meanwhile; publish it again"
            )
        result = Result.PUBLISHED if known is None else Result.VERSIONED
        self._decided = (
            Outcome(self._identity.run, result, version),
            frozenset(DATA if known is None else FINDINGS),
        )
        return run_row(
            self._found,
            self._identity,
            version=version,
            publications=(ours if known is None else known.record, ours),
            publisher=socket.gethostname(),
            rows=(
                self._written
                if known is None
                else {**known.rows, **{table: self._written[table] for table in FINDINGS}}
            ),
            files=self._files,
        )

    def _remove(self, named: frozenset[str]) -> None:
        """Remove rows that `runs` does not name; if that fails, they do not count, and stay in
        `left`.
        """
        self._begun -= named
        with suppress(StoreError):
            for table in sorted(self._begun):
                if self._written.get(table) != 0:
                    remove(self._place, table, self._publication)
                self._begun.remove(table)


def expect_whole(folder: Path) -> None:
    """Raise `RecordError` for a run in which `jbclog check` finds something."""
    found = [str(one) for one in check(folder)] or check_verdict(
        folder, read_manifest(folder)
    ).differing
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        raise RecordError(
            f"{folder}: {found[0]}{more}; nothing was published. `jbclog check {folder}` lists all"
            " findings"
        )


def _summary(folder: Path) -> Found:
    found = summary_of(folder)
    if not isinstance(found, Found):
        raise RecordError(f"{folder}: {found.why if found else 'its manifest cannot be read'}")
    return found


def _files_of(run: Run) -> list[tuple[str, bytes]]:
    try:
        return [*small_files(run)]
    except OSError as error:
        raise RecordError(f"{run.folder} cannot be read: {error.strerror or error}") from error
