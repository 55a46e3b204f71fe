"""Values read or written by hand, as text and JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Final

from jbclog.app.connection import ask, utc_of
from jbclog.app.port_access import PortAccess
from jbclog.cli.output import echo_json, echo_table, note
from jbclog.core.errors import StartRefused, Unsafe
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.ranges import inferred_note
from jbclog.session.manual.contact import (
    Contact,
    Target,
    open_contact,
    title,
)
from jbclog.session.manual.names import CommandFilter, entries, is_order
from jbclog.session.manual.read import ReadResult
from jbclog.session.manual.value_text import shown
from jbclog.session.manual.write import WriteOutcome, WriteRequest, WriteResult, is_order_to_rest
from jbclog.session.setting_write import Place

HEADS: Final = ("name", "uom", "scope", "values", "manual")


def plain(value: Value | None, command: Command, family: Family) -> object:
    """Return the value as JSON data: a number in the command's unit, or text."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if value is OFF or isinstance(value, tuple):
        return shown(value, command, family)
    return value


def reading_facts(contact: Contact, reading: ReadResult, time: str) -> dict[str, object]:
    """Return a reading as JSON data; a `value` of null has a `reason`."""
    command, place, value = reading.command, reading.place, reading.value
    facts: dict[str, object] = {
        "station": contact.name,
        "command": command.name,
        **place_facts(place),
    }
    facts |= {
        "value": plain(value, command, contact.family),
        "uom": command.unit,
        "text": None if value is None else shown(value, command, contact.family),
        "raw": reading.data,
        "manual": command.manual,
        "time": time,
    }
    return (
        facts
        if value is not None
        else facts | {"reason": reading.reason, "problem": reading.problem}
    )


def place_facts(place: Place) -> dict[str, object]:
    facts: dict[str, object] = {"port": place.port, "tool": place.tool}
    return facts if place.condition is None else facts | {"condition": place.condition}


def list_rows(family: Family, kind: CommandFilter) -> list[tuple[str, ...]]:
    """Return the names of a family as rows of `HEADS`."""
    return [
        (
            entry.name,
            entry.uom or "-",
            entry.scope,
            "; ".join(filter(None, (entry.values, entry.remark))) or "-",
            entry.manual,
        )
        for entry in entries(family, kind)
    ]


def list_facts(name: str, family: Family, kind: CommandFilter) -> dict[str, object]:
    """Return the names of a family as JSON data."""
    return {
        "station": name,
        "family": family.name,
        "names": [entry._asdict() for entry in entries(family, kind)],
    }


# -- names -----------------------------------------------------------------------------------------


def print_names(target: Target, kind: CommandFilter, access: PortAccess, *, as_json: bool) -> None:
    """Print every name of `kind` that the station has; identifies one of family "auto" first."""
    family = target.family or ask(target, open_contact(target), access).family
    if as_json:
        echo_json(list_facts(target.name, family, kind))
        return
    note(_heading(target, family))
    echo_table(HEADS, list_rows(family, kind))


def _heading(target: Target, family: Family) -> str:
    ports = target.ports or family.ports
    known = (
        "all ports that answer"
        if ports is None
        else f"port{'s' if len(ports) > 1 else ''} {', '.join(map(str, ports))}"
    )
    return f"{target.name}: {family.title}, {known}"


# -- result of a write -----------------------------------------------------------------------------

FINE: Final = 0


def call(verb: str, target: Target, change: WriteRequest, line: Path) -> str:
    """Return the command line for a change at the same station and place."""
    words = [
        "jbclog",
        verb,
        target.name,
        change.name,
        *([change.text] if change.text is not None else []),
    ]
    for name in ("port", "tool"):
        number = getattr(change.place, name)
        words += [f"--{name}", str(number)] if number is not None else []
    return shlex.join([*words, "--line", str(line)])


def exit_code(written: WriteResult) -> int:
    """Return 5 for an order to rest or stop a motor that is not confirmed, else 3 if the write is
    not.
    """
    if written.is_fine:
        return FINE
    contact = _contact(written)
    return (
        Unsafe.exit_code
        if written.is_sent and is_order_to_rest(contact, written)
        else StartRefused.exit_code
    )


def _contact(written: WriteResult) -> Contact:
    assert written.contact is not None  # created before anything is sent
    return written.contact


def _command(written: WriteResult) -> Command:
    assert written.command is not None
    return written.command


def result(written: WriteResult) -> str:
    """Return the result of a write in one sentence."""
    command, outcome = _command(written), written.outcome
    name = title(command, written.place)
    if outcome == WriteOutcome.UNCHANGED:
        return f"{name}: already {_text(written, written.value)}; nothing sent"
    if outcome == WriteOutcome.CONFIRMED:
        return (
            f"{name}: {_done(written)},"
            f" {'read back' if _is_to_cool(written) else 'confirmed'}{_before(written)}"
        )
    if outcome in (WriteOutcome.MISMATCH, WriteOutcome.REFUSED, WriteOutcome.UNCONFIRMED):
        requested = "" if is_order(command) else f"requested {_text(written, written.value)}, "
        sent = "sent, not confirmed: " if outcome == WriteOutcome.UNCONFIRMED else ""
        return f"{name}: {requested}{sent}{written.problem or 'no answer'}{_before(written)}"
    if written.seconds is not None:
        return f"{name}: sent; the station answered again after {written.seconds:.1f} s"
    sent = "sent" if is_order(command) else f"{_text(written, written.value)} sent"
    return f"{name}: {sent} and acknowledged; {written.problem or _left_open(written)}"


