"""What a Python file imports, found without running it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple


class Import(NamedTuple):
    """`module` as it is imported at `place` (``file:line``)."""

    place: str
    module: str


@cache
def parsed(path: Path) -> ast.Module:
    """The file, parsed once however many tests look at it."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imports_of(path: Path, root: Path) -> Iterator[Import]:
    """Every import of the file, those inside functions and under TYPE_CHECKING too; `root` is left out of the places.

    ``from a import b`` is told as ``a.b``, because `b` may be a module.
    """
    for node in ast.walk(parsed(path)):
        place = f"{path.relative_to(root)}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Import):
            yield from (Import(place, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{place}: imports are written in full"
            yield from (Import(place, f"{node.module}.{alias.name}") for alias in node.names)


def room_of(module: str) -> str:
    """The room of a module of jbclog: ``jbclog.record.seal`` is in `record`, ``jbclog.plan`` is `plan`."""
    return [*module.split("."), "jbclog"][1]


def room_of_file(path: Path, package: Path) -> str:
    """The room that a file of the package at `package` belongs to; the package's own `__init__` is `jbclog`."""
    parts = path.relative_to(package).with_suffix("").parts
    return "jbclog" if parts == ("__init__",) else parts[0]
