"""`jbclog` in a process that was forked from one with everything imported: half a second of CPU less for each command.

`Warm` is a `subprocess.Popen` of the command's words. The process that forks is started once for each process of the tests and ends
with it. What a test proves of how a process begins (its memory, its imports, its first descriptors) takes a fresh interpreter.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import io
import json
import os
import select
import selectors
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from support import program

VERBS = ("audit", "batch", "check", "read", "recover", "replay", "report", "run", "safe", "scan", "write")
IMPORTED = (
    *("jbclog.cli.app", "jbclog.app.run.runner", "jbclog.analysis.run", "jbclog.record.check", "jbclog.record.recover"),
    *("jbclog.report.write", "jbclog.app.batch", "jbclog.app.audit", "jbclog.app.discovery", "jbclog.app.replay"),
    *(f"jbclog.cli.{name}" for name in VERBS),
)
STATUS = struct.Struct("=i")


class Warm(subprocess.Popen[str]):
    """The command with these words, in the folder and environment of the caller."""

    def __init__(self, words: Sequence[str], cwd: Path | None = None, **pipes: Any) -> None:
        self._status, self._ending = os.pipe()
        super().__init__(words, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **pipes)

    def _execute_child(self, args: Sequence[str], *rest: Any) -> None:
        """Have it forked instead of executed; the pipes are those that `Popen` made."""
        cwd, ends = rest[4], rest[9:15]
        asked = {"words": args, "cwd": str(cwd or Path.cwd()), "environment": dict(os.environ)}
        inner = [end if end >= 0 else number for number, end in enumerate((ends[0], ends[3], ends[5]))]
        server = _server(os.getpid())
        socket.send_fds(server, [json.dumps(asked).encode()], [*inner, self._ending])
        self.pid = int(server.recv(64))
        os.close(self._ending)
        self._child_created = True
        self._close_pipe_fds(*ends)  # type: ignore[attr-defined]

    def _try_wait(self, flags: int) -> tuple[int, int]:
        if flags & os.WNOHANG and not select.select([self._status], [], [], 0)[0]:
            return 0, 0
        data = os.read(self._status, STATUS.size)
        os.close(self._status)
        return self.pid, STATUS.unpack(data)[0] if data else 255 << 8

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        if self.returncode is None:
            with self._waitpid_lock:  # type: ignore[attr-defined]
                if self.returncode is None and (ended := self._try_wait(os.WNOHANG))[0]:
                    self._handle_exitstatus(ended[1])  # type: ignore[attr-defined]
        return self.returncode


@cache
def _server(_of: int) -> socket.socket:
    """The process that forks, of this one."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    process = subprocess.Popen(program("warm_start", theirs.fileno()), pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
    theirs.close()
    atexit.register(_close, ours, process)
    return ours


def _close(server: socket.socket, process: subprocess.Popen[bytes]) -> None:
    server.close()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(10)


def serve(asking: socket.socket) -> Mapping[str, Any] | None:
    """Fork for each question; in the child what was asked, None at the end."""
    waiting = selectors.DefaultSelector()
    waiting.register(asking, selectors.EVENT_READ)
    while True:
        for key, _ in waiting.select():
            if key.data is not None:
                _end(waiting, key.fd, *key.data)
                continue
            data, received, _, _ = socket.recv_fds(asking, 1 << 20, 4)
            if not data:
                return None
            *inner, ending = received
            child = os.fork()
            if child == 0:
                _leave(waiting, asking, inner, ending)
                found: Mapping[str, Any] = json.loads(data)
                return found
            for descriptor in inner:
                os.close(descriptor)
            waiting.register(os.pidfd_open(child), selectors.EVENT_READ, (child, ending))
            asking.send(str(child).encode())


def _end(waiting: selectors.BaseSelector, pidfd: int, child: int, ending: int) -> None:
    """Hand on how a child ended."""
    waiting.unregister(pidfd)
    os.close(pidfd)
    with contextlib.suppress(BrokenPipeError):
        os.write(ending, STATUS.pack(os.waitpid(child, 0)[1]))
    os.close(ending)


def _leave(waiting: selectors.BaseSelector, asking: socket.socket, inner: Sequence[int], ending: int) -> None:
    """Have nothing in the child but its three descriptors."""
    others = [(key.fd, key.data[1]) for key in waiting.get_map().values() if key.data is not None]
    waiting.close()
    asking.close()
    for number, descriptor in enumerate(inner):
        os.dup2(descriptor, number)
    for descriptor in (*inner, ending, *(one for pair in others for one in pair)):
        os.close(descriptor)


def _begin_streams() -> None:
    """Streams of their own for the three descriptors, as an interpreter begins with."""
    sys.stdin = sys.__stdin__ = open(0, closefd=False)  # type: ignore[misc]  # noqa: SIM115  # they last as long as the process
    for number, name, errors in ((1, "stdout", "strict"), (2, "stderr", "backslashreplace")):
        stream = io.TextIOWrapper(open(number, "wb", closefd=False), errors=errors, newline="\n", line_buffering=number == 2)  # noqa: SIM115
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def main() -> None:
    """The process that forks, and then each of its children."""
    for name in IMPORTED:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()
    asked = serve(socket.socket(fileno=int(sys.argv[1])))
    if asked is None:
        return
    os.environ.clear()
    os.environ.update(asked["environment"])
    os.chdir(asked["cwd"])
    time.tzset()
    _begin_streams()
    sys.argv, sys.path[0] = ["-c", *asked["words"]], ""
    sys.modules["__main__"].__package__ = None  # by which typer names the command
    from jbclog.cli import main as jbclog

    try:
        jbclog()
    except SystemExit as ended:  # as the interpreter ends, but for taking its modules apart, which copies all of their memory
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1)


if __name__ == "__main__":
    main()
