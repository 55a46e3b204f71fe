"""Validate TOML tables against typed models, and word the mistakes.

A field's `description` states what is allowed; every message about that key ends with it.
"""

from __future__ import annotations

import difflib
import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationError,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from jbclog.core.errors import Problem
from jbclog.core.quantities import OFF, Off
from jbclog.core.text import is_device_name
from jbclog.core.toml import MAX_PROBLEMS, KeyPath, TomlText, hidden, too_large
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega import CONDITIONS, is_condition

_TABLE_ERRORS = ("model_type", "model_attributes_type", "dict_type", "mapping_type")
_WORDED = ("worded", "value_error")


class Table(BaseModel):
    """A table of a file: immutable, no unknown keys, no type conversion."""

    # defer the build to first use: most models only serve as parts of others
    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True
    )


class CheckedFile(Table):
    """A checked file, with its text."""

    source: TomlText = Field(repr=False)

    @property
    def path(self) -> Path:
        return self.source.path

    @property
    def text(self) -> str:
        """The file's text: ``text.encode()`` gives its bytes."""
        return self.source.text

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()

    def problem(self, key: KeyPath, text: str) -> Problem:
        """Return a problem of a key, with file and line."""
        return self.source.problem(key, text)


Row = TypeVar("Row", bound=Table)


def said(text: str) -> PydanticCustomError:
    """Return a validation error with this text as its whole message."""
    return PydanticCustomError("worded", "{text}", {"text": text})


def _as_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


FromList = BeforeValidator(_as_tuple)
"""Converts a TOML list to a tuple."""

NAME_PATTERN = r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}"
NAME_ALLOWED = (
    "1 to 64 of the characters A-Z a-z 0-9 . _ -, the first of them a letter, a digit or _"
)


def name_problem(name: str) -> str | None:
    """Return why a name is not allowed; None if it is. Names become names of files, which people
    copy to other systems.
    """
    if not re.fullmatch(NAME_PATTERN, name):
        return NAME_ALLOWED
    if is_device_name(name):
        return "Windows takes it for a device, so no file there can have it: give another name"
    if name.endswith("."):
        return "Windows drops a dot at the end of a name: give another name"
    return None


def _as_name(name: str) -> str:
    problem = name_problem(name)
    if problem is not None:
        raise said(f"{shown(name)} is not allowed; {problem}")
    return name


Name = Annotated[str, AfterValidator(_as_name)]


def read_file(row: type[Row], source: TomlText) -> tuple[Row | None, list[Problem], list[KeyPath]]:
    """Apply `read_table` to the whole file; also report hidden characters and numbers that no
    record could hold.
    """
    tables, wrong, keys = read_table(row, source, (), source.tables)
    named = {problem.key for problem in wrong}
    large = [problem for problem in too_large(source) if problem.key not in named]
    return tables, hidden(source) + wrong + large, keys


def read_table(
    row: type[Row], source: TomlText, at: KeyPath, table: object
) -> tuple[Row | None, list[Problem], list[KeyPath]]:
    """Return the typed table at `at` or None, its problems, and their key paths below `at`."""
    try:
        return row.model_validate(table), [], []
    except ValidationError as error:
        details = error.errors(include_url=False, include_context=False)
        problems = [_problem(row, source, at, detail) for detail in details[: MAX_PROBLEMS + 1]]
        return None, problems, [detail["loc"] for detail in details]


def without_case(name: object) -> object:
    """Return a name to compare with others: those that differ in case only are one file on
    Windows.
    """
    return name.casefold() if isinstance(name, str) else name


def shared(
    source: TomlText,
    rows: str,
    key: str,
    values: Iterable[tuple[int, object]],
    text: str,
    why: str = "",
) -> Iterator[Problem]:
    """Yield a problem for each table ``[[rows]]`` whose value at `key` repeats an earlier one.

    `values` are the values to compare, with the indexes of their tables.
    """
    first: dict[str, int] = {}
    tables = dict(source.rows(rows))
    for place, value in values:
        if isinstance(value, str) and first.setdefault(value, place) != place:
            line = source.lines.get((rows, first[value], key))
            written = shown(tables[place].get(key))
            yield source.problem((rows, place, key), f"{written} {text}, first in line {line}{why}")


def _problem(row: type[Table], source: TomlText, at: KeyPath, detail: ErrorDetails) -> Problem:
    key = source.known((*at, *detail["loc"]))
    if detail["type"] == "missing":
        key = (*key, detail["loc"][-1])
    return source.problem(key, _sentence(row, key[len(at) :], detail))


def _sentence(row: type[Table], key: KeyPath, detail: ErrorDetails) -> str:
    kind = detail["type"]
    if kind == "extra_forbidden":
        return unknown(str(key[-1]), _names_beside(row, key))
    if kind in _WORDED:
        return detail["msg"].removeprefix("Value error, ")
    if kind in _TABLE_ERRORS:
        return f"must be a table (got {shown(detail['input'])})"
    allowed = _allowed(row, key)
    if kind == "missing":
        return f"missing; {allowed}" if allowed else "missing"
    meant = (
        _nearest(detail["input"], _choices(row, key)) if isinstance(detail["input"], str) else None
    )
    return (
        f"{shown(detail['input'])} is not allowed;"
        f" {f'did you mean {meant}?' if meant else allowed or detail['msg'].lower()}"
    )


def unknown(name: str, names: list[str]) -> str:
    """Return the message for a name that is not in `names`, with a similar one if there is any."""
    near = _nearest(name, names)
    return (
        f"unknown; did you mean {near}?"
        if near
        else f"unknown; allowed here: {', '.join(names) or 'nothing'}"
    )


