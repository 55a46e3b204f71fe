"""Virtual stations in a separate process, for the duration of a `with` block."""

from __future__ import annotations

import selectors
import subprocess
import sys
from pathlib import Path
from typing import IO, Self

from jbclog.core.errors import UsageError

READY_S = 20.0
END_S = 5.0


class SimProcess:
    """Serve the stations of the line file at `line` below `folder`; `line_path` is the line file
    for a run.

    The process ends with the `with` block, and also, by the end of its stdin, when this process
    dies. Raises `UsageError` if the stations cannot be served.
    """

    def __init__(
        self, line: Path, folder: Path, *, tcp: str | None = None, log: Path | None = None
    ) -> None:
        self._command = [
            sys.executable,
            "-P",
            "-m",
            "jbclog.sim",
            str(line),
            "--dir",
            str(folder),
            "--until-eof",
        ]
        self._command += ["--tcp", tcp] if tcp else []
        self._command += ["--log", str(log)] if log else []
        self._process: subprocess.Popen[str] | None = None
        self.line_path = folder / "line.toml"

    @property
    def pid(self) -> int | None:
        """Id of the serving process; None if there is none."""
        return self._process.pid if self._process else None

    def __enter__(self) -> Self:
        self._process = process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            self.line_path = Path(_first_line(process))
        except BaseException:
            self._end(process)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            process, self._process = self._process, None
            self._end(process)

    def _end(self, process: subprocess.Popen[str]) -> None:
        """Close its stdin, which ends it; kill it if it does not end."""
        try:
            process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def _first_line(process: subprocess.Popen[str]) -> str:
    """Read the line that reports that all ports exist."""
    if process.stdout is None or process.stderr is None:
        raise UsageError("the virtual stations have no output")
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        text = process.stdout.readline().strip() if selector.select(READY_S) else ""
    if not text:
        process.kill()
        raise UsageError(f"the virtual stations did not start: {_rest(process.stderr)}")
    return text


def _rest(stream: IO[str]) -> str:
    return stream.read().strip() or f"nothing within {READY_S:g} s"
