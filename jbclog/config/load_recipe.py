"""From a recipe file to a `Recipe`, or to everything that is wrong with it, at once."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Final

from jbclog.config.recipe import Recipe
from jbclog.config.recipe_checks import problems_between
from jbclog.config.recipe_sections import RecipeTables
from jbclog.config.schema import read_table
from jbclog.config.toml_keys import KeyPath
from jbclog.config.toml_reader import TomlText, hidden, parse, read_text, shortened
from jbclog.core.errors import Problem, Problems
from jbclog.protocol.commands.family import FAMILIES

IS_A_LINE: Final = "this is a line file; a recipe has [recipe] and what is asked of the stations"
_STAND_IN: Final[dict[str, object]] = {"name": "unnamed", "revision": 0, "families": list(FAMILIES)}


def load_recipe(path: Path, *, links: bool = True) -> Recipe:
    """The recipe at `path`; `links` as in `open_foreign`. Raises `Problems` with everything that is wrong with it."""
    return parse_recipe(read_text(path, links=links), path)


def parse_recipe(text: str, path: Path = Path("recipe.toml")) -> Recipe:
    """The recipe of that text; `path` stands in its sentences."""
    source = parse(text, str(path))
    if "recipe" not in source.tables and {"line", "station"} & source.tables.keys():
        raise Problems([Problem(source.file, None, "", IS_A_LINE)])
    problems = hidden(source)
    tables, wrong, keys = read_table(RecipeTables, source, (), source.tables)
    problems += wrong
    whole = tables if tables is not None else _what_is_left(source, keys)
    if whole is not None:
        problems += problems_between(_recipe(whole, source))
    if problems or tables is None:
        raise Problems(shortened(problems))
    return _recipe(tables, source)


def _recipe(tables: RecipeTables, source: TomlText) -> Recipe:
    return Recipe.model_construct(**{name: getattr(tables, name) for name in RecipeTables.model_fields}, source=source)


def _what_is_left(source: TomlText, wrong: list[KeyPath]) -> RecipeTables | None:
    """The recipe without the keys that are wrong, so that what belongs together is checked at the same time."""
    data = copy.deepcopy(source.tables)
    for key in reversed(wrong):  # from the end, so that places in lists stay what they were
        _drop(data, source.known(key))
    head = data.get("recipe")
    data["recipe"] = {**_STAND_IN, **(head if isinstance(head, dict) else {})}
    return read_table(RecipeTables, source, (), data)[0]


def _drop(tables: dict[str, object], key: KeyPath) -> None:
    """Take `key` out of `tables`. A head that only lacks something is kept: a stand-in fills it."""
    if not key or (key == ("recipe",) and isinstance(tables.get("recipe"), dict)):
        return
    table: object = tables
    for part in key[:-1]:
        table = _member(table, part)
    last = key[-1]
    if isinstance(table, dict):
        table.pop(last, None)
    elif isinstance(table, list) and isinstance(last, int) and last < len(table):
        del table[last]


def _member(table: object, part: str | int) -> object:
    if isinstance(table, dict):
        return table.get(part)
    if isinstance(table, list) and isinstance(part, int) and part < len(table):
        return table[part]
    return None
