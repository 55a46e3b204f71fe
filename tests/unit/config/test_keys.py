"""The scan that finds each key's line, against tomllib, which finds keys but not lines."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core.toml import KeyPath, KeyScan, Lost


def scanned(text: str) -> KeyScan:
    scan = KeyScan(text)
    scan.run()
    return scan


def paths(value: object, at: KeyPath = ()) -> Iterator[KeyPath]:
    """Every key path that tomllib found, members of lists with them."""
    if at:
        yield at
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from paths(inner, (*at, name))
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from paths(inner, (*at, place))


EVERYTHING = '''# "not a string' [not a table]
top = "a # no comment" # a comment
'quoted key' = 'lit\\eral'
day = 1979-05-27 07:32:00.5
moment = 1979-05-27T00:32:00.999999-07:00
number = -1_000.5e+3
many = [ # a list over lines
  1, # one
  [2, "]"],

  {x = 1, "y" = [3]},
]
text = """first
second = "not a key"
[neither]
third """"
last.of."top" = '''
EVERYTHING += "'''it''s\n[x]'''\n"
EVERYTHING += """
[ table . inner ]
a.b.c = true
a.b.d = { e.f = 1, g = {} }

[[row]]
name = "one"
[row.sub]
x = 1
[[row.part]]
[[row.part]]
y = 2
[[row]] # the second
name = "two"
[[row.part]]
z = 3
"""


def test_every_key_that_tomllib_finds_has_a_line() -> None:
    assert set(scanned(EVERYTHING).lines) == set(paths(tomllib.loads(EVERYTHING)))


@pytest.mark.parametrize(
    ("path", "beginning"),
    [
        (("top",), "top ="),
        (("quoted key",), "'quoted"),
        (("many",), "many ="),
        (("many", 1, 1), "  [2,"),
        (("many", 2, "y"), "  {x"),
        (("last", "of", "top"), "last.of"),
        (("table", "inner"), "[ table"),
        (("table", "inner", "a", "b", "d", "g"), "a.b.d"),
        (("row", 0, "sub", "x"), "x = 1"),
        (("row", 0, "part", 1, "y"), "y = 2"),
        (("row", 1), "[[row]] # the"),
        (("row", 1, "name"), 'name = "two"'),
        (("row", 1, "part", 0, "z"), "z = 3"),
    ],
)
def test_the_line_is_the_one_where_the_key_stands(path: KeyPath, beginning: str) -> None:
    line = scanned(EVERYTHING).lines[path]
    assert EVERYTHING.split("\n")[line - 1].startswith(beginning)


NAMES = st.sampled_from(["a", "b", "c-1", "d_2", "3", "key with blanks", "e.f", "#"])
SCALARS = st.one_of(
    st.integers(-(10**6), 10**6).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(
        ["true", "1979-05-27", "07:32:00", '"]"', "'# no'", '"""x\n]"""', "'''\n'''", '""', '"\\""']
    ),
)


def key_text(name: str) -> str:
    return name if name.replace("-", "").replace("_", "").isalnum() else f'"{name}"'


def inline(pairs: dict[str, str]) -> str:
    return "{ " + ", ".join(f"{key_text(name)} = {value}" for name, value in pairs.items()) + " }"


def listed(values: list[str]) -> str:
    return "[" + "".join(f"\n {value}, # {place} ]" for place, value in enumerate(values)) + "\n]"


VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(listed),
        st.dictionaries(NAMES, SCALARS, max_size=3).map(inline),
    ),
    max_leaves=6,
)
TABLES = st.dictionaries(NAMES, VALUES, max_size=4)


@given(st.lists(st.tuples(st.booleans(), TABLES), max_size=6))
def test_any_text_that_tomllib_reads_is_scanned_alike(
    tables: list[tuple[bool, dict[str, str]]],
) -> None:
    text = ""
    for place, (is_row, pairs) in enumerate(tables):
        text += "[[row]]\n" if is_row else f"[t{place}.'in #']\n"
        text += "".join(f"{key_text(name)} = {value} # [x\n" for name, value in pairs.items())
    scan = scanned(text)
    assert set(scan.lines) == set(paths(tomllib.loads(text)))
    assert scan.twice == []


@given(st.text(alphabet="ab.=[]{}\"'\\#\n ,1+-\r", max_size=40))
def test_no_text_that_tomllib_reads_is_lost_and_none_breaks_the_scan(text: str) -> None:
    try:
        found = set(paths(tomllib.loads(text)))
    except ValueError:
        found = None
    try:
        lines = set(scanned(text).lines)
    except Lost:
        lines = None
    if found is not None and lines is not None:
        assert lines == found
    if found is not None:
        assert lines is not None


@pytest.mark.parametrize(
    ("text", "path", "line", "first"),
    [
        ("a = 1\n\na = 2\n", ("a",), 3, 1),
        ("[t]\nx = 1\n[u]\n[t]\n", ("t",), 4, 1),
        ("a.b = 1\na.b = 2\n", ("a", "b"), 2, 1),
        ("[t]\nx = 1\n[t.x]\n", ("t", "x"), 3, 2),
        ("[[t]]\n[[t]]\nx = 1\nx = 2\n", ("t", 1, "x"), 4, 3),
        ("a = {b = 1,\n", None, 0, 0),
    ],
)
def test_a_key_given_twice_is_told_with_both_lines(
    text: str, path: KeyPath | None, line: int, first: int
) -> None:
    if path is None:
        with pytest.raises(Lost):
            scanned(text)
        return
    assert scanned(text).twice == [(path, line, first)]


def test_a_key_with_an_escape_is_the_one_that_tomllib_finds() -> None:
    text = 'a = 1\n"x\\ty\\u00e9" = 2'
    assert scanned(text).lines[("x\ty\u00e9",)] == 2
    with pytest.raises(Lost):
        scanned('"x\\q" = 1')
