"""Time and severity on a terminal: local time with its zone, and colours. Files and pipes get UTC,
and no colour.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

from jbclog.cli.options import Color
from jbclog.cli.output import is_terminal, note, wrapped
from jbclog.core.rows import Severity
from jbclog.core.text import clean

if TYPE_CHECKING:
    from rich.console import Console, Group
    from rich.live import Live


ASKED_BY: Final = ("FORCE_COLOR", "TTY_COMPATIBLE")  # variables with which rich colours files, too
STYLES: Final = {Severity.WARNING: "yellow", Severity.ERROR: "red", Severity.CRITICAL: "bold red"}


def console(color: Color) -> Console:
    """Return the console of stderr."""
    from rich.console import Console

    plain = color is Color.NEVER or (color is Color.AUTO and bool(os.environ.get("NO_COLOR")))
    return Console(
        stderr=True,
        highlight=False,
        no_color=plain,
        force_terminal=True if color is Color.ALWAYS else None,
    )


def _may_color(color: Color) -> bool:
    """Whether rich could take stderr for a terminal."""
    asked = color is Color.ALWAYS or any(name in os.environ for name in ASKED_BY)
    return asked or is_terminal()


class Printer:
    """Prints lines on stderr, coloured by severity if possible, wrapped on a terminal."""

    def __init__(self, color: Color) -> None:
        self._color = color
        self._is_plain = not (_may_color(color) and self.console.is_terminal)

    @cached_property
    def console(self) -> Console:
        """The console of stderr; not imported for plain lines, because a run's first sample would
        wait.
        """
        return console(self._color)

    def print(self, text: str, severity: Severity = Severity.INFO) -> None:
        if self._is_plain:
            note(text)
        else:
            shown = wrapped(clean(text), self.console.width) if is_terminal() else clean(text)
            self.console.print(shown, style=STYLES.get(severity), markup=False, soft_wrap=True)


def started_live(console: Console) -> Live:
    """Return a started live display that leaves stdout alone, which is for data."""
    from rich.live import Live

    live = Live(
        console=console,
        auto_refresh=False,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    live.start()
    return live


class Column(NamedTuple):
    """A column of a live table. A narrow terminal drops columns in the order of `dropped`; those
    without it stay.
    """

    name: str
    is_number: bool = False
    dropped: int | None = None


def fitting_table(
    title: str,
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    width: int,
    notes: Sequence[str] = (),
) -> Group:
    """Return the title, the table with as many of its columns as fit into `width` cells, and the
    notes below it.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    shown, rows = fitting(columns, rows, width)
    table = Table(pad_edge=False)
    for column in shown:
        table.add_column(column.name, justify="right" if column.is_number else "left")
    for row in rows:
        table.add_row(*(Text(clean(cell)) for cell in row))
    return Group(Text(clean(title)), table, *(Text(clean(one), style="dim") for one in notes))


def fitting(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int, *, gap: int = 3
) -> tuple[Sequence[Column], Sequence[Sequence[str]]]:
    """Return the columns that fit into `width` cells, and the rows without the others. `gap`:
    blanks and lines of a column.
    """
    shown = _fitting(columns, rows, width, gap)
    places = [columns.index(column) for column in shown]
    return shown, [[row[place] for place in places] for row in rows]


def _fitting(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int, gap: int
) -> list[Column]:
    from rich.cells import cell_len

    needs = {
        one: gap + max(map(cell_len, (one.name, *(row[at] for row in rows))))
        for at, one in enumerate(columns)
    }
    # these are dropped before all others
    empty = {one for at, one in enumerate(columns) if not any(row[at] for row in rows)}
    first_out = sorted(
        (one for one in columns if one.dropped is not None),
        key=lambda one: (one not in empty, one.dropped or 0),
    )
    left = list(columns)
    while first_out and sum(needs[one] for one in left) > width:
        left.remove(first_out.pop(0))
    return left


def moment(utc_s: float) -> str:
    """Return a time of day: ``08:45:12 CET`` on a terminal, ``07:45:12Z`` elsewhere."""
    if not is_terminal():
        return time.strftime("%H:%M:%SZ", time.gmtime(utc_s))
    return time.strftime("%H:%M:%S %Z", time.localtime(utc_s))


def span(passed_s: float) -> str:
    """Return a duration: ``45 s``, ``12:30``, ``1:02:03``."""
    minutes, rest = divmod(round(passed_s), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02}:{rest:02}"
    return f"{minutes}:{rest:02}" if minutes else f"{rest} s"


def span_of(passed_s: float, duration_s: float | None) -> str:
    """Return how much of a duration has passed, and what is left: ``12 s of 20 s, 8 s left``. Never
    more than all of it.
    """
    if duration_s is None:
        return span(passed_s)
    left_s = duration_s - passed_s
    return (
        f"{span(min(passed_s, duration_s))} of {span(duration_s)},"
        f" {f'{span(left_s)} left' if left_s > 0.5 else 'ending'}"
    )
