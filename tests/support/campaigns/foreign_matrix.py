"""Every verb against files that are not what their names say: each pair in a child with a deadline
and little memory.

The pairs are run by one process that has everything loaded and forks for each (``python
foreign_matrix.py``, a JSON line a pair).
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from support import program
from support.campaigns.awaited import INTERNAL_ERROR

DEADLINE_S: Final = 5.0  # of processor time and of waiting, each
HANGS_S: Final = 40.0  # on the wall, on a machine that has other work
WHOLE_S: Final = 600.0  # for a valid record of many rows, which takes its time
MEMORY: Final = 500  # MB resident, the program and its libraries included
# reserved beyond what the program has when it is loaded; threads reserve much and use little
ADDRESSES: Final = 3 << 30
CODES: Final = range(6)
MOST_LINES: Final = 400

VERBS: Final = {
    "check": ["check", "{run}"],
    "report": ["report", "{run}"],
    "export --to csv": [
        "export",
        "{run}",
        "--to",
        "csv",
        "--out",
        "{ledger}.exported",
        "--force",
        "--unchecked",
    ],
    "runs": ["runs", "{runs}"],
    "trend": ["trend", "{runs}"],
    "compare": ["compare", "{run}", "{other}"],
    "recover": ["recover", "{runs}"],
    "where-used": ["where-used", "{runs}", "--station", "dde-1", "--since", "2026-01-01"],
    "alarms": ["alarms", "{run}"],
    "annotate": ["annotate", "{run}", "x", "--by", "x", "--reason", "x"],
    "audit --runs": ["audit", "--line", "{line}", "--ledger", "{ledger}", "--runs", "{runs}"],
    "replay": ["replay", "{run}", "--record", "{ledger}.again"],
    "start of the next run": ["@start", "{runs}"],
}
OF_A_FOLDER: Final = (
    "runs",
    "trend",
    "recover",
    "where-used",
    "audit --runs",
    "start of the next run",
)


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended: its exit code (None: it was ended by the deadline, below 0: by a signal),
    and what it said.
    """

    code: int | None
    seconds: float
    output: str
    peak_mb: int = 0

    @property
    def trouble(self) -> str | None:
        """What is wrong with that; None where it is an answer."""
        if self.code is None:
            return f"no answer within {HANGS_S:g} s"
        if self.code not in CODES:
            return f"ended with {self.code}: {self.output[-200:]}"
        for word in (INTERNAL_ERROR, "Traceback", "MemoryError"):
            if word in self.output:
                return self.output[self.output.index(word) :][:300]
        if self.peak_mb > MEMORY:
            return f"took {self.peak_mb} MB"
        return (
            None if self.output.count("\n") <= MOST_LINES else f"{self.output.count(chr(10))} lines"
        )


class Pairs:
    """The process that forks for each pair."""

    def __init__(self) -> None:
        home = tempfile.mkdtemp(prefix="jbclog-matrix-")
        self._home = home
        environment = {**os.environ, "NO_COLOR": "1"}
        environment |= {"XDG_STATE_HOME": home, "XDG_CACHE_HOME": home}
        self.index = Path(home) / "jbclog" / "runs-1.sqlite"
        environment.pop("JBCLOG_TRACEBACK", None)
        self._child = subprocess.Popen(
            program("campaigns.foreign_matrix"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def run(self, words: list[str], *, limited: bool = True) -> Ended:
        """Run jbclog with these words; without `limited`, in little memory and as long as it
        takes.
        """
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.write(json.dumps([limited, *words]) + "\n")
        self._child.stdin.flush()
        return Ended(**json.loads(self._child.stdout.readline()))

    def close(self) -> None:
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.close()
        self._child.wait(60)
        self._child.stdout.close()
        shutil.rmtree(self._home, ignore_errors=True)


# -- what stands in the place of a file ------------------------------------------------------------


def _socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # its address may have 108 bytes
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(here)


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 30)


def _device(path: Path) -> None:
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, 5))
    except PermissionError:  # only root makes devices
        path.symlink_to("/dev/zero")


SPECIAL: Final[dict[str, Callable[[Path], None]]] = {
    "pipe": os.mkfifo,
    "socket": _socket,
    "device": _device,
    "link to /dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "link inside": lambda path: path.symlink_to("line.toml"),
    "link outside": lambda path: path.symlink_to("/etc/passwd"),
    "dangling link": lambda path: path.symlink_to("nowhere"),
    "loop": lambda path: path.symlink_to(path),
    "folder": Path.mkdir,
    "1 GB": _sparse,
    "empty": lambda path: path.write_bytes(b"") and None,
}


