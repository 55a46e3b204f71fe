"""Python files as syntax trees."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """The file, parsed once however many tests look at it."""
    return ast.parse(path.read_text(encoding="utf-8"))
