"""Read TOML with the line of each key. Start with `read_text` and `parse`."""

from __future__ import annotations

import json
import math
import re
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from jbclog.core.encodings import not_utf8
from jbclog.core.errors import Problem, Problems
from jbclog.core.files import LIMITS, Kind, read_regular
from jbclog.core.quantities import LARGEST, WHOLE
from jbclog.core.toml_advice import advice, hidden_words

# tomllib reports no positions of keys. `KeyScan` runs first: it finds the line of every key and all
# duplicate keys. It does not check syntax: where it cannot continue, tomllib reports on the text up
# to that line. docs/decisions/0058 compares other parsers.

KeyPath = tuple[str | int, ...]
"""Path of a key: names, and indexes (from 0) of tables in a list: ``("station", 1, "url")``."""

# (?>…*) instead of …*+ around a look-ahead, which matches nothing in the `re` of Python 3.11.2
_TOKEN = re.compile(
    r"""
    (?P<blank>[ \t\r]++|\#[^\n]*+)
    |(?P<newline>\n)
    |(?P<long>\"{3}(?>(?:[^"\\]|\\.|"(?!""))*)"{3,5}|'{3}(?>(?:[^']|'(?!''))*)'{3,5})
    |(?P<string>"(?:[^"\\\n]|\\[^\n])*+"|'[^'\n]*+')
    |(?P<word>[A-Za-z0-9_-]++)
    |(?P<mark>[\[\]{}=,.])
    |(?P<other>.)
    """,
    re.VERBOSE | re.DOTALL,
)
_IN_SCALARS = "+:"  # allowed in dates and numbers, beside the characters of a word


class Token(NamedTuple):
    kind: str  # a mark is its own kind
    text: str
    line: int


class Lost(Exception):
    """The text at `line` is not TOML."""

    def __init__(self, line: int) -> None:
        super().__init__(f"line {line}")
        self.line = line


class Twice(NamedTuple):
    """A key given a second time."""

    path: KeyPath
    line: int
    first: int


def _tokens(text: str) -> Iterator[Token]:
    """Yield the tokens without blanks and comments, then an ``end``."""
    line = 1
    for match in _TOKEN.finditer(text):
        kind, found = str(match.lastgroup), match.group()
        if kind != "blank":
            yield Token(found if kind == "mark" else kind, found, line)
        if kind in ("newline", "long"):
            line += found.count("\n")
    yield Token("end", "", line)


