"""A small file system of its own, which only root can put there."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest


@contextmanager
def small_disk(place: Path, size: str, inodes: int | None = None) -> Iterator[Path]:
    """Mount one of `size` (``3m``) at `place` while a `with` lasts, with that many `inodes`, its
    own folder included; the test is skipped where that cannot be.
    """
    place.mkdir()
    options = f"size={size}" if inodes is None else f"size={size},nr_inodes={inodes}"
    command = ["mount", "-t", "tmpfs", "-o", options, "jbclog-test", str(place)]
    if (
        os.geteuid() != 0
        or subprocess.run(command, capture_output=True, check=False).returncode != 0
    ):
        pytest.skip("needs root, to mount a small file system")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def take_inodes(disk: Path) -> Path:
    """Take all inodes that there are; give the folder of what holds them."""
    folder = disk / "fillers"
    folder.mkdir()
    for number in count():
        try:
            (folder / str(number)).touch()
        except OSError:
            return folder
    raise AssertionError


def fill(disk: Path) -> Path:
    """Take all room that there is; give what holds it."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 16, 512):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
    return filler