def _nearest(name: str, names: Iterable[str]) -> str | None:
    """Return the most similar of `names`, ignoring case; None if none is similar."""
    folded = {one.casefold(): one for one in names}
    near = difflib.get_close_matches(name[:64].casefold(), folded, n=1)
    return folded[near[0]] if near else None


def shown(value: object) -> str:
    """Format a value as in the file, shortened and without control characters."""
    if isinstance(value, bool):
        return "true" if value else "false"
    text = '"' + repr(value)[1:-1] + '"' if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _names_beside(row: type[Table], key: KeyPath) -> list[str]:
    table = _table_at(row, key[:-1])
    return [] if table is None else list(table.model_fields)


def _allowed(row: type[Table], key: KeyPath) -> str | None:
    """Return the description of the field at `key`, or of the list or mapping that contains it."""
    while key and isinstance(key[-1], int):
        key = key[:-1]
    field, around = _field(row, key), _field(row, key[:-1])
    if field is None and around is not None and _is_mapping(around.annotation):
        field = around
    return field.description if field is not None else None


def _choices(row: type[Table], key: KeyPath) -> list[str]:
    """Return the texts that the field at `key` allows; empty if it allows any."""
    field = _field(row, key)
    found = get_args(field.annotation) if field is not None else ()
    return [text for one in found for text in get_args(one) or (one,) if isinstance(text, str)]


def _field(row: type[Table], key: KeyPath) -> FieldInfo | None:
    table = _table_at(row, key[:-1]) if key else None
    return table.model_fields.get(str(key[-1])) if table is not None else None


def _table_at(row: type[BaseModel], key: KeyPath) -> type[BaseModel] | None:
    """Return the model of the table at `key`; indexes and keys of mappings do not change it."""
    table: type[BaseModel] | None = row
    in_mapping = False
    for part in key:
        if isinstance(part, int) or in_mapping:
            in_mapping = False
            continue
        field = table.model_fields.get(part) if table is not None else None
        if field is None:
            return None
        table, in_mapping = _model_in(field.annotation), _is_mapping(field.annotation)
    return table


def _model_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(
        (found for inner in get_args(annotation) if (found := _model_in(inner)) is not None), None
    )


def _is_mapping(annotation: object) -> bool:
    origin = getattr(annotation, "__origin__", None)
    return isinstance(origin, type) and issubclass(origin, Mapping)


# Types of values in a recipe. They check types only; `load_recipe.py` checks ranges by the command
# tables.

FIVE_DIGITS: Final = "as far as five digits go; no manual prints a range"
TENTHS: Final = "0 to 409.5 in steps of 0.1"
AUTO: Final = "auto"
RATES: Final = f'Hz, from 0.001 to 1000, or "{AUTO}"'
METADATA: Final = ("operator", "order", "product", "unit", "wire_lot", "flux_lot", "tip")


def _minutes(value: object) -> int | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f'{shown(value)} is not allowed; whole minutes, or "off"')
    return value


def _seconds(value: object) -> float | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise said(f'{shown(value)} is not allowed; seconds in steps of 0.01, or "off"')
    return float(value)


def _limit(value: object) -> int:
    if value == "off":
        raise said(
            '"off" is not allowed; no manual prints how to clear a limit: use delay_s = "off"'
        )
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f"{shown(value)} is not allowed; whole °C in steps of 5")
    return value


def _rate(value: object) -> float | str:
    if value == AUTO:
        return AUTO
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.001 <= value <= 1000:
        raise said(f"{shown(value)} is not allowed; {RATES}")
    return float(value)


def _confidence(value: object) -> float | Literal["none"]:
    if value == "none":
        return "none"
    if isinstance(value, float) and value == 0.95:
        return value
    raise ValueError('must be 0.95 or "none"')


def _on_off(value: object) -> str:
    if not isinstance(value, bool):
        raise said(f"{shown(value)} is not allowed; true or false")
    return "on" if value else "off"


def _tenths(value: float) -> float:
    if abs(value * 10 - round(value * 10)) > 1e-6:
        raise said(f"{value} is not allowed; {TENTHS}")
    return round(value, 1)


def _condition(number: int) -> int:
    if not is_condition(number):
        raise said(f"{number} is not allowed; {CONDITIONS}")
    return number


def _family(name: str) -> str:
    if name not in FAMILIES:
        raise said(f"{shown(name)} is {unknown(name, list(FAMILIES))}")
    return name


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    seen: set[str] = set()
    for value in values:
        if value in seen:
            raise said(f"{shown(value)} is listed twice")
        seen.add(value)
    return values


def _metadata(name: str) -> str:
    if name not in METADATA and not name.removeprefix("tag."):
        raise said("a tag's name is missing behind tag.")
    if name not in METADATA and not name.startswith("tag."):
        raise said(f"{shown(name)} is {unknown(name, [*METADATA, 'tag.NAME'])}")
    return name


Minutes = Annotated[int | Off, PlainValidator(_minutes)]
Seconds = Annotated[float | Off, PlainValidator(_seconds)]
LimitC = Annotated[int, PlainValidator(_limit)]
Rate = Annotated[float | str, PlainValidator(_rate)]
Confidence = Annotated[float | Literal["none"], PlainValidator(_confidence)]
Switch = Annotated[str, PlainValidator(_on_off)]
FamilyName = Annotated[str, AfterValidator(_family)]
Families = Annotated[tuple[FamilyName, ...], FromList, AfterValidator(_no_repeats)]
Required = Annotated[
    tuple[Annotated[str, AfterValidator(_metadata)], ...], FromList, AfterValidator(_no_repeats)
]
Condition = Annotated[int, AfterValidator(_condition)]
Tenths = Annotated[float, Field(ge=0, le=409.5), AfterValidator(_tenths)]
