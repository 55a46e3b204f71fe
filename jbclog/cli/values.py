"""Values that were read or written by hand, as lines for people and as JSON."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Final

from jbclog.app.connection import ask, utc_of
from jbclog.cli.output import note, tell, tell_json
from jbclog.core.errors import StartRefused, Unsafe
from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.ranges import inferred_note
from jbclog.session.manual.contact import Contact, Place, Target, open_contact, title
from jbclog.session.manual.names import CommandFilter, NameEntry, entries, is_order
from jbclog.session.manual.read import ReadResult
from jbclog.session.manual.values import shown
from jbclog.session.manual.write import WriteOutcome, WriteRequest, WriteResult, is_order_to_rest

# -- values -------------------------------------------------------------------------------------------------------------------


def plain(value: Value | None, command: Command, family: Family) -> object:
    """The value as JSON has it: a number in the command's unit, or words."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if value is OFF or isinstance(value, tuple):
        return shown(value, command, family)
    return value


def reading_facts(contact: Contact, reading: ReadResult, time: str) -> dict[str, object]:
    """One reading as JSON; `value` is null where it was not read, and `reason` says why."""
    command, place, value = reading.command, reading.place, reading.value
    facts: dict[str, object] = {"station": contact.name, "command": command.name, **place_facts(place)}
    facts |= {
        "value": plain(value, command, contact.family),
        "unit": command.unit,
        "text": None if value is None else shown(value, command, contact.family),
        "raw": reading.data,
        "manual": command.manual,
        "time": time,
    }
    return facts if value is not None else facts | {"reason": reading.reason, "problem": reading.problem}


def place_facts(place: Place) -> dict[str, object]:
    facts: dict[str, object] = {"port": place.port, "tool": place.tool}
    return facts if place.condition is None else facts | {"condition": place.condition}