def _is_to_cool(written: WriteResult) -> bool:
    """Return whether a tool was set to extractor: the status is the order, not a proof of
    cooling.
    """
    contact, word = _contact(written), written.readback
    is_status = _command(written) is contact.family.command_of("status")
    return (
        is_status and contact.family.status.tens_rests and isinstance(word, tuple) and bool(word[3])
    )


def _done(written: WriteResult) -> str:
    """Return the value now. After an order to rest, the tool may be asleep when read back."""
    if written.readback is None:
        return "done" if is_order(_command(written)) else _text(written, written.value)
    return _text(written, written.readback)


def _left_open(written: WriteResult) -> str:
    return (
        f"feeding is {written.readback}"
        if written.readback is not None
        else "it cannot be read back"
    )


def _text(written: WriteResult, value: Value | None) -> str:
    if value is None:
        return "unknown"
    return shown(value, _command(written), _contact(written).family)


def _before(written: WriteResult) -> str:
    return "" if written.before is None else f" ({_text(written, written.before)} before)"


def notes(written: WriteResult, target: Target, change: WriteRequest, line: Path) -> Iterator[str]:
    """Yield what the user has to know or do next."""
    command = _command(written)
    contact = _contact(written)
    if (
        written.value is not None
        and (text := inferred_note(command, written.value, contact.family.manual)) is not None
    ):
        yield f"{command.name}: {text}"
    if written.at_work:
        yield _unattended(written, target, line)
    if (
        written.outcome == WriteOutcome.CONFIRMED
        and command.name == "status"
        and written.readback != written.value
    ):
        yield _changed_state(written)
    if written.outcome == WriteOutcome.CONFIRMED and _is_to_cool(written):
        yield _cooling_not_seen(written, target, line)
    if written.outcome == WriteOutcome.UNCONFIRMED and command.readable:
        asked = WriteRequest(command.name, None, change.place)
        yield f"it may have taken effect; check with: {call('read', target, asked, line)}"
    if command.name == "address" and written.outcome == WriteOutcome.CONFIRMED:
        wanted = f"address = {written.value or 'false'}"
        yield f"set `{wanted}` for {target.name} in {line}: the station now answers at that address"
    if command.name == "restart" and written.is_fine:
        yield "volatile settings are lost; check the selected temperatures with `jbclog read`"
    if command.name == "factory_reset" and written.is_fine:
        yield (
            "the previous settings are in the file named above; they are not restored automatically"
        )


def _unattended(written: WriteResult, target: Target, line: Path) -> str:
    """Warn that a tool or feeder keeps working: a station has no watchdog."""
    contact, place, surely = (
        _contact(written),
        written.place,
        "" if written.is_fine else " or may be",
    )
    if place.port is None:
        stop = call("write", target, WriteRequest("stop_feeding", None, place), line)
        return f"the feeder is{surely} running unattended. To stop it: {stop}"
    rest = WriteRequest("status", contact.family.safe_states[0], place)
    if written.is_empty:
        return (
            f"no tool in port {place.port}: a tool that is inserted heats at once, unattended. "
            f"To let it rest: {call('write', target, rest, line)}"
        )
    return (
        f"the tool in port {place.port} is{surely} at work unattended and stays hot. "
        f"To let it rest: {call('write', target, rest, line)}"
    )


def _cooling_not_seen(written: WriteResult, target: Target, line: Path) -> str:
    """Warn that the tool may still heat: a station without an extractor may accept and report the
    order all the same.
    """
    contact, place = _contact(written), written.place
    stand = call("write", target, WriteRequest("status", "stand", place), line)
    shows = contact.family.command_of("temperature_c")
    look = (
        ""
        if shows is None
        else f"Check with `{call('read', target, WriteRequest(shows.name, None, place), line)}`. "
    )
    return (
        f"the station shows the order, but may keep heating the tool in port {place.port}. {look}If"
        f" it does not cool: {stand}"
    )


def _changed_state(written: WriteResult) -> str:
    """Explain why a state other than the ordered one was read back and is correct."""
    asked, found = _text(written, written.value), _text(written, written.readback)
    has_cooled = (
        not _contact(written).family.status.tens_rests
        and "cooling" in asked
        and "cooling" not in found
    )
    why = "the tool has already cooled down" if has_cooled else "the station changed it by itself"
    return f"ordered {asked}, read back {found}: {why}"


def written_facts(written: WriteResult, kept: Path | None, access: PortAccess) -> dict[str, object]:
    """Return a write as JSON data."""
    contact, command = _contact(written), _command(written)

    def as_json(value: Value | None) -> object:
        return plain(value, command, contact.family)

    return {
        "station": contact.name,
        "command": command.name,
        **place_facts(written.place),
        "requested": as_json(written.value),
        "before": as_json(written.before),
        "readback": as_json(written.readback),
        "uom": command.unit,
        "outcome": written.outcome,
        "problem": written.problem,
        "manual": command.manual,
        "time": utc_of(contact.client.now, access),
        "snapshot": None if kept is None else str(kept),
        "exit_code": exit_code(written),
    }
