"""How the end of a child process is awaited without waiting for it for long."""

from __future__ import annotations

import subprocess
from threading import Thread


def kill(child: subprocess.Popen[bytes], most_s: float) -> None:
    """Kill `child` and wait `most_s` for its end."""
    child.kill()
    await_end(child, most_s)


def await_end(child: subprocess.Popen[bytes], most_s: float) -> None:
    """Wait `most_s` for the end of `child`.

    On a busy machine a process of low priority takes longer to end, and a hanging disk keeps one
    from it. A thread waits for it then, so that the system can forget it.
    """
    try:
        child.wait(most_s)
    except subprocess.TimeoutExpired:
        Thread(target=child.wait, name="end of a child", daemon=True).start()
