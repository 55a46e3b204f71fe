"""Dataclasses from JSON: the description of each type is made at import, before there are threads."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import jbclog
from jbclog.core.foreign.json_reader import builder

PACKAGE = Path(jbclog.__file__).parent
DESCRIBE = {"builder", "Decoder"}
CONVERT = {"convert"}


def calls(tree: ast.AST, names: set[str]) -> Iterator[ast.Call]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and (getattr(node.func, "id", None) or getattr(node.func, "attr", None)) in names:
            yield node


def test_a_flag_is_not_a_number() -> None:
    with pytest.raises(ValueError, match="got `bool`"):
        builder(int)(True)


def test_two_threads_never_describe_a_type_at_once() -> None:
    """msgspec 0.22 crashes the process (SIGSEGV) where a thread converts to a type that another one has half described."""
    described = 0
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        later = {id(call) for function in functions for call in calls(function, DESCRIBE | CONVERT)}
        found = [call for call in calls(tree, DESCRIBE) if path.name != "json_reader.py"]
        assert [call.lineno for call in found if id(call) in later] == [], path
        assert path.name == "json_reader.py" or not list(calls(tree, CONVERT)), path
        described += len(found)
    assert described >= 16
