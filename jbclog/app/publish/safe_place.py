"""Whether commits in a place exclude each other; a store is never written where they do not.

A commit of Delta Lake is a file of the next number, which only one writer may create: in a folder
by a hard link to a finished file, in S3 by a conditional write (`If-None-Match`). On a share
without hard links, or a server that ignores the condition, one publisher would silently overwrite
another's commit. Both are tried in a temporary folder.
"""

from __future__ import annotations

import errno
import os
import secrets
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Barrier, BrokenBarrierError
from typing import TYPE_CHECKING, Final

import pyarrow as pa

from jbclog.analysis.store.place import Place, explained
from jbclog.core.errors import StoreError, UsageError

if TYPE_CHECKING:
    from deltalake import DeltaTable

PROBE: Final = "_probe-"
WRITERS: Final = 4
ROUNDS: Final = 2
STARTS_S: Final = 30.0  # a thread that is refused memory as it starts never arrives
GONE_OR_FULL: Final = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.ESTALE,
    errno.EROFS,
    errno.ENODEV,
    errno.ETIMEDOUT,
)
SCHEMA: Final = pa.schema([pa.field("writer", pa.int64())])
ADVICE: Final = (
    "use a local disk, a share with hard links (NFS, SMB 3), or S3 with conditional writes; nothing"
    " was written"
)


def expect_safe(place: Place) -> None:
    """Raise `UsageError` if two publishers could overwrite each other's commits, `StoreError` if
    nothing can be written.
    """
    name = f"{PROBE}{secrets.token_hex(4)}"
    if place.is_remote:
        place.expect_answer()  # here, where there is nothing to remove yet
    else:
        _make(place)
        _expect_exclusive_names(Path(place.url), name)
    try:
        for number in range(ROUNDS):
            _race(place, f"{name}/{number}")
    finally:
        place.remove(name)


def _make(place: Place) -> None:
    try:
        Path(place.url).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{place} cannot be a store: {error.strerror or error}") from error


def _expect_exclusive_names(folder: Path, name: str) -> None:
    """Raise `UsageError` if a name takes a second link, or a rename loses the content."""
    first, second, third = (folder / f"{name}.{end}" for end in ("a", "b", "c"))
    try:
        first.write_bytes(b"1")
        os.link(first, second)
        if first.stat().st_nlink != 2:
            raise UsageError(
                f"{folder}: this file system's hard links are copies, so commits are not atomic;"
                f" {ADVICE}"
            )
        try:
            os.link(first, second)
        except FileExistsError:
            second.rename(third)
            if third.stat().st_nlink == 2 and not second.exists():
                return
        raise UsageError(
            f"{folder}: this file system lets a second writer take the name of a finished file;"
            f" {ADVICE}"
        )
    except OSError as error:
        why = error.strerror or error
        if error.errno not in GONE_OR_FULL and first.exists() and not second.exists():
            raise UsageError(
                f"{folder}: this file system has no hard links ({why}), so commits are not atomic;"
                f" {ADVICE}"
            ) from error
        raise StoreError(f"{folder} cannot be a store: {why}") from error
    finally:
        with suppress(OSError):
            for path in (first, second, third):
                path.unlink(missing_ok=True)


def _race(place: Place, name: str) -> None:
    """Let some writers commit at once; each commit must get its own number."""
    from deltalake import DeltaTable

    with explained(place.url):
        DeltaTable.create(place.of(name), SCHEMA, storage_options=place.options)
    tables = [place.table(name) for _ in range(WRITERS)]
    start = Barrier(WRITERS, timeout=STARTS_S)

    def commit(table: DeltaTable) -> None:
        from deltalake import CommitProperties

        try:
            start.wait()
        except BrokenBarrierError:
            raise StoreError(
                f"{place}: whether commits exclude each other was not tried: of {WRITERS} threads"
                f" at least one did not start within {STARTS_S:g} s"
            ) from None
        with explained(place.url):
            table.create_write_transaction(
                [], "append", SCHEMA, commit_properties=CommitProperties(max_commit_retries=20)
            )

    with ThreadPoolExecutor(WRITERS) as pool:
        try:
            [*pool.map(commit, tables)]
        finally:
            start.abort()  # where not all could be started, the others must not wait for them
    last = place.table(name).version()
    if last != WRITERS:
        lost = f"of {WRITERS} commits at once {WRITERS - last} were overwritten"
        raise UsageError(
            f"{place}: {lost}: this storage has no conditional writes (If-None-Match); {ADVICE}"
        )
