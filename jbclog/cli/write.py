"""`jbclog write`: write one setting by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.names import WriteCommand, complete_setting, complete_station, complete_value
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.cli.streams import never_wait
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.session.manual.contact import Target
    from jbclog.session.manual.danger import Snapshot
    from jbclog.session.manual.write import WriteRequest

COMMAND_CLASS = WriteCommand  # used by `app.py`


@reports_errors
def write(
    ctx: typer.Context,
    station: str = options.STATION_NAMED,
    setting: str | None = typer.Argument(
        None,
        metavar="SETTING",
        help="Setting; without it, lists the names.",
        show_default=False,
        autocompletion=complete_setting,
    ),
    value: str | None = typer.Argument(
        None,
        metavar="VALUE",
        help="Number, word or off; none for an order.",
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
        help="Station name again; required for dangerous settings.",
        show_default=False,
        autocompletion=complete_station,
    ),
    snapshot: Path | None = typer.Option(
        None,
        "--snapshot",
        metavar="FILE",
        help="Backup before a dangerous write; default: STATION-settings-TIME.json.",
        show_default=False,
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Write one setting by name and read it back.

    Without a name, lists the settings and their values. A dangerous setting requires --yes-i-mean,
    and all settings are saved to a file first; restart and factory_reset require every tool at 60
    °C or below. Refuses a station that a run holds, and names the run. Exit code 3: refused or not
    confirmed; 5: an order to rest is not confirmed.

    \b
    Example:
      jbclog write dde-1 selected_temperature 350 --port 1 --line virtual/line.toml
    """
    from jbclog.app.connection import target_in
    from jbclog.cli.values import print_names
    from jbclog.session.manual.names import writable
    from jbclog.session.manual.write import WriteRequest
    from jbclog.session.setting_write import Place

    target = target_in(line, station)
    if yes_i_mean is not None and yes_i_mean != station:
        raise UsageError(
            f"--yes-i-mean {yes_i_mean}: must be {station}, the station to write; nothing sent"
        )
    access = options.port_access(ctx)
    if setting is None:
        print_names(target, writable, access, as_json=as_json)
        return
    if snapshot is not None and snapshot.exists():
        raise UsageError(f"--snapshot {snapshot}: exists; nothing sent")
    change = WriteRequest(setting, value, Place(port, tool))
    _check(target, change, line, is_meant=yes_i_mean is not None)
    never_wait()
    code = _Writing(target, change, line, snapshot, access, as_json=as_json).do()
    raise typer.Exit(code)


def _check(target: Target, change: WriteRequest, line: Path, *, is_meant: bool) -> None:
    """Raise `UsageError` for every error that can be found before a byte is sent."""
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
            f"{command.name} {what_it_does(command)}. Nothing sent. To confirm: "
            f"{call('write', target, change, line)} --yes-i-mean {target.name}"
        )


class _Writing:
    """One write: sends it, prints the result and returns its exit code."""

    def __init__(
        self,
        target: Target,
        change: WriteRequest,
        line: Path,
        snapshot: Path | None,
        access: PortAccess,
        *,
        as_json: bool,
    ) -> None:
        from jbclog.session.manual.write import WriteResult

        self._target = target
        self._change = change
        self._line = line
        self._snapshot = snapshot
        self._access = access
        self._as_json = as_json
        self._kept: Path | None = None
        self._written = WriteResult()

    def do(self) -> int:
        from jbclog.app.connection import ask
        from jbclog.protocol.client.omega import COMPLETION_S
        from jbclog.session.manual.write import write_value

        if self._change.name == "run_condition":
            note(
                f"note: waiting up to {COMPLETION_S:g} s: the controller answers when the joint is"
                " done"
            )
        steps = write_value(self._target, self._change, self._keep, self._written)
        try:
            ask(self._target, steps, self._access, may_write=True)
        except KeyboardInterrupt:
            if self._written.is_sent:
                note("interrupted after the write was sent, before it was read back:")
                self._print()
            raise
        return self._print()

    def _keep(self, snapshot: Snapshot) -> None:
        from jbclog.app.connection import keep_snapshot

        self._kept = keep_snapshot(snapshot, self._change.name, self._snapshot, self._access)
        conditions = [str(one.condition) for one in snapshot.settings if one.condition is not None]
        if conditions and len(conditions) == len(snapshot.settings):
            what = f"only solder condition {', '.join(conditions)} of {snapshot.station} saved"
        else:
            what = f"{len(snapshot.settings)} settings of {snapshot.station} saved"
        note(f"note: {what} in {self._kept}")

    def _print(self) -> int:
        from jbclog.cli.values import exit_code, notes, result, written_facts

        written = self._written
        if self._as_json:
            echo_json(written_facts(written, self._kept, self._access))
        elif written.is_fine:
            echo(result(written))
        if not written.is_fine:
            note(f"error: {self._target.name}: {result(written)}")
        for text in notes(written, self._target, self._change, self._line):
            note(f"note: {text}")
        return exit_code(written)