class KeyScan:
    """One pass over a text: `lines` maps each key path to its line, `twice` lists repeated keys."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self.twice: list[Twice] = []
        self._tokens = _tokens(text)
        self._ahead = next(self._tokens)
        self._table: KeyPath = ()
        self._lists: dict[KeyPath, int] = {}  # number of tables so far
        self._declared: set[KeyPath] = set()

    def run(self) -> None:
        """Scan the whole text. Raises Lost."""
        while self._ahead.kind != "end":
            if self._ahead.kind == "newline":
                self._take()
            elif self._ahead.kind == "[":
                self._header()
            else:
                self._assignment(self._table)
                self._end_of_line()

    def _take(self, *kinds: str) -> Token:
        token = self._ahead
        if kinds and token.kind not in kinds:
            raise Lost(token.line)
        if token.kind != "end":
            self._ahead = next(self._tokens)
        return token

    def _end_of_line(self) -> None:
        self._take("newline", "end")

    def _skip_newlines(self) -> None:
        while self._ahead.kind == "newline":
            self._take()

    def _key(self) -> tuple[str, ...]:
        parts = [self._part()]
        while self._ahead.kind == ".":
            self._take()
            parts.append(self._part())
        return tuple(parts)

    def _part(self) -> str:
        token = self._take("word", "string")
        if token.kind == "word":
            return token.text
        if token.text[0] == '"' and "\\" in token.text:
            return self._unescaped(token)
        return token.text[1:-1]

    def _unescaped(self, token: Token) -> str:
        try:
            return str(tomllib.loads(f"key = {token.text}")["key"])
        except ValueError:
            raise Lost(token.line) from None

    def _header(self) -> None:
        line = self._take("[").line
        is_list = self._ahead.kind == "["
        if is_list:
            self._take()
        parts = self._key()
        for _ in range(1 + is_list):
            self._take("]")
        self._end_of_line()
        place: KeyPath = (*self._resolved(parts[:-1], line), parts[-1])
        self._table = (
            self._next_in_list(place)
            if is_list
            else self._declare(self._resolved((parts[-1],), line, place[:-1]), line)
        )
        self.lines.setdefault(place, line)
        self.lines.setdefault(self._table, line)

    def _resolved(self, parts: tuple[str, ...], line: int, start: KeyPath = ()) -> KeyPath:
        """Return the path of a header's parts; the name of a list refers to its last table."""
        path = start
        for part in parts:
            path = (*path, part)
            self.lines.setdefault(path, line)
            if path in self._lists:
                path = (*path, self._lists[path] - 1)
        return path

    def _next_in_list(self, path: KeyPath) -> KeyPath:
        self._lists[path] = self._lists.get(path, 0) + 1
        return (*path, self._lists[path] - 1)

    def _declare(self, path: KeyPath, line: int) -> KeyPath:
        if path in self._declared:
            self.twice.append(Twice(path, line, self.lines[path]))
        self._declared.add(path)
        return path

    def _assignment(self, table: KeyPath) -> None:
        line = self._ahead.line
        path: KeyPath = table
        for part in self._key():
            if path:
                self.lines.setdefault(path, line)
            path = (*path, part)
        self._take("=")
        self._declare_value(path, line)
        self._value(path)

    def _declare_value(self, path: KeyPath, line: int) -> None:
        first = self.lines.setdefault(path, line)
        if path in self._declared:
            self.twice.append(Twice(path, line, first))
        self._declared.add(path)

    def _value(self, path: KeyPath) -> None:
        token = self._take()
        if token.kind in ("string", "long"):
            return
        if token.kind not in ("[", "{"):
            self._scalar(token)
            return
        if token.kind == "[":
            self._list(path)
        else:
            self._inline(path)

    def _scalar(self, token: Token) -> None:
        if token.kind != "word" and token.text not in _IN_SCALARS:
            raise Lost(token.line)
        while self._ahead.kind in ("word", ".") or (
            self._ahead.kind == "other" and self._ahead.text in _IN_SCALARS
        ):
            self._take()

    def _list(self, path: KeyPath) -> None:
        place = 0
        self._skip_newlines()
        while self._ahead.kind != "]":
            self.lines[(*path, place)] = self._ahead.line
            self._value((*path, place))
            place += 1
            self._skip_newlines()
            if self._ahead.kind != "]":
                self._take(",")
                self._skip_newlines()
        self._take("]")

    def _inline(self, path: KeyPath) -> None:
        self._skip_newlines()
        while self._ahead.kind != "}":
            self._assignment(path)
            self._skip_newlines()
            if self._ahead.kind != "}":
                self._take(",")
                self._skip_newlines()
        self._take("}")


