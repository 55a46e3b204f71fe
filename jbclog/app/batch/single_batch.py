"""Locks that allow one executor per jobs file; the system releases them when their holder ends."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.files import Kind, open_regular, open_to_write
from jbclog.core.json_files import read_json
from jbclog.core.operating_system import lock_exclusive, sync_folder, write_at

LOCK: Final = "lock"
WIDTH: Final = 200
TAKEN: Final = (errno.EWOULDBLOCK, errno.EACCES)


@contextmanager
def hold(home: Path, jobs_file: Path, since: str) -> Iterator[None]:
    """Lock the batches in `home`, created if missing, and their jobs file.

    Raises `UsageError` naming the holder, `RecordError` if the folder cannot be created.
    """
    try:
        if not home.is_dir():
            home.mkdir(parents=True)
            sync_folder(home.absolute().parent)
        descriptor = open_to_write(home / LOCK, Kind.LOCK)
    except OSError as error:
        raise RecordError(
            f"{home} cannot be created or locked: {write_failure(error, home)}; nothing was started"
        ) from error
    try:
        if not _lock(descriptor):
            raise UsageError(
                f"{jobs_file}: {_holder(home)}; nothing was started. End it there, or wait for"
                " its end"
            )
        with open_regular(jobs_file, Kind.SETTINGS, links=True) as file:
            if not _lock(file.fileno()):
                raise UsageError(
                    f"{jobs_file}: another batch of this file runs with another --out; nothing was"
                    " started"
                )
            text = json.dumps({"pid": os.getpid(), "since": since})
            write_at(descriptor, text.ljust(WIDTH).encode(), 0)
            yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int) -> bool:
    """Lock the file; False if another process holds it, True on a file system without locks."""
    try:
        lock_exclusive(descriptor)
    except OSError as error:
        return error.errno not in TAKEN
    return True


def _holder(home: Path) -> str:
    with suppress(OSError, ValueError, KeyError, TypeError):
        holder = read_json(home / LOCK, Kind.LOCK)
        return f"process {holder['pid']} has been running it since {holder['since']}"
    return "another process is running it"
