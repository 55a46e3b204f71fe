"""docs/reference/configuration.md: every key of the files that people write, from their models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from jbclog.config.jobs_file import BatchTables, JobTable
from jbclog.config.line import LineTables, StationTable
from jbclog.config.recipe_sections import RecipeTables
from jbclog.config.schema import LimitC, Minutes, Seconds, Switch
from jbclog.config.sim_spec import KEYS_OF_FAULT, NEEDS_END, FaultSpec, SimSpec
from jbclog.config.tasks_file import TasksFile, TaskTable
from support.pages.configuration_words import FAULTS, MEANINGS, TABLES
from support.pages.md_table import MADE, code, codes, table

Model = type[BaseModel]
FILES: Mapping[str, Mapping[str, Model]] = {
    "Recipe": {"": RecipeTables},
    "Line file": {
        "": LineTables,
        "[station]": StationTable,
        "station.sim": SimSpec,
        "[station.sim.fault]": FaultSpec,
    },
    "Jobs file": {"": BatchTables, "[job]": JobTable},
    "Tasks file": {"": TasksFile, "[task]": TaskTable},
}
"""File -> table as it stands in TOML -> its model. A table in brackets may come several times."""

ALLOWED: Mapping[object, str] = {
    Minutes: 'whole minutes, or "off"',
    Seconds: 'seconds in steps of 0.01, or "off"',
    LimitC: "whole °C in steps of 5",
    Switch: "true or false",
}
"""What the kinds of values say that carry no description of their own."""

INTRODUCTION = """
All files are TOML. An unknown key, a key that stands twice and a value that is not allowed are errors; every error is reported at
once with file, line, key and what is allowed, before anything is sent (exit code 2). A relative path is taken from the folder of
the file that it stands in. What only the station knows (R-MAT, R-MIT, ranges that no manual prints) is checked before the first
write where it can be read (exit code 3).
"""


def page() -> str:
    """The whole page."""
    sections = (f"## {title}\n\n{TABLES[title]}\n\n{_file(title)}" for title in FILES)
    return (
        f"{MADE}\n\n# Files and their keys\n{INTRODUCTION}\n"
        + "\n\n".join(sections)
        + f"\n\n{_faults()}\n"
    )


def keys(title: str) -> Iterable[tuple[str, str, FieldInfo]]:
    """Table, key and field of everything that a file may contain."""
    for name, model in FILES[title].items():
        yield from sorted(_keys(name, model), key=lambda found: found[0] != "recipe")


def _keys(name: str, model: Model) -> Iterable[tuple[str, str, FieldInfo]]:
    for key, field in model.model_fields.items():
        inner = _model_in(field.annotation)
        if inner is None and not _is_described_elsewhere(field):
            yield name, key, field
        elif inner is not None and inner not in (SimSpec, FaultSpec, TaskTable):
            below = f"{name}.{key}" if name else key
            yield from () if key == "port" else _keys(below, inner)


def _is_described_elsewhere(field: FieldInfo) -> bool:
    """A list of tables that is checked table by table."""
    return "dict[str, object]" in str(field.annotation)


def _model_in(annotation: object) -> Model | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(
        (found for inner in get_args(annotation) if (found := _model_in(inner)) is not None), None
    )


def _file(title: str) -> str:
    rows: dict[str, list[tuple[str, ...]]] = {}
    for name, key, field in keys(title):
        meaning = MEANINGS[title][f"{name.strip('[]')}.{key}".lstrip(".")]
        rows.setdefault(name, []).append((code(key), meaning, allowed(field), default(field)))
    head = ("key", "meaning", "allowed", "default")
    return "\n\n".join(
        f"### `{_heading(name)}`\n\n{table(head, found)}" for name, found in rows.items()
    )


def _heading(name: str) -> str:
    return f"[{name}]"


def allowed(field: FieldInfo) -> str:
    """What may stand there, in the words of its error message, or as its type and bounds say."""
    if field.description:
        return field.description
    for part in (field.annotation, *get_args(field.annotation)):
        if part in ALLOWED:
            return ALLOWED[part]
    return f"{_type(field.annotation)}{_bounds(field.metadata)}"


def _type(annotation: Any) -> str:
    names = {
        str: "text",
        int: "whole number",
        float: "number",
        bool: "true or false",
        type(None): "",
    }
    if annotation in names:
        return names[annotation]
    if get_origin(annotation) is Literal:
        return " ".join(code(f'"{value}"') for value in get_args(annotation))
    if get_origin(annotation) is Annotated:
        return _type(get_args(annotation)[0]) + _bounds(list(get_args(annotation)[1:]))
    inner = [text for one in get_args(annotation) if one is not Ellipsis and (text := _type(one))]
    if get_origin(annotation) is tuple:
        return f"list: {inner[0]}"
    if get_origin(annotation) is dict:
        return f"table: {inner[-1]}"
    return " or ".join(inner)


SIGNS: Mapping[str, str] = {
    "ge": "≥ ",
    "gt": "> ",
    "le": "≤ ",
    "lt": "< ",
    "min_length": "at least ",
    "max_length": "at most ",
}


def _bounds(metadata: list[Any]) -> str:
    pairs = []
    for one in metadata:
        for name in SIGNS:
            value = getattr(one, name, None)
            if value is not None:
                pairs.append(f"{SIGNS[name]}{value}{' characters' if 'length' in name else ''}")
    return f", {', '.join(pairs)}" if pairs else ""


def default(field: FieldInfo) -> str:
    """What holds where the key is missing; a dash where that is the station's, the family's or
    nothing.
    """
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value in (None, (), {}, "") or value is PydanticUndefined:
        return "–"
    return code(
        str(value).lower()
        if isinstance(value, bool)
        else f'"{value}"'
        if isinstance(value, str)
        else f"{value:g}"
    )


def _faults() -> str:
    rows = [
        (
            code(kind),
            FAULTS[kind],
            codes(sorted(taken)) + (" and `for_s`, required" if kind in NEEDS_END else ""),
        )
        for kind, taken in KEYS_OF_FAULT.items()
    ]
    head = ("`kind`", "what happens", "keys besides `kind`, `at_s`, `for_s`")
    return f"### Faults of virtual stations\n\n{table(head, rows)}"
