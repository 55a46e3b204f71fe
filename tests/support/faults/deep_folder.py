"""Folders in one another, more than a program can call itself."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LEVELS = 1100
NAME = "d"


@contextmanager
def deep_folder(home: Path) -> Iterator[None]:
    """They are in `home` while a `with` lasts; what cleans up behind tests calls itself as well."""
    made, path = [], os.fspath(home)
    try:
        for _ in range(LEVELS):
            path = f"{path}/{NAME}"
            os.mkdir(path)  # noqa: PTH102  # a `Path` so deep takes long
            made.append(path)
        yield
    finally:
        for path in reversed(made):
            os.rmdir(path)  # noqa: PTH106
