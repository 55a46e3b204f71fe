"""The walks of docs/explanation/architecture.md: the files that a setting, a temperature and an
alarm pass through, each with a function to read.

A run of a virtual station in virtual time is traced. A walk is the way of the value from call to
call, as an argument or a result, through the fewest files; tables, types and errors do not count.

``python tests/support walk`` writes the lists of the page anew. In a file that the page lists
already, the function stays if it still handles the value; in a new one it is the first on the way.
If a file of `WALKS` moves, its name is changed there first.
"""

from __future__ import annotations

import dis
import heapq
import inspect
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from types import CodeType, FrameType
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import BaseModel

from support.product import open_run
from support.virtual.recorded_run import RecordedRun, plan_in
from support.virtual.virtual_run import RECIPE, line_text

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "jbclog"
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
MAKE = "python tests/support walk"
MOST_TEXT = 5_000
MOST_ITEMS = 500

SETTING_C = 345
ALARM_C = 380  # of the recipe
BEYOND_C = 21
SEEN_C = ALARM_C + BEYOND_C
LINE = line_text(
    f"""joints_per_minute = 0
[[station.sim.fault]]
kind = "overheat"
at_s = 12
for_s = 6
by_c = {BEYOND_C}""",
    "ports = [1]",
)
WALKED_RECIPE = RECIPE.replace("select_c = 350", f"select_c = {SETTING_C}")
RUN_S = 30.0


class Handling(NamedTuple):
    """A function that handled the value; `file` is below the package."""

    file: str
    function: str


@dataclass(frozen=True)
class Value:
    """One value in its forms on the way. `wire` is what its frames contain."""

    wire: bytes
    is_plain: Callable[[object], bool]

    def is_in(self, thing: object, depth: int = 5) -> bool:
        """Whether `thing` is the value, or a small container of it."""
        if isinstance(thing, (bytes, bytearray, memoryview)):
            return self.wire in bytes(thing[:MOST_TEXT])
        if self.is_plain(thing):
            return True
        return depth > 0 and any(self.is_in(item, depth - 1) for item in items_of(thing))


def items_of(thing: object) -> Iterator[object]:
    """The items of a container, the fields of a frozen dataclass, the rows of a column."""
    if isinstance(thing, (tuple, list)):
        yield from thing[:MOST_ITEMS]
    elif isinstance(thing, dict):
        yield from list(thing.values())[:MOST_ITEMS]
    elif isinstance(thing, np.ndarray) and thing.ndim == 1 and thing.dtype.kind in "iufO":
        yield from thing[:MOST_ITEMS].tolist()
    elif isinstance(thing, (pa.Array, pa.ChunkedArray)):
        yield thing[:MOST_ITEMS].to_pylist()
    elif isinstance(thing, (pa.Table, pa.RecordBatch)):
        yield from thing[:MOST_ITEMS].to_pydict().values()
    elif isinstance(thing, pd.DataFrame):
        yield from (column.to_numpy() for _, column in thing.items())
    elif isinstance(thing, pd.Series):
        yield thing.to_numpy()
    elif isinstance(thing, BaseModel):
        yield from thing.__dict__.values()
    elif is_frozen(thing):
        yield from (getattr(thing, name, None) for name in type(thing).__dataclass_fields__)


def is_frozen(thing: object) -> bool:
    """Whether it is an object of a frozen dataclass, which carries values and keeps no state."""
    parameters = getattr(type(thing), "__dataclass_params__", None)
    return parameters is not None and parameters.frozen


def number(celsius: int) -> Callable[[object], bool]:
    """A temperature: a number, or the same in a text."""
    text = re.compile(rf"(?<![0-9a-z])0*{celsius}(\.0+)?(?![0-9a-z])")

    def is_plain(thing: object) -> bool:
        if isinstance(thing, str):
            return len(thing) < MOST_TEXT and text.search(thing) is not None
        return type(thing) in (int, float) and thing == celsius

    return is_plain


def is_alarm(thing: object) -> bool:
    """The flags of the answer, or the kind of the event."""
    if isinstance(thing, str):
        return thing == "alarm.high" or thing.endswith("TA100001")
    return type(thing) is tuple and thing == (0, 0, 0, 0, 1)


SETTING = Value(b"%05d" % SETTING_C, number(SETTING_C))
TEMPERATURE = Value(b"%05d" % SEEN_C, number(SEEN_C))
ALARM = Value(b"TA100001", is_alarm)


