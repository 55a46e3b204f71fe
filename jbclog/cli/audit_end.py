"""The end of an audit: its files, what is told, and the exit code."""

from __future__ import annotations

import signal
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from jbclog.app.audit.run_audit import STOPPED
from jbclog.cli.audit_table import lines
from jbclog.cli.output import note, tell, tell_json
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.maintenance.fleet import Finding, FleetAudit, exit_code
from jbclog.report.audit.csv_table import sheet_of
from jbclog.report.audit.json_object import plain_audit

if TYPE_CHECKING:
    from collections.abc import Callable

SIGNALLED = 128


@dataclass(slots=True)
class End:
    """`trouble`: what is wrong with the ledger, or with a file that was to be written. `stopped`: by which signal."""

    audit: FleetAudit
    trouble: list[str]
    fail_on: Collection[Finding]
    stopped: signal.Signals | None = None
    files: list[str] = field(default_factory=list)

    @property
    def code(self) -> int:
        """The most severe (docs/reference/exit-codes.md): 4, then 3, then a signal, then 1."""
        asked = tuple(one for one in self.audit.stations if one.why != STOPPED)
        found = exit_code(replace(self.audit, stations=asked), self.fail_on)
        if self.trouble:
            return RecordError.exit_code
        if self.stopped is not None and found < 3:
            return SIGNALLED + self.stopped
        return found

    def write(self, html: Path | None, csv: Path | None) -> None:
        """The files that were asked for: whole, or as they were before."""
        if csv is not None:
            self._write(csv, sheet_of)
        if html is not None:
            self._write(html, _page)

    def _write(self, path: Path, make: Callable[[FleetAudit], str]) -> None:
        try:
            write_whole(path, make(self.audit).encode())
            self.files.append(str(path))
        except OSError as error:
            self.trouble.append(f"{path} cannot be written: {error.strerror or error}")

    def tell(self, *, as_json: bool) -> None:
        """Everything on stdout, what people have to know besides on stderr."""
        if as_json:
            beside = {"trouble": self.trouble, "files": self.files, "exit_code": self.code}
            tell_json(plain_audit(self.audit) | beside)
        else:
            for line in lines(self.audit):
                tell(line)
        for text in self.trouble:
            note(f"error: {text}")
        for path in self.files:
            note(f"written: {path}")


def _page(audit: FleetAudit) -> str:
    from jbclog.report.audit.page import page_of

    return page_of(audit)
