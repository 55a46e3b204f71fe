"""The child process that seals a run's rows, so that the recorder need not load what sealing
needs.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.locks import FolderLock

SEAL_S: Final = 3600.0  # default interval


class SealChild:
    """`seal.seal_journal` in a child process of low priority, which holds the folder's lock even if
    the recorder dies.
    """

    def __init__(self, folder: Path, lock: FolderLock, *, part: bool = False) -> None:
        command = [
            sys.executable,
            "-P",
            "-m",
            "jbclog.record.seal",
            str(folder),
            "--lock",
            str(lock.descriptor),
        ]
        self._child = subprocess.Popen(
            command + (["--part"] if part else []),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            pass_fds=[lock.descriptor],
            start_new_session=True,  # Ctrl-C must not end the sealing
        )

    @property
    def pid(self) -> int:
        return self._child.pid

    def ended(self) -> str | None:
        """Return None while it works, then the error's text, empty for success."""
        return None if self._child.poll() is None else self.wait()

    def wait(self) -> str:
        """Wait for its end; return the error's text, empty for success."""
        _, stderr = self._child.communicate()
        if self._child.returncode == 0:
            return ""
        return (
            stderr.decode(errors="replace").strip()
            or f"the sealing child ended with {self._child.returncode}"
        )


def seal_in_child(folder: Path, lock: FolderLock) -> None:
    """Run `seal_journal` in a child process and wait for it. Raises `RecordError`."""
    problem = SealChild(folder, lock).wait()
    if problem:
        raise RecordError(problem)
