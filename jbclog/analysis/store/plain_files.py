"""Regular files below a folder, and names of files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from jbclog.core.files import NotReadable, is_plain_folder, what_is


def plain_files(folder: Path) -> Iterator[Path]:
    """Yield all files below `folder`; ignores a missing folder and files removed meanwhile. Raises
    `NotReadable` for anything but regular files and folders, links included.
    """
    folders = [folder]
    while folders:
        here = folders.pop()
        if os.path.lexists(here) and not is_plain_folder(here):
            raise NotReadable(f"{here}: is not a folder of its own")
        with suppress(FileNotFoundError), os.scandir(here) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(here / entry.name)
                elif entry.is_file(follow_symlinks=False):
                    yield here / entry.name
                else:
                    what = what_is(entry.stat(follow_symlinks=False))
                    raise NotReadable(f"{entry.path}: is {what}, not a file")


LONGEST_NAME: Final = 255


def is_name(text: str) -> bool:
    """Return True if an untrusted text can be the name of a file or folder."""
    is_plain = text not in ("", ".", "..") and "/" not in text and "\0" not in text
    return is_plain and len(text.encode(errors="replace")) <= LONGEST_NAME
