"""`jbclog` in a process that was forked from one with everything imported: half a second of CPU
less for each command.

`Warm` is a `subprocess.Popen` of the command's words; `warm_command.py` is a program for a shell;
`fork_modules` has a module of the product fork what it would start with ``-P -m``. The process that
forks serves all workers of a session and ends with the last one. What a test proves of how a
process begins (its memory, its imports, its first descriptors) takes a fresh interpreter.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import gc
import importlib
import io
import json
import os
import runpy
import select
import selectors
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

from support import program

VERBS = (
    *("alarms", "annotate", "audit", "batch", "check", "doctor", "maintenance", "plan"),
    *("read", "recover", "report", "run", "runs", "safe", "scan", "write"),
)
IMPORTED = (
    *(
        "jbclog.cli.app",
        "jbclog.app.run.runner",
        "jbclog.analysis.run",
        "jbclog.record.check",
        "jbclog.record.recover",
    ),
    *(
        "jbclog.report.write",
        "jbclog.app.batch",
        "jbclog.app.audit",
        "jbclog.app.discovery",
        "jbclog.app.reproduce",
    ),
    *("jbclog.app.batch.child", "jbclog.record.seal", "jbclog.sim.serve", "jbclog.sim.setup"),
    *(f"jbclog.cli.{name}" for name in VERBS),
)
STARTING = ("jbclog.app.batch.processes", "jbclog.record.seal_child")
"""Modules that start modules; a guard is an interpreter of its own, as on a line."""
STATUS = struct.Struct("=i")
ADDRESS = "JBCLOG_TESTS_WARM"
ASKING = threading.Lock()  # an answer is that of the last question


class Forked(subprocess.Popen[Any]):
    """A module of the product that is started with ``-P -m``, in the folder and environment of the
    caller; other programs are executed.
    """

    _status = -1

    def _execute_child(self, args: Sequence[str], *rest: Any) -> None:
        """Have it forked instead of executed; the pipes are those that `Popen` made."""
        if list(args[:3]) == [sys.executable, "-P", "-m"]:
            self._fork({"module": args[3], "words": args[4:]}, rest)
        else:
            super()._execute_child(args, *rest)  # type: ignore[misc]

    def _fork(self, asked: Mapping[str, object], rest: Sequence[Any]) -> None:
        self._status, ending = os.pipe()
        passed, cwd, ends, own_session = rest[3], rest[4], rest[9:15], rest[20]
        inner = [
            end if end >= 0 else number for number, end in enumerate((ends[0], ends[3], ends[5]))
        ]
        words = {
            **asked,
            "cwd": str(cwd or Path.cwd()),
            "environment": dict(os.environ),
            "numbers": [0, 1, 2, *passed],
            "own_session": own_session,
        }
        with ASKING:
            server = _server(os.getpid())
            socket.send_fds(server, [json.dumps(words).encode()], [*inner, *passed, ending])
            self.pid = int(server.recv(64))
        os.close(ending)
        self._child_created = True
        self._close_pipe_fds(*ends)  # type: ignore[attr-defined]

    def _try_wait(self, flags: int) -> tuple[int, int]:
        if self._status < 0:
            return super()._try_wait(flags)  # type: ignore[misc, no-any-return]
        if flags & os.WNOHANG and not select.select([self._status], [], [], 0)[0]:
            return 0, 0
        data = os.read(self._status, STATUS.size)
        os.close(self._status)
        return self.pid, STATUS.unpack(data)[0] if data else 255 << 8

    def _internal_poll(self, *given: Any, **named: Any) -> int | None:
        if self._status < 0:
            return super()._internal_poll(*given, **named)  # type: ignore[misc, no-any-return]
        if self.returncode is None:
            with self._waitpid_lock:  # type: ignore[attr-defined]
                if self.returncode is None and (ended := self._try_wait(os.WNOHANG))[0]:
                    self._handle_exitstatus(ended[1])  # type: ignore[attr-defined]
        return self.returncode


class Warm(Forked):
    """The command with these words."""

    def __init__(self, words: Sequence[str], cwd: Path | None = None, **pipes: Any) -> None:
        super().__init__(
            words, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **pipes
        )

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> None:
        """After a failure nobody would end it: it is killed, not waited for."""
        if kind is not None:
            self.kill()
        super().__exit__(kind, *rest)

    def _execute_child(self, args: Sequence[str], *rest: Any) -> None:
        self._fork({"words": args}, rest)


def fork_modules(of: ModuleType) -> None:
    """Have a module of the product fork the modules that it starts."""
    of.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": Forked})  # type: ignore[attr-defined]


@cache
def _server(_of: int) -> socket.socket:
    """A connection of this process to the one that forks."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    with _locked():
        try:
            connection.connect(str(address()))
        except (FileNotFoundError, ConnectionRefusedError):
            _begin_server(address())
            connection.connect(str(address()))
    atexit.register(connection.close)
    return connection


def address() -> Path:
    """Where the process that forks is asked: one for all workers of a session, and for what it has
    forked.
    """
    own = f"jbclog-warm-{os.environ.get('PYTEST_XDIST_TESTRUNUID', os.getpid())}"
    return Path(os.environ.get(ADDRESS, Path(tempfile.gettempdir()) / own))


def connected() -> Path:
    """The same, of a process that runs as long as this one."""
    _server(os.getpid())
    return address()


@contextlib.contextmanager
def _locked() -> Iterator[None]:
    """No server begins or ends while somebody else connects."""
    folder = os.open(tempfile.gettempdir(), os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _begin_server(at: Path) -> None:
    at.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(at))
        listening.listen(64)
        listening.set_inheritable(True)
        nothing = (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0)
        command = program("warm_start", at, listening.fileno())
        os.posix_spawn(command[0], command, os.environ, file_actions=[nothing])


