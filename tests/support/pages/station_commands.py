"""docs/reference/station-commands.md: every command of every family, and the tables that its
numbers are looked up in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from jbclog.core.quantities import Choice, DigitWord, Number, Text, text_of
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.defaults import Default
from jbclog.protocol.commands.error_tables import COMMUNICATION_ERRORS, ErrorTable
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.protocol.commands.status import StatusTable
from jbclog.session.run.permit import WRITES
from support.pages.md_table import MADE, code, codes, table

INTRODUCTION = """
Every command of every family, with the manual and section that it rests on ([manuals](manuals.md)). A note
that says B-nn is about a row of [contradictions](contradictions.md). [Protocol](protocol.md) describes frames
and status words.

A code is what stands behind R, W or A: `x` is the port, `y` the number of the tool, `nnnn` that of a solder
condition. *Recorded as* names the columns of `samples` or the counter.

- *Sent*: *once* marks what is never repeated for one intent, because it acts; *dangerous* what `write` does
  only with `--yes-i-mean` and no recipe reaches. The exception is OMEGA's D: `run --allow-omega-write` sends
  it with a recipe's `[omega]`.
- *Printed* is what the manuals of these families print of the value, limits that the station itself reports
  included. What lies beyond is refused before anything is sent.
- *Inferred* is what they do not print and another manual, named beside it, does. What lies beyond that is
  sent all the same: `plan` notes it, and the station accepts it or refuses it with N 00003. A unit with
  *(inferred)* is not printed for these families either.

What does not fit into the five characters of a frame is always refused, and so is a temperature above the
station's own maximum (R-MAT, R-MAE), before the first write. An alarm limit must be 1 to 600 °C: no manual
prints how a station reports a limit that is not set, and a read-back value beyond that range cannot be told
from it.
"""

BY_002 = """
Manual 002 prints some commands without saying which of its stations have them. jbclog asks R-SVR of all of
them, R-DCx and R-DLx of those that dispense (`ucr`, `ale`), and takes the commands of the feeder for those of
`ale`, which is inferred. W-IFE is taken for all of them; R-FST and W-SAD are printed for UCR only. A station
that does not know a command refuses it with N 00004, and the command counts as not supported.
"""


RUN_WRITES = """
## What a run writes