def table(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Columns one under the other, two blanks between them."""
    lines = list(rows)
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]


def list_lines(family: Family, kind: CommandFilter) -> list[str]:
    """The names of a family with unit, what may be written, where they belong, and the manual."""
    return table(
        (entry.name, entry.unit or "-", entry.scope, "; ".join(filter(None, (entry.values, entry.remark))) or "-", entry.manual)
        for entry in entries(family, kind)
    )


def list_facts(name: str, family: Family, kind: CommandFilter) -> dict[str, object]:
    """The same as JSON."""
    return {"station": name, "family": family.name, "names": [_entry_facts(entry) for entry in entries(family, kind)]}


def _entry_facts(entry: NameEntry) -> dict[str, object]:
    return dict(entry._asdict())


# -- listing ------------------------------------------------------------------------------------------------------------------
# The names of one station, listed: what `read` and `write` say when no name is given.


def tell_names(target: Target, kind: CommandFilter, *, as_json: bool) -> None:
    """Tell every name that `kind` lets through; a station whose family is "auto" is asked for it."""
    family = target.family or ask(target, open_contact(target)).family
    if as_json:
        tell_json(list_facts(target.name, family, kind))
        return
    note(_heading(target, family))
    for line in list_lines(family, kind):
        tell(line)


def _heading(target: Target, family: Family) -> str:
    ports = target.ports or family.ports
    known = "the ports that answer" if ports is None else f"port{'s' if len(ports) > 1 else ''} {', '.join(map(str, ports))}"
    return f"{target.name}: {family.title}, {known}. Name, unit, what it belongs to, what may be written, manual:"


# -- write wording ------------------------------------------------------------------------------------------------------------
# What came of a write by hand: as a sentence, as notes on what is left to do, as JSON, as an exit code.

FINE: Final = 0


def call(verb: str, target: Target, change: WriteRequest, line: Path) -> str:
    """A call of this program for the same station and place, as it can be typed."""
    words = ["jbclog", verb, target.name, change.name, *([change.text] if change.text is not None else [])]
    for name in ("port", "tool"):
        number = getattr(change.place, name)
        words += [f"--{name}", str(number)] if number is not None else []
    return shlex.join([*words, "--line", str(line)])


def exit_code(written: WriteResult) -> int:
    """5 where a tool was told to rest, or a motor to stop, and does not confirm it; else 3 where it did not come to be."""
    if written.is_fine:
        return FINE
    contact = _contact(written)
    return Unsafe.exit_code if written.is_sent and is_order_to_rest(contact, written) else StartRefused.exit_code


def _contact(written: WriteResult) -> Contact:
    assert written.contact is not None  # it is made before anything is sent
    return written.contact


def _command(written: WriteResult) -> Command:
    assert written.command is not None
    return written.command


def result(written: WriteResult) -> str:
    """One sentence: what was asked, and what came of it."""
    command, outcome = _command(written), written.outcome
    name = title(command, written.place)
    if outcome == WriteOutcome.UNCHANGED:
        return f"{name}: is {_text(written, written.value)} already; nothing was sent"
    if outcome == WriteOutcome.CONFIRMED:
        return f"{name}: {_done(written)}, {'read back' if _is_to_cool(written) else 'confirmed'}{_before(written)}"
    if outcome in (WriteOutcome.MISMATCH, WriteOutcome.REFUSED, WriteOutcome.UNCONFIRMED):
        asked = "" if is_order(command) else f"{_text(written, written.value)} was asked, "
        sent = "it was sent and is not confirmed: " if outcome == WriteOutcome.UNCONFIRMED else ""
        return f"{name}: {asked}{sent}{written.problem or 'nothing came back'}{_before(written)}"
    if written.seconds is not None:
        return f"{name}: sent; the station answers again after {written.seconds:.1f} s"
    told = "sent" if is_order(command) else f"{_text(written, written.value)} was sent"
    return f"{name}: {told} and acknowledged; {written.problem or _left_open(written)}"


def _is_to_cool(written: WriteResult) -> bool:
    """Whether a soldering tool was put in its extractor: the status says so at once, and not that the tool cools."""
    contact, word = _contact(written), written.readback
    is_status = _command(written) is contact.family.command_of("status")
    return is_status and contact.family.status.tens_rests and isinstance(word, tuple) and bool(word[3])


def _done(written: WriteResult) -> str:
    """What is so now. An order to rest may have led on to sleep by the time it is read back."""
    if written.readback is None:
        return "done" if is_order(_command(written)) else _text(written, written.value)
    return _text(written, written.readback)


def _left_open(written: WriteResult) -> str:
    return f"feeding is {written.readback}" if written.readback is not None else "there is nothing by which it could be read back"


def _text(written: WriteResult, value: Value | None) -> str:
    if value is None:
        return "unknown"
    return shown(value, _command(written), _contact(written).family)


def _before(written: WriteResult) -> str:
    return "" if written.before is None else f" ({_text(written, written.before)} before)"


def notes(written: WriteResult, target: Target, change: WriteRequest, line: Path) -> Iterator[str]:
    """What the person who did it has to know or to do now."""
    command = _command(written)
    contact = _contact(written)
    if written.value is not None and (text := inferred_note(command, written.value, contact.family.manual)) is not None:
        yield f"{command.name}: {text}"
    if written.at_work:
        yield _nobody_watches(written, target, line)
    if written.outcome == WriteOutcome.CONFIRMED and command.name == "status" and written.readback != written.value:
        yield _went_on(written)
    if written.outcome == WriteOutcome.CONFIRMED and _is_to_cool(written):
        yield _cooling_not_seen(written, target, line)
    if written.outcome == WriteOutcome.UNCONFIRMED and command.readable:
        asked = WriteRequest(command.name, None, change.place)
        yield f"it may or may not have been done; `{call('read', target, asked, line)}` tells"
    if command.name == "address" and written.outcome == WriteOutcome.CONFIRMED:
        wanted = f"address = {written.value or 'false'}"
        yield f"write `{wanted}` for {target.name} in {line}: that is where it answers from now on"
    if command.name == "restart" and written.is_fine:
        yield "what the station keeps only while it is on is lost; `jbclog read` shows the selected temperatures that it has now"
    if command.name == "factory_reset" and written.is_fine:
        yield "the settings before are in the file named above; nothing puts them back by itself"


def _nobody_watches(written: WriteResult, target: Target, line: Path) -> str:
    """A station has no watchdog: what was put to work by hand goes on until somebody ends it."""
    contact, place, surely = _contact(written), written.place, "" if written.is_fine else " or may be"
    if place.port is None:
        stop = call("write", target, WriteRequest("stop_feeding", None, place), line)
        return f"the feeder is{surely} running, and nobody watches it. To stop it: {stop}"
    rest = WriteRequest("status", contact.family.safe_states[0], place)
    if written.is_empty:
        return (
            f"there is no tool in port {place.port}: one that is put in goes to work at once, and nobody watches it. "
            f"To have it rest: {call('write', target, rest, line)}"
        )
    return (
        f"the tool in port {place.port} is{surely} at work, and nobody watches it: it stays hot until it is told otherwise. "
        f"To let it rest: {call('write', target, rest, line)}"
    )


def _cooling_not_seen(written: WriteResult, target: Target, line: Path) -> str:
    """A station without an extractor may take the order, show it, and heat on."""
    contact, place = _contact(written), written.place
    stand = call("write", target, WriteRequest("status", "stand", place), line)
    temperature = contact.family.command_of("temperature_c")
    look = (
        ""
        if temperature is None
        else f"`{call('read', target, WriteRequest(temperature.name, None, place), line)}` shows whether it does. "
    )
    return (
        f"the station shows the order; that the tool in port {place.port} cools was not seen yet, and a station may take the "
        f"order and heat on. {look}If it does not cool: {stand}"
    )


def _went_on(written: WriteResult) -> str:
    """Why another state was read back than was ordered, and is right all the same."""
    asked, found = _text(written, written.value), _text(written, written.readback)
    has_cooled = not _contact(written).family.status.tens_rests and "cooling" in asked and "cooling" not in found
    why = "the tool has cooled down already" if has_cooled else "the station goes on from it by itself"
    return f"{asked} was ordered and {found} was read back: {why}"


def written_facts(written: WriteResult, kept: Path | None) -> dict[str, object]:
    """The write as JSON."""
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
        "unit": command.unit,
        "outcome": written.outcome,
        "problem": written.problem,
        "manual": command.manual,
        "time": utc_of(contact.client.now),
        "snapshot": None if kept is None else str(kept),
        "exit_code": exit_code(written),
    }