class Server:
    """Forks for each question on a connection."""

    def __init__(self, at: Path, listening: socket.socket) -> None:
        self._at, self._listening = at, listening
        self._waiting = selectors.DefaultSelector()
        self._waiting.register(listening, selectors.EVENT_READ)
        self._connections: list[socket.socket] = []
        self._bound: dict[int, socket.socket] = {}  # the processes that end with their connection

    def serve(self) -> Mapping[str, Any] | None:
        """In a child what was asked; None when nobody is connected any more."""
        while True:
            for key, _ in self._waiting.select():
                if isinstance(key.fileobj, int):
                    self._end(key.fileobj, *key.data)
                elif key.fileobj is self._listening:
                    self._accept()
                elif asked := self._answer(cast("socket.socket", key.fileobj)):
                    return asked
            if self._is_over():
                return None

    def _accept(self) -> None:
        self._connections.append(self._listening.accept()[0])
        self._waiting.register(self._connections[-1], selectors.EVENT_READ)

    def _answer(self, asking: socket.socket) -> Mapping[str, Any] | None:
        """In the child what was asked, None in the process that forks."""
        try:
            data, received, _, _ = socket.recv_fds(asking, 1 << 20, 16)
        except ConnectionResetError:  # it was killed before it took an answer
            data = b""
        if not data:
            self._close(asking)
            return None
        asked: Mapping[str, Any] = json.loads(data)
        *inner, ending = received
        child = os.fork()
        if child == 0:
            self._leave(inner, ending, asked.get("numbers", range(3)))
            return asked
        for descriptor in inner:
            os.close(descriptor)
        self._waiting.register(os.pidfd_open(child), selectors.EVENT_READ, (child, ending))
        if asked.get("bound"):
            self._bound[child] = asking
        with contextlib.suppress(BrokenPipeError):
            asking.send(str(child).encode())
        return None

    def _close(self, asking: socket.socket) -> None:
        for child in [child for child, connection in self._bound.items() if connection is asking]:
            os.kill(child, signal.SIGKILL)
        self._waiting.unregister(asking)
        self._connections.remove(asking)
        asking.close()

    def _end(self, pidfd: int, child: int, ending: int) -> None:
        """Hand on how a child ended."""
        self._waiting.unregister(pidfd)
        os.close(pidfd)
        self._bound.pop(child, None)
        with contextlib.suppress(BrokenPipeError):
            os.write(ending, STATUS.pack(os.waitpid(child, 0)[1]))
        os.close(ending)

    def _is_over(self) -> bool:
        """Whether nobody is connected, and nobody can be any more."""
        if self._connections:
            return False
        with _locked():
            if select.select([self._listening], [], [], 0)[0]:
                return False
            self._at.unlink(missing_ok=True)
            return True

    def _leave(self, inner: Sequence[int], ending: int, numbers: Sequence[int]) -> None:
        """Have nothing in the child but its descriptors, at their numbers."""
        others = [
            descriptor
            for key in self._waiting.get_map().values()
            for descriptor in (key.fd, *(key.data or ())[1:])
        ]
        self._waiting.close()
        beyond = max(numbers) + 1
        aside = [fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, beyond) for descriptor in inner]
        for descriptor in (*inner, ending, *others):
            os.close(descriptor)
        for connection in (self._listening, *self._connections):
            connection.detach()
        for number, descriptor in zip(numbers, aside, strict=True):
            os.dup2(descriptor, number)
            os.close(descriptor)


def _begin_streams() -> None:
    """Streams of their own for the three descriptors, as an interpreter begins with."""
    sys.stdin = sys.__stdin__ = open(0, closefd=False)  # type: ignore[misc]  # noqa: SIM115  # they last as long as the process
    for number, name, errors in ((1, "stdout", "strict"), (2, "stderr", "backslashreplace")):
        descriptor = open(number, "wb", closefd=False)  # noqa: SIM115
        stream = io.TextIOWrapper(
            descriptor, errors=errors, newline="\n", line_buffering=number == 2
        )
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def main() -> None:
    """The process that forks, and then each of its children, whose jobs and sealing are forked,
    too.
    """
    for name in IMPORTED:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()
    at = sys.argv[1]
    asked = Server(Path(at), socket.socket(fileno=int(sys.argv[2]))).serve()
    if asked is None:
        return
    os.environ.clear()
    os.environ.update(asked["environment"], **{ADDRESS: at})
    os.chdir(asked["cwd"])
    time.tzset()
    if asked.get("own_session"):
        os.setsid()
    _begin_streams()
    for name in STARTING:
        fork_modules(importlib.import_module(name))
    try:
        if "module" in asked:
            _run_module(asked["module"], asked["words"])
        else:
            _run_command(asked["words"])
    # as the interpreter ends, but for taking its modules apart, which copies all of their memory
    except SystemExit as ended:
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1)


def _run_module(name: str, words: Sequence[str]) -> None:
    sys.argv = [name, *words]
    sys.modules.pop(name, None)  # or it would be said that it is run a second time
    runpy.run_module(name, run_name="__main__", alter_sys=True)


def _run_command(words: Sequence[str]) -> None:
    sys.argv, sys.path[0] = ["-c", *words], ""
    sys.modules["__main__"].__package__ = None  # by which typer names the command
    from jbclog.cli import main as jbclog

    jbclog()


if __name__ == "__main__":
    main()