This list is complete. Before each write, the client of a run compares command and value with it. What is not
on the list, or is neither the recipe's value nor a safe state, is not sent: it ends the run of that station
as an error of jbclog (exit code 3), and its tools are made safe. The guard and `jbclog safe` send the safe
states of `status` and `stop_feeding` only. What a person sends with `jbclog write` is that person's
responsibility.
"""


def page() -> str:
    """The whole page."""
    parts = [
        f"{MADE}\n\n# Station commands\n{INTRODUCTION}",
        _families(),
        *_commands(),
        BY_002,
        RUN_WRITES,
        _run_writes(),
        *_tables(),
    ]
    return "\n".join(part.strip() + "\n" for part in parts)


MENU = ("000", "001")
"""Manuals of stations whose line format is chosen in a menu: 1200 to 500000 baud, any parity, one
or two stop bits (2.1).
"""

# -- families --------------------------------------------------------------------------------------


def _families() -> str:
    head = (
        "family",
        "stations",
        "model names that prove it",
        "ports",
        "line",
        "safe states",
        "orders of a run",
        "manual",
    )
    rows = [
        (
            code(one.name),
            one.title,
            codes(one.models) or "it does not say what it is",
            ", ".join(map(str, one.ports)) if one.ports else "not printed: those that answer R-CTx",
            f"{one.baudrate} 8N1" + (" or as its menu says" if one.manual in MENU else ""),
            codes(one.safe_states) or "none",
            codes(one.run_statuses) or "–",
            one.manual,
        )
        for one in FAMILIES.values()
    ]
    notes = [f"{code(one.name)}: {one.note}" for one in FAMILIES.values() if one.note]
    return "\n\n".join(["## Families", table(head, rows), *notes])


def _run_writes() -> str:
    known = {
        name: command for family in FAMILIES.values() for name, command in family.commands.items()
    }
    rows = [
        (code(name), code(printed_code(known[name]).replace("R/W", "W")), when)
        for name, when in WRITES.items()
    ]
    return table(("name", "code", "when, and whose value"), rows)


def _those(names: Iterable[str]) -> str:
    """Families in few words."""
    found = tuple(names)
    groups = {
        tuple(FAMILIES): "all",
        tuple(
            name for name, one in FAMILIES.items() if "sleep_delay" in one.commands
        ): "all soldering",
        tuple(name for name, one in FAMILIES.items() if "002" in one.manual): "all of 002",
    }
    return groups.get(found) or codes(found)


# -- commands --------------------------------------------------------------------------------------

COUNTED = {counter.command for family in FAMILIES.values() for counter in family.counters}
GROUPS: Mapping[str, Callable[[Command], bool]] = {
    "Readings": lambda one: one.access == "r" and one.name not in COUNTED,
    "Settings": lambda one: one.access == "rw",
    "Counters": lambda one: one.name in COUNTED,
    "Orders": lambda one: one.access == "w",
}


def _commands() -> Iterable[str]:
    head = (
        "name",
        "code",
        "families",
        "unit",
        "printed",
        "inferred",
        "recorded as",
        "sent",
        "manual",
        "note",
    )
    holders = _holders()
    for title, belongs in GROUPS.items():
        rows = [_row(one, names) for one, names in holders.items() if belongs(one)]
        yield f"## {title}\n\n{table(head, rows)}"


def _holders() -> dict[Command, list[str]]:
    """Each command with the families that have it."""
    found: dict[Command, list[str]] = {}
    for family in FAMILIES.values():
        for command in family.commands.values():
            found.setdefault(command, []).append(family.name)
    return found


def _row(one: Command, names: list[str]) -> tuple[str, ...]:
    sent = ["dangerous"] if one.dangerous else []
    sent += ["once"] if one.sent_once else []
    recorded = codes(
        dict.fromkeys(column for name in names for column in recorded_as(FAMILIES[name], one))
    )
    return (
        code(one.name),
        code(printed_code(one)),
        _those(names),
        (one.unit or "–") + (" *(inferred)*" if one.inferred and one.inferred.unit else ""),
        range_text(one),
        inferred_text(one),
        recorded,
        ", ".join(sent),
        one.manual,
        one.note,
    )


def printed_code(one: Command) -> str:
    """``R/W-STx``, as the manuals print it."""
    place = {Scope.STATION: "", Scope.PORT: "x", Scope.TOOL: "xy", Scope.CONDITION: "nnnn"}[
        one.scope
    ]
    header = "" if one.manual.startswith("003") else "/".join(one.access.upper()) + "-"
    return f"{header}{one.letters}{place}"


def recorded_as(family: Family, one: Command) -> list[str]:
    """Where what it tells stands in a run's tables."""
    columns = [
        column
        for signal in family.signals
        if signal.command == one.name
        for column in signal.columns
    ]
    return columns + [counter.name for counter in family.counters if counter.command == one.name]


def range_text(one: Command) -> str:
    """What its value may be, as far as a manual prints it."""
    names = getattr(one.quantity, "names", None)
    if names:
        return ", ".join(f"{number} {name}" for number, name in enumerate(names))
    if one.within:
        step, (lowest, highest) = (
            (f", step {one.limits.step:g}" if one.limits.step else ""),
            one.within,
        )
        return f"{f'{code(lowest)} to' if lowest else 'up to'} {code(highest)}{step}"
    if isinstance(one.quantity, DigitWord):
        return "digits up to " + "".join(map(str, one.quantity.highest))
    if one.limits.low is not None or one.limits.step is not None:
        return (
            str(one.limits).replace("range not printed step", "range not printed, step")
            if one.limits.high != 0
            else "00000"
        )
    if isinstance(one.quantity, Number | Text):
        return "letters" if isinstance(one.quantity, Text) else "a number of its table"
    if one.limits.printed:
        return "as its record has it"
    return "not printed" + (", or off" if one.limits.off else "")


def inferred_text(one: Command) -> str:
    """What of its value is another manual's, and whose; nothing where nothing is."""
    if one.inferred is None:
        return ""
    return (
        f"{str(one.inferred.limits).replace('range not printed step', 'step').removesuffix(' or off')}:"
        f" {one.inferred.source}"
    )


# -- tables ----------------------------------------------------------------------------------------