class Visit(NamedTuple):
    """One call of a function; `number` in the order of the calls."""

    handling: Handling
    number: int

    @property
    def file(self) -> str:
        return self.handling.file


@dataclass
class Tracer:
    """Notes the calls in which a function handles a value, and each step of the value between two
    of them: as an argument, as a result, and from a driver into a coroutine and back.
    """

    value: Value
    visits: dict[Visit, None] = field(default_factory=dict)
    steps: dict[Visit, set[Visit]] = field(default_factory=dict)
    _running: dict[int, Visit] = field(default_factory=dict)
    _names: dict[CodeType, Handling | None] = field(default_factory=dict)
    _number: Iterator[int] = field(default_factory=count)

    def __call__(self, frame: FrameType, event: str, result: object) -> None:
        if event == "call":
            self._visit(frame)
            return
        visit = self._visit(frame) if event == "return" else None
        if visit is None:
            return
        flags = frame.f_code.co_flags
        is_request = bool(flags & AWAITED) and is_yielding(frame)
        if not is_request:
            self._running.pop(id(frame), None)
        elif flags & inspect.CO_COROUTINE:
            return  # it passes on what the innermost generator asks
        self._note(frame, visit, result, is_request)

    def _note(self, frame: FrameType, visit: Visit, result: object, is_request: bool) -> None:
        caller = self._above(frame, among_coroutines=not is_request)
        is_result = self.value.is_in(result)
        if is_result:
            self._step(visit, caller)
        if self.value.is_in(arguments_of(frame)):
            self._step(caller, visit)
        if is_result and not is_request and frame.f_code.co_flags & inspect.CO_ITERABLE_COROUTINE:
            self._step(self._above(frame, among_coroutines=False), visit)

    def _step(self, one: Visit | None, other: Visit | None) -> None:
        for visit in (one, other):
            if visit is not None:
                self.visits.setdefault(visit)
        if one is not None and other is not None:
            self.steps.setdefault(one, set()).add(other)

    def _above(self, frame: FrameType, *, among_coroutines: bool) -> Visit | None:
        """The call that made this one, itself or through a library. A driver is the next one that
        is no coroutine.
        """
        above = frame.f_back
        while above is not None:
            if among_coroutines or not above.f_code.co_flags & AWAITED:
                visit = self._visit(above)
                if visit is not None:
                    return visit
            above = above.f_back
        return None

    def _visit(self, frame: FrameType) -> Visit | None:
        code = frame.f_code
        if code not in self._names:
            path, name = code.co_filename, code.co_qualname.replace("<locals>.", "")
            is_ours = path.startswith(f"{PACKAGE}/") and "<" not in name
            self._names[code] = (
                Handling(path.removeprefix(f"{PACKAGE}/"), name) if is_ours else None
            )
        handling = self._names[code]
        if handling is None:
            return None
        return self._running.setdefault(id(frame), Visit(handling, next(self._number)))

    @contextmanager
    def tracing(self) -> Iterator[Tracer]:
        threading.setprofile(self)
        sys.setprofile(self)
        try:
            yield self
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]  # as sys.setprofile

    def chain(self, first: str, last: str) -> list[Handling]:
        """The way from file to file through the fewest that count; the earliest if several."""
        owners: dict[tuple[str, str], list[Visit]] = {}
        for visit in self.visits:
            owners.setdefault(owner_of(visit), []).append(visit)
        waiting = [(0, 0, (visit,)) for visit in self.visits if visit.file == first]
        heapq.heapify(waiting)
        seen: set[Visit] = set()
        while waiting:
            cost, steps, way = heapq.heappop(waiting)
            if way[-1].file == last:
                return list(dict.fromkeys(visit.handling for visit in way))
            if way[-1] in seen:
                continue
            seen.add(way[-1])
            after = self.steps.get(way[-1], set())
            if way[-1].file not in NOT_COUNTED and "." in way[-1].handling.function:
                # what one method keeps in its object, a later one takes out
                after = after.union(owners[owner_of(way[-1])])
            for visit in after - seen:
                more = visit.file not in NOT_COUNTED and visit.file != way[-1].file
                heapq.heappush(waiting, (cost + more, steps + 1, (*way, visit)))
        return []


def owner_of(visit: Visit) -> tuple[str, str]:
    """File and class of a method."""
    return visit.file, visit.handling.function.rpartition(".")[0]


