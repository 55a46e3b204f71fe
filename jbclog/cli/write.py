"""`jbclog write`: one value by name, with what a write by hand owes its user."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.names import complete_setting, complete_station, complete_value
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.cli.streams import never_wait
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.session.manual.contact import Target
    from jbclog.session.manual.danger import Snapshot
    from jbclog.session.manual.write import WriteRequest


@ends_with_errors_told
def write(
    station: str = options.STATION_NAMED,
    setting: str | None = typer.Argument(
        None, metavar="SETTING", help="What to write, by name.", show_default=False, autocompletion=complete_setting
    ),
    value: str | None = typer.Argument(
        None,
        metavar="VALUE",
        help="A number, a word, or off; nothing for an order.",
        show_default=False,
        autocompletion=complete_value,
    ),
    line: Path = options.LINE,
    port: int | None = options.PORT,
    tool: int | None = options.TOOL,
    yes_i_mean: str | None = typer.Option(
        None,
        "--yes-i-mean",
        metavar="STATION",
        help="The station's name again, required for dangerous settings.",
        show_default=False,
        autocompletion=complete_station,
    ),
    snapshot: Path | None = typer.Option(
        None,
        "--snapshot",
        metavar="FILE",
        help="Where all settings are saved before a dangerous write. Default: STATION-settings-TIME.json in this folder.",
        show_default=False,
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Write one setting by its name and read it back.

    Without a name, lists the names and what each takes. What cannot be undone needs --yes-i-mean and first saves all settings in a
    file; restart and factory_reset need every tool at 60 °C or below. Refused while a run holds the station; the message names the
    run. Exit code 3: refused or not confirmed; 5: a tool that was ordered to rest is not known to rest.

    \b
    Example:
      jbclog write dde-1 selected_temperature 350 --port 1 --line virtual/line.toml
    """
    from jbclog.app.connection import target_in
    from jbclog.cli.values import tell_names
    from jbclog.session.manual.contact import Place
    from jbclog.session.manual.names import writable
    from jbclog.session.manual.write import WriteRequest

    target = target_in(line, station)
    if yes_i_mean is not None and yes_i_mean != station:
        raise UsageError(f"--yes-i-mean {yes_i_mean} is not {station}, the station that is to be written; nothing was sent")
    if setting is None:
        tell_names(target, writable, as_json=as_json)
        return
    if snapshot is not None and snapshot.exists():
        raise UsageError(f"--snapshot {snapshot} is there already, and nothing is written over; nothing was sent")
    change = WriteRequest(setting, value, Place(port, tool))
    _check(target, change, line, is_meant=yes_i_mean is not None)
    never_wait()
    code = _Writing(target, change, line, snapshot, as_json=as_json).do()
    raise typer.Exit(code)


def _check(target: Target, change: WriteRequest, line: Path, *, is_meant: bool) -> None:
    """Everything that can be known to be wrong before a byte is sent. Raises `UsageError`."""
    from jbclog.cli.values import call
    from jbclog.session.manual.contact import check_place
    from jbclog.session.manual.danger import is_dangerous, what_it_does
    from jbclog.session.manual.names import find, writable
    from jbclog.session.manual.write import expect_one_port

    command = find(change.name, target.family, writable)
    if target.family is not None:
        ports = target.ports or target.family.ports
        check_place(command, target.family, ports, change.place)
        change.meant(target.family)
        expect_one_port(command, change.place, ports)
    if is_dangerous(command.name, target.family) and not is_meant:
        raise UsageError(
            f"{command.name} {what_it_does(command)}. Nothing was sent. To do it all the same: "
            f"{call('write', target, change, line)} --yes-i-mean {target.name}"
        )


class _Writing:
    """One write: done, told, and given its exit code."""

    def __init__(self, target: Target, change: WriteRequest, line: Path, snapshot: Path | None, *, as_json: bool) -> None:
        from jbclog.session.manual.write import WriteResult

        self._target = target
        self._change = change
        self._line = line
        self._snapshot = snapshot
        self._as_json = as_json
        self._kept: Path | None = None
        self._written = WriteResult()

    def do(self) -> int:
        from jbclog.app.connection import ask
        from jbclog.protocol.client.omega import COMPLETION_S
        from jbclog.session.manual.write import write_value

        if self._change.name == "run_condition":
            note(f"note: the controller answers when the joint is done: this waits for that, up to {COMPLETION_S:g} s")
        steps = write_value(self._target, self._change, self._keep, self._written)
        try:
            ask(self._target, steps, may_write=True)
        except KeyboardInterrupt:
            if self._written.is_sent:
                note("interrupted after it was sent, before it was read back:")
                self._tell()
            raise
        return self._tell()

    def _keep(self, snapshot: Snapshot) -> None:
        from jbclog.app.connection import keep_snapshot

        self._kept = keep_snapshot(snapshot, self._change.name, self._snapshot)
        conditions = [str(one.condition) for one in snapshot.settings if one.condition is not None]
        if conditions and len(conditions) == len(snapshot.settings):
            what = f"solder condition {', '.join(conditions)} of {snapshot.station} as it is now, and nothing else of it, is kept"
        else:
            what = f"the settings of {snapshot.station} as they are now ({len(snapshot.settings)}) are kept"
        note(f"note: {what} in {self._kept}")

    def _tell(self) -> int:
        from jbclog.cli.values import exit_code, notes, result, written_facts

        written = self._written
        if self._as_json:
            tell_json(written_facts(written, self._kept))
        elif written.is_fine:
            tell(result(written))
        if not written.is_fine:
            note(f"error: {self._target.name}: {result(written)}")
        for text in notes(written, self._target, self._change, self._line):
            note(f"note: {text}")
        return exit_code(written)