def put(path: Path, made: Callable[[Path], None]) -> None:
    """Make something in the place of what is at `path`."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    made(path)


# -- the process that forks ------------------------------------------------------------------------


def _load() -> None:
    """Everything that a verb loads, so that a child need not."""
    import jbclog.analysis
    import jbclog.analysis.rejudge
    import jbclog.analysis.trend
    import jbclog.app.audit.run_audit
    import jbclog.cli.app
    import jbclog.guard.open_leases
    import jbclog.maintenance.fleet
    import jbclog.maintenance.suspect_runs
    import jbclog.record.check
    import jbclog.record.recover
    import jbclog.report.write  # noqa: F401


def _serve() -> None:
    _load()
    for line in sys.stdin:
        limited, *words = json.loads(line)
        print(json.dumps(_forked(words, limited=limited)), flush=True)


def _forked(words: list[str], *, limited: bool) -> dict[str, Any]:
    with tempfile.TemporaryFile() as said:
        began = time.monotonic()
        child = os.fork()
        if not child:
            _run(words, said.fileno(), limited=limited)
        ended, status, peak = 0, 0, 0
        while not ended and time.monotonic() - began < (HANGS_S if limited else WHOLE_S):
            ended, status, used = os.wait4(child, os.WNOHANG)
            peak = used.ru_maxrss // 1024 if ended else 0
            time.sleep(0.002)
        if not ended:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        said.seek(0)
        output = said.read(200_000).decode(errors="replace")
    code = os.waitstatus_to_exitcode(status) if ended else None
    return {"code": code, "seconds": time.monotonic() - began, "output": output, "peak_mb": peak}


def _run(words: list[str], said: int, *, limited: bool) -> None:
    """The child: it has so much memory and, if `limited`, so much time of the processor, and ends
    here.
    """
    code = 70
    try:
        null = os.open(os.devnull, os.O_RDONLY)
        for number, descriptor in enumerate((null, said, said)):
            os.dup2(descriptor, number)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115  # the child's
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + ADDRESSES, taken + ADDRESSES))
        if limited:
            resource.setrlimit(resource.RLIMIT_CPU, (int(DEADLINE_S), int(DEADLINE_S)))
        code = _verb(words)
        sys.stdout.flush()
        sys.stderr.flush()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 0
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _verb(words: list[str]) -> int:
    own = {"@start": _start, "@journal": _journal, "@queue": _queue}.get(words[0])
    if own is not None:
        return own(Path(words[1]))
    from jbclog.cli.app import main

    sys.argv = ["jbclog", *words]
    main()
    return 0


def _start(out: Path) -> int:
    """What the start of a run looks at below its folder of runs."""
    from jbclog.guard.open_leases import unclosed
    from jbclog.record.chains import previous_run

    print(previous_run(out, "bench"), [*unclosed(out, ["/dev/none"])])
    return 0


def _journal(home: Path) -> int:
    """What `jbclog batch` reads of the batches of a jobs file, before it starts anything."""
    from jbclog.app.batch.journal import newest
    from jbclog.core.errors import RecordError

    try:
        print(newest(home, time.time))
    except RecordError as error:
        print(error)
        return 4
    return 0


def _queue(home: Path) -> int:
    """What `watch` shows of them."""
    from jbclog.app.watch.batch_queue import queue_of

    print(queue_of(home).text)
    return 0


def words_of(verb: str, places: dict[str, Path]) -> list[str]:
    return [
        word.format(**{name: str(path) for name, path in places.items()}) for word in VERBS[verb]
    ]


def table(results: dict[str, list[Ended]]) -> Iterator[str]:
    """The campaign's table for the documentation: what stood there, pairs, answers, the longest."""
    yield "| what | pairs | answered | longest | most memory |"
    yield "|---|---|---|---|---|"
    for name, ended in results.items():
        fine = sum(one.trouble is None for one in ended)
        longest, most = max(one.seconds for one in ended), max(one.peak_mb for one in ended)
        yield f"| {name} | {len(ended)} | {fine} | {longest:.1f} s | {most} MB |"


if __name__ == "__main__":
    _serve()
