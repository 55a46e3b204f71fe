"""Where each key of a TOML text stands, found before it is parsed, within limits.

tomllib tells no line numbers, and takes 5.8 s for 40 kB of dotted keys (docs/reference/faults.md, F-33). This scan looks at
each character once. It gives the line of every key, every key that is given twice, and stops at the first thing
that is larger than any line file or recipe. It does not judge syntax: where it loses the thread it says so, and
tomllib is then asked about the text up to there only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

KeyPath = tuple[str | int, ...]
"""A key's place: names, and numbers (from 0) for tables in a list: ``("station", 1, "url")``."""

MAX_PARTS = 8
MAX_NESTING = 8
MAX_WORD = 64
MAX_ENTRIES = 4000  # keys, headers and list members of one file; 250 stations have about 1 500

# (?>…*) and not …*+ around a look-ahead, with which the `re` of Python 3.11.2 finds nothing
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
_IN_SCALARS = "+:"  # signs of dates and numbers besides those of a word


class Token(NamedTuple):
    kind: str  # a mark is its own kind
    text: str
    line: int


class TooLarge(Exception):
    """The text goes beyond a limit at `line`."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(text)
        self.line = line


class Lost(Exception):
    """At `line` the text is not what TOML allows there."""

    def __init__(self, line: int) -> None:
        super().__init__(f"line {line}")
        self.line = line


class Twice(NamedTuple):
    """A key given a second time."""

    path: KeyPath
    line: int
    first: int


def _tokens(text: str) -> Iterator[Token]:
    """The text's tokens without blanks and comments, and an ``end`` behind them."""
    line = 1
    for match in _TOKEN.finditer(text):
        kind, found = str(match.lastgroup), match.group()
        if kind != "blank":
            yield Token(found if kind == "mark" else kind, found, line)
        if kind in ("newline", "long"):
            line += found.count("\n")
    yield Token("end", "", line)


class KeyScan:
    """One pass over a text; afterwards `lines` maps each key path to its line and `twice` names repeated keys."""

    def __init__(self, text: str) -> None:
        self.lines: dict[KeyPath, int] = {}
        self.twice: list[Twice] = []
        self._tokens = _tokens(text)
        self._ahead = next(self._tokens)
        self._table: KeyPath = ()
        self._lists: dict[KeyPath, int] = {}  # tables in a list: how many there are so far
        self._declared: set[KeyPath] = set()
        self._entries = 0

    def run(self) -> None:
        """Scan to the end; raises `TooLarge` or `Lost`."""
        while self._ahead.kind != "end":
            if self._ahead.kind == "newline":
                self._take()
            elif self._ahead.kind == "[":
                self._header()
            else:
                self._assignment(self._table, 0)
                self._end_of_line()

    def _take(self, *kinds: str) -> Token:
        token = self._ahead
        if kinds and token.kind not in kinds:
            raise Lost(token.line)
        if token.kind == "word":
            self._measure(token.text, token.line)
        if token.kind != "end":
            self._ahead = next(self._tokens)
        return token

    def _measure(self, word: str, line: int) -> None:
        if len(word) > MAX_WORD:
            raise TooLarge(line, f"a word of {len(word)} characters; at most {MAX_WORD} are read")

    def _end_of_line(self) -> None:
        self._take("newline", "end")

    def _skip_newlines(self) -> None:
        while self._ahead.kind == "newline":
            self._take()

    def _count(self, line: int) -> None:
        self._entries += 1
        if self._entries > MAX_ENTRIES:
            raise TooLarge(line, f"more than {MAX_ENTRIES} keys and list members")

    def _key(self) -> tuple[str, ...]:
        parts = [self._part()]
        while self._ahead.kind == ".":
            self._take()
            parts.append(self._part())
            if len(parts) > MAX_PARTS:
                raise TooLarge(self._ahead.line, f"a key of more than {MAX_PARTS} parts")
        return tuple(parts)

    def _part(self) -> str:
        token = self._take("word", "string")
        if token.kind == "word":
            return token.text
        if token.text[0] == '"' and "\\" in token.text:
            raise TooLarge(token.line, "a key with an escape sequence; write its name plainly")
        self._measure(token.text[1:-1], token.line)
        return token.text[1:-1]

    def _header(self) -> None:
        line = self._take("[").line
        is_list = self._ahead.kind == "["
        if is_list:
            self._take()
        parts = self._key()
        for _ in range(1 + is_list):
            self._take("]")
        self._end_of_line()
        self._count(line)
        place: KeyPath = (*self._resolved(parts[:-1], line), parts[-1])
        self._table = self._next_in_list(place) if is_list else self._declare(self._resolved((parts[-1],), line, place[:-1]), line)
        self.lines.setdefault(place, line)
        self.lines.setdefault(self._table, line)

    def _resolved(self, parts: tuple[str, ...], line: int, start: KeyPath = ()) -> KeyPath:
        """The path of a header's parts: behind the name of a list its last table is meant."""
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

    def _assignment(self, table: KeyPath, nesting: int) -> None:
        line = self._ahead.line
        path: KeyPath = table
        for part in self._key():
            if path:
                self.lines.setdefault(path, line)
            path = (*path, part)
        self._take("=")
        self._count(line)
        self._declare_value(path, line)
        self._value(path, nesting)

    def _declare_value(self, path: KeyPath, line: int) -> None:
        first = self.lines.setdefault(path, line)
        if path in self._declared:
            self.twice.append(Twice(path, line, first))
        self._declared.add(path)

    def _value(self, path: KeyPath, nesting: int) -> None:
        token = self._take()
        if token.kind in ("string", "long"):
            return
        if token.kind not in ("[", "{"):
            self._scalar(token)
            return
        if nesting == MAX_NESTING:
            raise TooLarge(token.line, f"lists or tables nested deeper than {MAX_NESTING}")
        if token.kind == "[":
            self._list(path, nesting + 1)
        else:
            self._inline(path, nesting + 1)

    def _scalar(self, token: Token) -> None:
        if token.kind != "word" and token.text not in _IN_SCALARS:
            raise Lost(token.line)
        while self._ahead.kind in ("word", ".") or (self._ahead.kind == "other" and self._ahead.text in _IN_SCALARS):
            self._take()

    def _list(self, path: KeyPath, nesting: int) -> None:
        place = 0
        self._skip_newlines()
        while self._ahead.kind != "]":
            self._count(self._ahead.line)
            self.lines[(*path, place)] = self._ahead.line
            self._value((*path, place), nesting)
            place += 1
            self._skip_newlines()
            if self._ahead.kind != "]":
                self._take(",")
                self._skip_newlines()
        self._take("]")

    def _inline(self, path: KeyPath, nesting: int) -> None:
        self._skip_newlines()
        while self._ahead.kind != "}":
            self._assignment(path, nesting)
            self._skip_newlines()
            if self._ahead.kind != "}":
                self._take(",")
                self._skip_newlines()
        self._take("}")