def arguments_of(frame: FrameType) -> list[object]:
    code = frame.f_code
    count = code.co_argcount + code.co_kwonlyargcount + bool(code.co_flags & inspect.CO_VARARGS)
    names = [name for name in code.co_varnames[:count] if name not in ("self", "cls")]
    return [frame.f_locals[name] for name in names if name in frame.f_locals]


AWAITED = inspect.CO_COROUTINE | inspect.CO_GENERATOR | inspect.CO_ITERABLE_COROUTINE


def is_yielding(frame: FrameType) -> bool:
    """Whether it gives a request out and goes on later."""
    return dis.opname[frame.f_code.co_code[frame.f_lasti]] in ("YIELD_VALUE", "SEND")


NOT_COUNTED = frozenset(
    {"core/quantities.py", "core/io_requests.py", "core/rows.py", "core/errors.py"}
    | {f"protocol/commands/{path.name}" for path in (PACKAGE / "protocol/commands").iterdir()}
)
"""Tables, types and errors."""


class Step(NamedTuple):
    """A part of a walk, between two files that the value certainly passes."""

    text: str
    first: str
    last: str


RECORDS = Step(
    "the session hands it to the record", "protocol/client/robot.py", "record/run_journal.py"
)
ARRIVES = Step(
    "the driver hands bytes to the client", "transport/virtual.py", "protocol/client/robot.py"
)
SEALS = Step("a child process seals it", "record/journal_reader.py", "record/part_writer.py")
WALKS: Mapping[str, tuple[Value, tuple[Step, ...]]] = {
    "setting": (
        SETTING,
        (
            Step("jbclog reads the recipe", "core/toml.py", "config/load_recipe.py"),
            Step("the session writes it", "session/run/apply.py", "transport/virtual.py"),
        ),
    ),
    "temperature": (
        TEMPERATURE,
        (
            ARRIVES,
            RECORDS,
            SEALS,
            Step("the analysis reads it", "record/part_file.py", "analysis/run_tables.py"),
        ),
    ),
    "alarm": (ALARM, (RECORDS,)),
}


def trace(value: Value, home: Path) -> Tracer:
    """Trace a run in virtual time, and the figure and the alarms that are made of it."""
    tracer = Tracer(value)
    with tracer.tracing():
        plan = plan_in(home, LINE, WALKED_RECIPE, RUN_S, rate=2.0)
        stored = open_run(RecordedRun(plan, home / "runs").result.folder)
        if value is TEMPERATURE:
            stored.plot()
    return tracer


def rows_of(name: str, home: Path, listed: list[Handling]) -> list[tuple[str, Handling]]:
    """The files of a walk, each with its step and the function to read; one of `listed` stays if it
    handles the value.
    """
    value, steps = WALKS[name]
    tracer = trace(value, home)
    handled = {visit.handling for visit in tracer.visits}
    kept = {handling.file: handling for handling in listed if handling in handled}
    rows: dict[str, tuple[str, Handling]] = {}
    for step in steps:
        for handling in tracer.chain(step.first, step.last):
            if handling.file not in NOT_COUNTED:
                rows.setdefault(handling.file, (step.text, kept.get(handling.file, handling)))
    return list(rows.values())


def begin_of(name: str) -> str:
    return f"<!-- the walk of a value: {name}; {MAKE} -->\n"


END = "<!-- end -->"
ROW = re.compile(r"^\| [^|]* \| `([\w/.]+)` \| `([\w.]+)` \|$", re.MULTILINE)


def block_of(page: str, name: str) -> str:
    """The part of the page that is the walk of that value."""
    return page.partition(begin_of(name))[2].partition(END)[0]


def listed_in(page: str, name: str) -> list[Handling]:
    """The files and functions that the page lists."""
    return [Handling(*pair) for pair in ROW.findall(block_of(page, name))]


def table(rows: list[tuple[str, Handling]]) -> str:
    lines = ["| step | file | function to read |", "|---|---|---|"]
    step = ""
    for text, handling in rows:
        lines.append(
            f"| {text if text != step else ''} | `{handling.file}` | `{handling.function}` |"
        )
        step = text
    return "\n".join(lines) + "\n"


def main() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name in WALKS:
        with tempfile.TemporaryDirectory() as home:
            made = table(rows_of(name, Path(home), listed_in(page, name)))
        page = page.replace(begin_of(name) + block_of(page, name), begin_of(name) + made)
        sys.stdout.write(f"{name}\n{made}\n")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
