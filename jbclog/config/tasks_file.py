"""The tasks file (TOML): maintenance tasks, the use after which each is due, and their stations.

::

    [[task]]
    name = "tip-change"           # what `jbclog maintenance done --task` takes
    title = "Change the tip"      # optional
    counter = "work_h"            # any counter; not with life_days
    life_h = 400                  # or life_cycles, life_m, life_days: as the counter counts
    warn_percent = 80             # optional
    families = ["dde", "ale"]     # optional; without it every station that has the counter
    stations = ["dde-1"]          # optional
    of = "port"                   # or "station": all its ports together

All mistakes are reported at once, with file, line, key and what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field

from jbclog.config.schema import NAME_ALLOWED, Families, FromList, Name, Table, read_file
from jbclog.config.task_names import STATED
from jbclog.core.errors import Problem, Problems
from jbclog.core.toml import KeyPath, TomlText, parse, read_text, shortened

DAYS: Final = "days"
COUNTERS: Final = {
    "life_h": ("plugged_h", "no_tool_h", "sleep_h", "hibernation_h", "work_h", "on_h"),
    "life_cycles": (
        "sleep_cycles",
        "desolder_cycles",
        "dispensed_cycles",
        "tool_cycles",
        "suction_cycles",
    ),
    "life_m": ("dispensed_mm",),
}
LIVES: Final = (*COUNTERS, "life_days")
ALL_COUNTERS: Final = tuple(name for names in COUNTERS.values() for name in names)

Counter = Literal[
    "plugged_h",
    "no_tool_h",
    "sleep_h",
    "hibernation_h",
    "work_h",
    "on_h",
    "sleep_cycles",
    "desolder_cycles",
    "dispensed_cycles",
    "tool_cycles",
    "suction_cycles",
    "dispensed_mm",
]
Life = Annotated[float | None, Field(ge=0.01, le=1e9)]
Texts = Annotated[tuple[str, ...] | None, FromList]


class TaskTable(Table):
    """A `[[task]]` of the file."""

    name: Name = Field(description=NAME_ALLOWED)
    title: str = Field(default="", max_length=80, description="at most 80 characters")
    counter: Counter | None = Field(default=None, description=f"one of {', '.join(ALL_COUNTERS)}")
    life_h: Life = Field(default=None, description="hours, 0.01 or more")
    life_cycles: Life = Field(default=None, description="cycles, 0.01 or more")
    life_m: Life = Field(default=None, description="metres, 0.01 or more")
    life_days: Life = Field(default=None, description="days, 0.01 or more")
    warn_percent: float = Field(default=80.0, gt=0, le=100, description="more than 0, at most 100")
    families: Families | None = Field(default=None, description="a list of families")
    stations: Texts = Field(default=None, description="a list of names of stations")
    of: Literal["port", "station"] = Field(default="port", description='"port" or "station"')


class TasksFile(Table):
    """The whole file."""

    task: Annotated[tuple[TaskTable, ...], FromList] = Field(description="at least one [[task]]")


@dataclass(frozen=True, slots=True)
class Task:
    """A task due after `life` of `counter` (in its unit; days for ``days``). `never`: the text
    shown if it was never recorded as done.
    """

    name: str
    title: str
    counter: str
    life: float
    warn_percent: float = 80.0
    families: tuple[str, ...] | None = None
    stations: tuple[str, ...] | None = None
    of_station: bool = False
    never: str = "last service date unknown"

    def is_of(self, station: str, family: str | None) -> bool:
        """Return True if the task applies to this station."""
        return (self.stations is None or station in self.stations) and (
            self.families is None or family in self.families
        )


def load_tasks(path: Path) -> tuple[Task, ...]:
    """Read a tasks file. Raises Problems with all its mistakes."""
    return parse_tasks(read_text(path), path)


def parse_tasks(text: str, path: Path = Path("tasks.toml")) -> tuple[Task, ...]:
    """Parse a tasks file; `path` appears in messages."""
    source = parse(text, str(path))
    file, problems, _ = read_file(TasksFile, source)
    problems += _between(source)
    if problems or file is None:
        raise Problems(shortened(problems))
    return tuple(map(_task, file.task))


def _task(table: TaskTable) -> Task:
    life = next(name for name in LIVES if getattr(table, name) is not None)
    return Task(
        name=table.name,
        title=table.title or table.name,
        counter=table.counter or DAYS,
        life=getattr(table, life) * (1000 if life == "life_m" else 1),
        warn_percent=table.warn_percent,
        families=table.families,
        stations=table.stations,
        of_station=table.of == "station",
    )


def _between(source: TomlText) -> Iterator[Problem]:
    """Yield conflicts between the keys of a task, and between tasks."""
    names: dict[object, int] = {}
    if source.tables.get("task") == []:
        yield source.problem(("task",), "there is none; at least one [[task]]")
    for place, table in source.rows("task"):
        yield from _of_one(source, ("task", place), table)
        yield from _named(source, ("task", place, "name"), table.get("name"), names)


def _of_one(source: TomlText, at: KeyPath, table: dict[str, object]) -> Iterator[Problem]:
    lives = [name for name in LIVES if name in table]
    counter = table.get("counter")
    if len(lives) != 1:
        given = f"{' and '.join(lives)} are given" if lives else "no service interval is given"
        yield source.problem(at, f"{given}; exactly one of {', '.join(LIVES)}")
    elif lives == ["life_days"] and counter is not None:
        yield source.problem(
            (*at, "counter"), "life_days are days of the calendar and take no counter"
        )
    elif lives != ["life_days"] and counter is None:
        yield source.problem(
            (*at, "counter"), f"missing; with {lives[0]} one of {', '.join(COUNTERS[lives[0]])}"
        )
    elif counter in ALL_COUNTERS and counter not in COUNTERS[lives[0]]:
        yield source.problem(
            (*at, "counter"),
            f"{counter} is not counted so; with {lives[0]} one of {', '.join(COUNTERS[lives[0]])}",
        )


def _named(
    source: TomlText, at: KeyPath, name: object, names: dict[object, int]
) -> Iterator[Problem]:
    if not isinstance(name, str):
        return
    if name in STATED:
        yield source.problem(
            at, f"{name} is reserved for an event of a station; give the task another name"
        )
    if name in names:
        yield source.problem(at, f"{name} is given twice, first in line {names[name]}")
    names.setdefault(name, source.lines.get(at, 0))
