"""The stage of a transcript: a folder with the program in it, and virtual stations in memory on a
clock that jumps.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from typer.testing import CliRunner

from jbclog.app import connection, discovery, doctor, safe_state
from jbclog.app.audit import survey
from jbclog.app.batch import resume
from jbclog.app.doctor import Fine
from jbclog.app.port_access import PortAccess
from jbclog.app.run import runner
from jbclog.cli.app import app
from jbclog.core.clock import VirtualClock
from jbclog.core.errors import PortMissing
from jbclog.core.serial_line import LineFormat
from jbclog.record.recover import recover, recover_all
from support.links.uart_ports import Cable
from support.transcripts.given import GIVEN
from support.transcripts.varying import without_varying
from support.transcripts.virtual_batch import VirtualProcesses
from support.transcripts.virtual_conduct import VirtualConduct
from support.virtual.manual import MemoryPort, Wire, text_of

WIDTH = "100"
WRITES = "WDH"
FULL = "/dev/full"


class Stage:
    """Where a case is played. `wires` are the stations by url, `names` the urls by name."""

    def __init__(
        self, folder: Path, factory: pytest.TempPathFactory, patches: pytest.MonkeyPatch
    ) -> None:
        self.folder = folder
        self.factory = factory
        self.patches = patches
        self.clock = VirtualClock()
        self.wires: dict[str, Wire] = {}
        self.names: dict[str, str] = {}
        self.cables: dict[str, Cable] = {}
        self.conduct = VirtualConduct()
        self.at_end: list[Callable[[], None]] = []
        self.access: PortAccess | None = PortAccess(
            self._open,
            lambda seconds: self.clock.advance_to(self.clock.monotonic() + seconds),
            self.clock,
        )
        patches.chdir(folder)
        patches.setenv("COLUMNS", WIDTH)
        patches.setenv("TZ", "UTC")
        patches.setenv("LOGNAME", "operator")
        for variable in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
            patches.setenv(variable, str(factory.mktemp("home")))
        for module in (connection, discovery, doctor, survey):
            patches.setattr(module, "run_that_holds", lambda url: None)
        patches.setattr(safe_state, "runs_that_hold", lambda urls: [])
        patches.setattr(runner, "conduct", self.conduct)
        patches.setattr(resume, "SystemProcesses", VirtualProcesses)
        patches.setattr(doctor, "look_at_clock", lambda *_: Fine("clock", "clock", "it is right"))
        patches.setattr(doctor, "look_at_memory", lambda: Fine("memory", "memory", "enough"))
        patches.setattr(doctor, "look_at_modem_manager", list)
        patches.setattr(doctor, "usb_ports", list)
        for name in ("batch", "batch_progress"):
            patches.setattr(import_module(f"jbclog.cli.{name}"), "time", self._time())
        for function in (recover, recover_all):  # nobody's sealing is awaited
            patches.setattr(function, "__defaults__", (0.0,))

    def _time(self) -> SimpleNamespace:
        """The module `time` on the stage's clock."""
        assert self.access is not None
        return SimpleNamespace(**vars(time) | {"time": self.clock.utc, "sleep": self.access.sleep})

    def _open(self, url: str, line: LineFormat) -> MemoryPort:
        if url not in self.wires:
            raise PortMissing(f"{url}: no such port; check that it is plugged in")
        return MemoryPort(url, self.wires[url], self.clock)

    def wire(self, name: str) -> Wire:
        return self.wires[self.names[name]]

    def give(self, text: str) -> None:
        """Prepare what a `given:` line names."""
        name, _, rest = text.partition(" ")
        GIVEN[name](self, rest)

    def write(self, name: str, lines: list[str]) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def run(self, text: str, typed: list[str]) -> list[str]:
        """Call the program; return what it sent, printed and noted, and its exit code."""
        if text.endswith(f" > {FULL}"):
            return self._run_into_full(text.removesuffix(f" > {FULL}"))
        program, *words = shlex.split(text)
        assert program == "jbclog", text
        for wire in self.wires.values():
            wire.heard.clear()
        for cable in self.cables.values():
            cable.asked.clear()
        told = "".join(f"{line}\n" for line in typed)
        with patch("os.nice"):
            ended = CliRunner().invoke(app, words, obj=self.access, input=told)
        if ended.exception is not None and not isinstance(ended.exception, SystemExit):
            raise ended.exception
        lines = [
            *self._sent(),
            *(f"  {line}".rstrip() for line in ended.stdout.splitlines()),
            *(f"! {line}".rstrip() for line in ended.stderr.splitlines()),
            f"exit {ended.exit_code}",
        ]
        return without_varying(lines, self.folder)

    def _run_into_full(self, text: str) -> list[str]:
        """Call the program in a process of its own, whose output cannot be written."""
        with Path(FULL).open("w") as full:
            command = [sys.executable, "-m", *shlex.split(text)]
            ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
        noted = [f"! {line}" for line in ended.stderr.splitlines()]
        return without_varying([*noted, f"exit {ended.returncode}"], self.folder)

    def _sent(self) -> list[str]:
        lines = [f"> {text}" for text in self.conduct.sent()]
        heard = {name: self.wires[url].heard for name, url in self.names.items()}
        heard |= {url: [data for _, data in cable.asked] for url, cable in self.cables.items()}
        for name, questions in heard.items():
            writes = [text for text in map(text_of, questions) if text[0] in WRITES]
            if questions and not writes:
                lines.append(f"> {name}: only queries")
            lines += [f"> {name}: {text}" for text in writes]
        return lines
