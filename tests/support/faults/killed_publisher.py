"""A publisher that kills itself (SIGKILL) at one of its commits: ``python tests/support
faults.killed_publisher RUN STORE N WHEN``.

WHEN is ``before`` or ``after``: the commit is not made, or made and never answered. With N 0 it
publishes to its end.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from support.readers.texts import ROOT

COMMITS = 9
"""Of a run that has rows in every table."""


def start(run: Path, store: Path, number: int = 0, when: str = "before") -> subprocess.Popen[str]:
    command = [
        sys.executable,
        str(ROOT / "tests" / "support"),
        "faults.killed_publisher",
        str(run),
        str(store),
        str(number),
        when,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def dying(commits: object, number: int, when: str) -> None:
    """Have the commit of this number be the last."""
    made, done = commits.committed, 0  # type: ignore[attr-defined]  # the module

    def committed(place: object, commit: Callable[[], object]) -> bool:
        nonlocal done
        done += 1
        if done == number and when == "before":
            os.kill(os.getpid(), signal.SIGKILL)
        answer: bool = made(place, commit)
        if done == number:
            os.kill(os.getpid(), signal.SIGKILL)
        return answer

    commits.committed = committed  # type: ignore[attr-defined]  # the module


def main(run: str, store: str, number: str, when: str) -> None:
    from jbclog.analysis.store.place import place_of
    from jbclog.app.publish import commits
    from jbclog.app.publish.publisher import Publisher

    with Publisher(place_of(store)) as publisher:
        if int(number):
            dying(commits, int(number), when)
        print(publisher.publish(Path(run)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