MAX_BYTES = LIMITS[Kind.SETTINGS]
LONGEST_SHOWN = 40  # characters of a number in a message
MAX_PROBLEMS = 100  # per file; more are only counted
# control, bidirectional and other invisible characters
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
# can disguise a line
_HIDDEN_IN_TEXT = re.compile("[\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_AT_LINE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


@dataclass(frozen=True, slots=True)
class TomlText:
    """A parsed file: its text (``text.encode()`` gives the file's bytes), its tables, and the lines
    of its keys.
    """

    file: str
    text: str
    tables: dict[str, object]
    lines: Mapping[KeyPath, int]

    @property
    def path(self) -> Path:
        return Path(self.file)

    def rows(self, name: str) -> Iterator[tuple[int, dict[str, object]]]:
        """Yield the tables ``[[name]]`` with their indexes; skips other values."""
        found = self.tables.get(name)
        for place, table in enumerate(found if isinstance(found, list) else ()):
            if isinstance(table, dict):
                yield place, table

    def known(self, key: KeyPath) -> KeyPath:
        """Return the longest prefix of `key` that exists in the text."""
        while key and key not in self.lines:
            key = key[:-1]
        return key

    def problem(self, key: KeyPath, text: str) -> Problem:
        """Return a problem of `key`, at its line or, if it is missing, at the line of its table."""
        return Problem(self.file, self.lines.get(self.known(key)), dotted(key), text)


def shortened(problems: list[Problem]) -> list[Problem]:
    """Return the problems in file order without duplicates; counts those beyond `MAX_PROBLEMS`."""
    ordered = sorted(dict.fromkeys(problems), key=lambda problem: problem.line or 0)
    rest = len(ordered) - MAX_PROBLEMS
    return (
        ordered
        if rest <= 0
        else [
            *ordered[:MAX_PROBLEMS],
            Problem(ordered[0].file, None, "", f"and {rest} more problems"),
        ]
    )


def dotted(key: KeyPath) -> str:
    """Format a key: ``port.2.sleep.delay_min``; indexes count from one: ``station[2].url``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += ("." if text else "") + (part if _BARE.fullmatch(part) else json.dumps(part))
    return text


def read_text(path: Path, *, links: bool = True) -> str:
    """Read a file. Raises Problems if it is not a regular file, too large or not UTF-8; `links` as
    in `open_regular`.
    """
    try:
        data = read_regular(path, Kind.SETTINGS, links=links)
    except OSError as error:
        raise Problems([Problem(str(path), None, "", error.strerror or str(error))]) from error
    except ValueError as error:  # a NUL in the name
        raise Problems([Problem(ascii(str(path)), None, "", "is not a file's name")]) from error
    wrong = not_utf8(data)
    if wrong is not None:
        raise Problems([Problem(str(path), wrong.line, "", wrong.text)])
    return data.decode("utf-8")


def parse(text: str, file: str) -> TomlText:
    """Parse `text`. Raises Problems if it is not TOML."""
    if len(text) > MAX_BYTES:
        raise Problems([Problem(file, None, "", f"is larger than {MAX_BYTES // 1024} KiB")])
    plain = text.removeprefix("\ufeff")
    scan = KeyScan(plain)
    try:
        scan.run()
    except RecursionError as error:
        raise Problems([Problem(file, None, "", "is nested too deeply")]) from error
    except Lost as error:
        raise Problems([_syntax(plain, file, error.line)]) from error
    if scan.twice:
        twice = [
            Problem(file, line, dotted(key), f"given twice, first in line {first}")
            for key, line, first in scan.twice
        ]
        raise Problems(shortened(twice))
    return TomlText(file, text, _tables(plain, file), scan.lines)


def read_own(path: Path) -> dict[str, object]:
    """Read a data file of this package; nobody edits it, so it needs no lines of keys."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _tables(text: str, file: str) -> dict[str, object]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise Problems([Problem(file, None, "", "is nested too deeply")]) from error
    except ValueError as error:  # TOMLDecodeError, or a date or number that Python rejects
        raise Problems([_sentence(str(error), text, file)]) from error


def _syntax(text: str, file: str, line: int) -> Problem:
    """Return what is wrong in `line`, where the scan stopped, or tomllib's error for the text up to
    there.
    """
    sentence = advice(text, line)
    if sentence is not None:
        return Problem(file, line, "", sentence)
    beginning = "\n".join(text.split("\n")[:line])
    try:
        _tables(beginning, file)
    except Problems as found:
        return found.problems[0]
    return Problem(file, line, "", "this line is not TOML")


def _sentence(message: str, text: str, file: str) -> Problem:
    at = _AT_LINE.search(message)
    line = int(at[1]) if at and at[1] else text.count("\n") + 1
    sentence = advice(text, line) or f"this is not TOML: {_AT_LINE.sub('', message)}"
    return Problem(file, line, "", sentence)


def hidden(source: TomlText) -> list[Problem]:
    """Return a problem for each invisible character in values, names or comments."""
    found = list(_hidden_in(source, (), source.tables))
    reported = {problem.line for problem in found}
    for line, text in enumerate(source.text.removeprefix("\ufeff").split("\n"), 1):
        sign = _HIDDEN_IN_TEXT.search(text)
        if sign is not None and line not in reported:
            found.append(Problem(source.file, line, "", _holds(sign.group())))
    return found


def _hidden_in(source: TomlText, key: KeyPath, value: object) -> Iterator[Problem]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _hidden_in(source, (*key, name), name)
            yield from _hidden_in(source, (*key, name), inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _hidden_in(source, (*key, place), inner)
    elif isinstance(value, str):
        bad = next((sign for sign in value if unicodedata.category(sign) in _HIDDEN), None)
        if bad is not None:
            yield source.problem(key, _holds(bad))


def too_large(source: TomlText) -> list[Problem]:
    """Return a problem for each number that a run's manifest could not hold: `read_json` would
    refuse it.
    """
    return list(_too_large_in(source, (), source.tables))


def _too_large_in(source: TomlText, key: KeyPath, value: object) -> Iterator[Problem]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _too_large_in(source, (*key, name), inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _too_large_in(source, (*key, place), inner)
    elif (isinstance(value, int) and not -WHOLE <= value <= WHOLE) or (
        isinstance(value, float) and math.isfinite(value) and abs(value) > LARGEST
    ):
        shown = repr(value)
        shown = shown if len(shown) <= LONGEST_SHOWN else f"{shown[:LONGEST_SHOWN]}..."
        yield source.problem(key, f"{shown} is not allowed; numbers are at most {LARGEST:g}")


def _holds(sign: str) -> str:
    return f"contains a hidden character: {hidden_words(sign)}; remove it"