def _tables() -> Iterable[str]:
    yield f"## Status words\n\n{_status()}"
    yield f"## Tools\n\n{_numbered(lambda family: family.tools)}"
    yield f"## Port errors\n\n{_errors(lambda family: family.port_errors)}"
    yield f"## Station errors\n\n{_errors(lambda family: family.station_errors)}"
    rows = [(f"{number:05d}", text) for number, text in COMMUNICATION_ERRORS.items()]
    yield (
        "## Communication errors\n\nWhat an N frame carries, for all of"
        f" JBC.\n\n{table(('number', 'meaning'), rows)}"
    )
    yield f"## Factory settings\n\n{FACTORY}\n\n{_defaults()}"


def _numbered(of: Callable[[Family], Mapping[int, str]]) -> str:
    """A column for each set of families with the same numbers."""
    columns = _same(lambda family: tuple(of(family).items()))
    numbers = sorted({number for numbered in columns for number, _ in numbered})
    rows = [
        (str(number), *(dict(numbered).get(number, "–") for numbered in columns))
        for number in numbers
    ]
    return table(("number", *map(_those, columns.values())), rows)


def _errors(of: Callable[[Family], ErrorTable]) -> str:
    columns = _numbered(lambda family: _classed(of(family)))
    return f"{columns}\n\n*(state)* is no fault, *(warning)* is recorded as one."


def _classed(errors: ErrorTable) -> dict[int, str]:
    """Each number's text with what jbclog takes it for."""
    kinds = {
        **dict.fromkeys(errors.states, " *(state)*"),
        **dict.fromkeys(errors.warnings, " *(warning)*"),
    }
    return {number: text + kinds.get(number, "") for number, text in errors.texts.items()}


def _same(
    of: Callable[[Family], tuple[tuple[int, str], ...]],
) -> dict[tuple[tuple[int, str], ...], list[str]]:
    """The families by what they have; those that have nothing are left out."""
    found: dict[tuple[tuple[int, str], ...], list[str]] = {}
    for family in FAMILIES.values():
        if of(family):
            found.setdefault(of(family), []).append(family.name)
    return found


OTHER_DIGITS = (
    "The hundreds digit is desoldering, on hot air suction; the thousands digit is the feeder's"
    " motor on `ale`, 1 forward and 2 backward. Nobody orders them, but for suction: on hot air a"
    " status order carries its digit, too (`air.suction`, `run.safe_suction`, `jbclog write ..."
    " status cooling+suction`)."
)


def _status() -> str:
    tables: list[tuple[StatusTable, list[str]]] = []
    for family in FAMILIES.values():
        known = next((names for one, names in tables if one is family.status), None)
        if known is None and family.status.names:
            tables.append((family.status, [family.name]))
        elif known is not None:
            known.append(family.name)
    rows = [row for one, names in tables for row in _status_rows(one, _those(names))]
    return (
        table(("families", "word", "state", "what it is", "ordered by"), rows)
        + f"\n\n{OTHER_DIGITS}"
    )


def _status_rows(one: StatusTable, families: str) -> Iterable[tuple[str, ...]]:
    orders = {word: name for name, word in one.orders.items()}
    for digit, name in enumerate(one.names):
        kind = "at work" if digit in one.heating else "at rest"
        yield families, f"....{digit}", name, kind, code(orders.get((0, 0, 0, 0, digit), ""))
    rests = "at rest, whatever the units say" if one.tens_rests else "pump on, heater off"
    yield families, "...1.", one.tens, rests, code(orders.get((0, 0, 0, 1, 0), ""))


FACTORY = (
    "What a virtual station begins with and a factory reset brings back. jbclog assumes none of it"
    " of a real station: it reads what is there. Where nothing is printed the value is the virtual"
    " station's own choice; the manuals 000, 001 and 003 print no factory settings at all, and a"
    " virtual station of 000 begins like those of 002."
)


def _defaults() -> str:
    holders: dict[Default, list[str]] = {}
    for family in FAMILIES.values():
        for one in family.defaults if "002" in family.manual else ():
            holders.setdefault(one, []).append(family.name)
    rows = [
        (
            code(one.command),
            _those(names) + (f" ({one.model})" if one.model else ""),
            _value(FAMILIES[names[0]].commands[one.command], one),
            one.printed or "not printed",
            one.manual,
            one.note,
        )
        for one, names in holders.items()
    ]
    return table(("setting", "families", "value", "printed", "manual", "note"), rows)


def _value(command: Command, one: Default) -> str:
    return (
        command.shown(one.value)
        if not isinstance(command.quantity, Choice | DigitWord)
        else text_of(one.value)
    )
