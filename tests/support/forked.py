"""Programs in processes of their own, forked from one that has imported what they take: a second of
CPU less for each.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path


def forked(
    main: Callable[[Sequence[str]], object],
    words: Sequence[str],
    imported: Sequence[str],
    log: Path,
    home: Path | None = None,
) -> BaseProcess:
    """Call `main` with `words` in a process, in the folder `home` and in the environment of the
    caller; what it prints goes to `log`. The caller kills and joins it.

    What is imported before is decided by the first that is forked in a session's worker.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*imported])
    process = context.Process(
        target=_called, args=(main, words, str(log), str(home or Path.cwd()), dict(os.environ))
    )
    process.start()
    return process


def _called(
    main: Callable[[Sequence[str]], object],
    words: Sequence[str],
    log: str,
    home: str,
    environment: dict[str, str],
) -> None:
    with Path(log).open("ab") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(home)
    sys.argv = [str(main), *words]
    main(words)
