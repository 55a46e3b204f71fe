"""How a child process is killed without waiting for it for long."""

from __future__ import annotations

import subprocess
from threading import Thread


def kill(child: subprocess.Popen[bytes], most_s: float) -> None:
    """Kill `child` and wait `most_s` for its end.

    On a busy machine a process of low priority takes longer to end, and a hanging disk keeps one
    from it. A thread waits for it then, so that the system can forget it.
    """
    child.kill()
    try:
        child.wait(most_s)
    except subprocess.TimeoutExpired:
        Thread(target=child.wait, name="end of a child", daemon=True).start()
