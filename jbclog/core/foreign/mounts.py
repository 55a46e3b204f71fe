"""Folders on a network mount that may hang: asked by a child with a time limit, because who asks it waits without end.

A call on such a folder cannot be interrupted, not by a signal either. So before the first look at a folder that the user names a
child looks, where the folder lies on a network mount; on a local disk nothing is asked. A mount that begins to hang later is not
found by this.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError

ANSWERS_S: Final = 5.0
MOUNTS: Final = Path("/proc/self/mountinfo")
REMOTE: Final = re.compile(r"nfs\d?|cifs|smb\w*|9p|afs|ceph|lustre|gluster\w*|davfs|fuse(\..*)?|autofs")
LOOK: Final = "import os, sys; os.scandir(sys.argv[1]).close()"
MOST_LINKS: Final = 40


def expect_answer(folder: Path) -> None:
    """Raise `RecordError` where `folder` lies on a network mount that does not answer within `ANSWERS_S`."""
    if not _is_remote(folder):
        return
    child = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", LOOK, str(folder)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        child.wait(ANSWERS_S)
    except subprocess.TimeoutExpired:
        child.kill()  # it ends when the mount answers, and is not waited for
        raise RecordError(f"{folder} does not answer within {ANSWERS_S:g} s: its network mount hangs") from None


def _is_remote(folder: Path) -> bool:
    """Whether the path leads to or through a network mount; nothing below one is touched to find out."""
    mounts = _remote_mounts()
    left, links = [*folder.absolute().parts[1:]][::-1], 0
    here = Path("/")
    while mounts and left:
        here = Path(os.path.normpath(here / left.pop()))
        if here in mounts:
            return True
        try:
            target = here.readlink()
        except OSError:
            continue
        links += 1
        if links > MOST_LINKS:
            return False
        left += [*target.parts[1 if target.is_absolute() else 0 :]][::-1]
        here = Path("/") if target.is_absolute() else here.parent
    return False


def _remote_mounts() -> set[Path]:
    """Where network mounts are; nowhere where the system does not say."""
    try:
        lines = MOUNTS.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return set()
    told = (line.partition(" - ") for line in lines)
    return {_place(before.split()[4]) for before, _, behind in told if REMOTE.fullmatch(behind.split(" ")[0])}


def _place(text: str) -> Path:
    """A mount's place, in which blanks are written as octal numbers."""
    return Path(re.sub(r"\\([0-7]{3})", lambda found: chr(int(found[1], 8)), text))
