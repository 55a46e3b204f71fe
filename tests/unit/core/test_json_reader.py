"""Dataclasses from JSON: each type's description is made at import, before any thread."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import jbclog
from jbclog.core.json_files import MOST_OBJECTS, MOST_VALUES, builder, decoder, json_of
from support.campaigns.each_row import each_row

PACKAGE = Path(jbclog.__file__).parent
DESCRIBE = {"builder", "decoder", "Decoder"}
CONVERT = {"convert"}


def calls(tree: ast.AST, names: set[str]) -> Iterator[ast.Call]:
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and (getattr(node.func, "id", None) or getattr(node.func, "attr", None)) in names
        ):
            yield node


def test_a_flag_is_not_a_number() -> None:
    with pytest.raises(ValueError, match="got `bool`"):
        builder(int)(True)


@dataclass(frozen=True)
class Part:
    """Some keys of a file that has more."""

    name: str
    heat_c: float | None = None


read_part, build_part = decoder(Part), builder(Part)
DIGITS = "1234567890"
OTHERS = [
    *(
        "1",
        "-0.5",
        "1e17",
        '"1e99"',
        '"' + DIGITS * 7 + '"',
        "0.12345678901234567",
        "12345678901234567.1234567890e-30",
        "{}",
    ),
    *(
        "1e19",
        "1E+40",
        "-1e308",
        "9" * 19,
        "9" * 18 + ".5e9",
        "1." + "1" * 30 + "e99",
        DIGITS * 100 + "e5",
        "NaN",
        "-Infinity",
    ),
    *(
        '"\\ud800"',
        '"\\ud83d\\ude00"',
        '"\x01"',
        "[" * 100_000,
        "[" * 500 + "]" * 500,
        '{"a": 1, "a": 2}',
        "01",
        "tru",
        "",
    ),
]


AROUND = ('{"name": "a", "b": %s}', '{"name":"a","b":[1,%s]}', '{"heat_c":%s,"name":"a"}', "%s")


@each_row((f"{around} {text[:20]}", (text, around)) for text in OTHERS for around in AROUND)
def test_keys_that_are_not_needed_are_judged_all_the_same(text: str, around: str) -> None:
    data = (around % text).encode()
    assert outcome(lambda: read_part(data)) == outcome(
        lambda: build_part(json_of(data, in_utf8=True))
    )


def outcome(call: Callable[[], Part]) -> Part | str:
    try:
        return call()
    except ValueError as error:
        return str(error)


NO_JSON = [
    b'{"name": "\xff"}',
    b'{"name": "tip", "other": "\xff"}',
    b'{"name": "tip"} x',
    b"\xef\xbb\xbf{}",
]


@pytest.mark.parametrize("data", NO_JSON, ids=repr)
def test_bytes_that_are_no_json_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"decode byte|Extra data|Expecting|Unexpected"):
        read_part(data)


def test_too_many_objects_are_refused_where_nobody_needs_them() -> None:
    plain = json.dumps({"name": "tip", "other": [[]] * MOST_OBJECTS}).encode()
    with pytest.raises(ValueError, match="objects and lists"):
        read_part(plain)


def test_two_threads_never_describe_a_type_at_once() -> None:
    """msgspec 0.22 crashes the process (SIGSEGV) where a thread converts to a type that another one
    has half described.
    """
    described = 0
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if not any(name in text for name in DESCRIBE | CONVERT):
            continue
        tree = ast.parse(text)
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        later = {id(call) for function in functions for call in calls(function, DESCRIBE | CONVERT)}
        found = [call for call in calls(tree, DESCRIBE) if path.name != "json_files.py"]
        assert [call.lineno for call in found if id(call) in later] == [], path
        assert path.name == "json_files.py" or not list(calls(tree, CONVERT)), path
        described += len(found)
    assert described >= 16


def test_a_list_of_millions_of_values_is_refused_before_it_is_parsed() -> None:
    text = "[" + "1," * (MOST_VALUES + 1) + "1]"
    with pytest.raises(ValueError, match="more than 1400000 values"):
        json_of(text)
    with pytest.raises(ValueError, match="more than 1400000 values"):
        read_part(f'{{"name": "a", "more": {text}}}'.encode())
