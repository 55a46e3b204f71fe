"""The folder that runs are recorded in: whether files can be kept there, and for how long there is room."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

from jbclog.app.doctor.result import Fine, Looked
from jbclog.core.durable_files import write_whole
from jbclog.session.discovery.found import Finding

LEAST_FREE = 500_000_000  # bytes: some days of a few stations, and what is not sealed yet
PROBE_BYTES = 4096


def look_at_folder(out: Path) -> list[Looked]:
    """Whether a run could be recorded below `out`, which need not be there yet."""
    folder = nearest(out)
    try:
        _prove(folder)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return [
            Finding("disk.no_write", str(out), f"no file can be kept in {folder}: {error.strerror or error}", _step(error, folder))
        ]
    return [_room(out, free)]


def nearest(out: Path) -> Path:
    """`out`, or the folder above it that is there."""
    return next(place for place in (out.absolute(), *out.absolute().parents) if place.exists())


def _prove(folder: Path) -> None:
    """Write, sync, rename and remove a file, as a run will."""
    probe = folder / f".jbclog-doctor-{os.getpid()}"
    try:
        write_whole(probe, bytes(PROBE_BYTES))
    finally:
        probe.unlink(missing_ok=True)


def _step(error: OSError, folder: Path) -> str:
    if error.errno == errno.ENOSPC:
        return f"make room on the disk of {folder}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"let your user write there: `sudo chown $USER {folder}`"
    return "record elsewhere: `--out DIR` with a folder on a disk that can be written to"


def _room(out: Path, free: int) -> Looked:
    told = f"{free / 1e9:.1f} GB are free"
    if free < LEAST_FREE:
        what = f"only {free / 1e6:.0f} MB are free; a station with two ports at 10 Hz fills some 30 MB a day"
        return Finding("disk.space", str(out), what, f"make room on the disk of {nearest(out)}")
    return Fine("disk", str(out), f"files can be kept here, {told}")
