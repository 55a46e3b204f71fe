"""`jbclog read`: one value by name, or all values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.names import ReadCommand, complete_signal
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.errors import StartRefused, UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.session.manual.contact import Contact, Target
    from jbclog.session.manual.read import ReadResult
    from jbclog.session.setting_write import Place

NAME_WIDTH = 40

COMMAND_CLASS = ReadCommand  # used by `app.py`


@reports_errors
def read(
    ctx: typer.Context,
    station: str = options.STATION_NAMED,
    signal: str | None = typer.Argument(
        None,
        metavar="SIGNAL",
        help="Value; without it, lists the names.",
        show_default=False,
        autocompletion=complete_signal,
    ),
    line: Path = options.LINE,
    port: int | None = options.PORT,
    tool: int | None = options.TOOL,
    condition: int | None = options.CONDITION,
    everything: bool = typer.Option(
        False, "--all", help="Read all values whose reading changes nothing."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Read one value of a station, or all.

    Reads every port without --port, and the connected tool without --tool. Without a name, lists
    the names with units, ranges and manual. Sends only queries. Refuses a station that a run holds,
    and names the run.

    \b
    Example:
      jbclog read dde-1 tip_temperature --port 2 --line virtual/line.toml
    """
    from jbclog.app.connection import target_in
    from jbclog.session.setting_write import Place

    target = target_in(line, station)
    asked = Place(port, tool, condition)
    access = options.port_access(ctx)
    if signal is None and not everything:
        _list(target, asked, access, as_json=as_json)
        return
    if signal is not None and everything:
        raise UsageError(f"give {signal!r} or --all, not both")
    seen = (
        _All(asked, access, as_json=as_json)
        if signal is None
        else _Named(signal, asked, access, as_json=as_json)
    )
    seen.ask(target)
    if seen.failed:
        raise typer.Exit(StartRefused.exit_code)


def _list(target: Target, asked: Place, access: PortAccess, *, as_json: bool) -> None:
    from jbclog.cli.values import print_names
    from jbclog.session.manual.names import readable

    if any(number is not None for number in asked):
        raise UsageError("--port, --tool and --condition require a name")
    print_names(target, readable, access, as_json=as_json)


class _Seen:
    """The readings so far: printed at once as lines, or collected for --json."""

    def __init__(self, asked: Place, access: PortAccess, *, as_json: bool) -> None:
        self.asked = asked
        self.access = access
        self.failed = 0
        self._as_json = as_json
        self._facts: list[dict[str, object]] = []
        self._contact: Contact | None = None

    def take(self, contact: Contact, reading: ReadResult) -> None:
        from jbclog.app.connection import utc_of
        from jbclog.cli.values import reading_facts

        if self._contact is None and not contact.is_proven:
            note(f"note: {contact.stranger()}; read by the tables of {contact.family.name}")
        self._contact = contact
        if self._as_json:
            self._facts.append(reading_facts(contact, reading, utc_of(reading.heard, self.access)))
        self.show(contact, reading)

    def show(self, contact: Contact, reading: ReadResult) -> None:
        """Print one line."""

    def ask(self, target: Target) -> None:
        """Read from the station and print the result."""


class _Named(_Seen):
    """One value, at one place or at several."""

    def __init__(self, name: str, asked: Place, access: PortAccess, *, as_json: bool) -> None:
        super().__init__(asked, access, as_json=as_json)
        self._name = name
        self._places: list[Place] = []

    def ask(self, target: Target) -> None:
        from jbclog.app.connection import ask
        from jbclog.session.manual.contact import check_place
        from jbclog.session.manual.names import find, readable
        from jbclog.session.manual.read import read_value

        command = find(self._name, target.family, readable)
        if target.family is not None:
            check_place(command, target.family, target.ports or target.family.ports, self.asked)
        ask(target, read_value(target, self._name, self.asked, self.take), self.access)
        if self._as_json:
            one = self._places and self._is_only_one(self._places[0])
            echo_json(self._facts[0] if one else {"station": target.name, "values": self._facts})
        if command.sent_once and not self.failed:
            note(f"note: reading {command.name} cleared it in the station")

    def _is_only_one(self, place: Place) -> bool:
        """Return whether the command line means one value, on any station."""
        return place.port is None or self.asked.port is not None

    def show(self, contact: Contact, reading: ReadResult) -> None:
        from jbclog.session.manual.contact import title
        from jbclog.session.manual.value_text import shown

        self._places.append(reading.place)
        if reading.is_void:
            if not self._as_json:
                text = f"not known: {reading.problem}"
                echo(text if self._is_only_one(reading.place) else f"{reading.place}: {text}")
        elif reading.value is None:
            self.failed += 1
            note(
                f"error: {contact.name}: {title(reading.command, reading.place)}: {reading.problem}"
            )
        elif not self._as_json:
            text = shown(reading.value, reading.command, contact.family)
            echo(text if self._is_only_one(reading.place) else f"{reading.place}: {text}")


def _absent_text(reading: ReadResult) -> str:
    """Return that the station does not have the value; an OMEGA shows this by silence."""
    return (
        "unknown to this station (N 00004)"
        if reading.reason == "nak4"
        else "unknown to this station (it does not answer it)"
    )


class _All(_Seen):
    """Everything that can be read without changing anything."""

    def ask(self, target: Target) -> None:
        from jbclog.app.connection import ask
        from jbclog.session.manual.names import why_only_by_name
        from jbclog.session.manual.read import only_by_name, read_all

        if any(number is not None for number in self.asked):
            raise UsageError(
                "--all reads every port and the connected tools: omit --port, --tool and"
                " --condition"
            )
        ask(target, read_all(target, self.take), self.access)
        if self._as_json:
            echo_json({"station": target.name, "values": self._facts})
        left_out = (
            [f"{one.name} ({why_only_by_name(one)})" for one in only_by_name(self._contact.family)]
            if self._contact
            else []
        )
        if left_out:
            note(f"note: read these by name: {', '.join(left_out)}")

    def show(self, contact: Contact, reading: ReadResult) -> None:
        from jbclog.session.manual.contact import title
        from jbclog.session.manual.value_text import shown

        if reading.value is not None:
            text = shown(reading.value, reading.command, contact.family)
        elif reading.is_void:
            text = f"not known: {reading.problem}"
        else:
            text = _absent_text(reading) if reading.is_absent else f"not read: {reading.problem}"
            self.failed += not reading.is_absent
        if not self._as_json:
            echo(f"{title(reading.command, reading.place):{NAME_WIDTH}}  {text}")
