"""TOML read with limits, and each key's line kept, so that every problem can say where it stands."""

from __future__ import annotations

import json
import re
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from jbclog.config.toml_keys import KeyPath, KeyScan, Lost, TooLarge
from jbclog.core.errors import Problem, Problems
from jbclog.core.foreign.files import LIMITS, Kind, read_foreign

MAX_BYTES = LIMITS[Kind.SETTINGS]
MAX_PROBLEMS = 100  # of one file; the rest is counted
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")  # control, bidirectional and other characters that do not show
_HIDDEN_IN_TEXT = re.compile("[\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]")  # may show a line as what it is not
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_AT_LINE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


@dataclass(frozen=True, slots=True)
class TomlText:
    """A file as it was read: its text (``text.encode()`` are the file's very bytes), its tables, its keys' lines."""

    file: str
    text: str
    tables: dict[str, object]
    lines: Mapping[KeyPath, int]

    def known(self, key: KeyPath) -> KeyPath:
        """The longest beginning of `key` that stands in the text."""
        while key and key not in self.lines:
            key = key[:-1]
        return key

    def problem(self, key: KeyPath, text: str) -> Problem:
        """What is wrong with `key`, at its line or, where it is missing, at that of the table it belongs into."""
        return Problem(self.file, self.lines.get(self.known(key)), dotted(key), text)


def shortened(problems: list[Problem]) -> list[Problem]:
    """The problems in the file's order, each once; beyond `MAX_PROBLEMS` only their number."""
    ordered = sorted(dict.fromkeys(problems), key=lambda problem: problem.line or 0)
    rest = len(ordered) - MAX_PROBLEMS
    return ordered if rest <= 0 else [*ordered[:MAX_PROBLEMS], Problem(ordered[0].file, None, "", f"and {rest} more problems")]


def dotted(key: KeyPath) -> str:
    """``port.2.sleep.delay_min``; tables in a list are counted from one: ``station[2].url``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += ("." if text else "") + (part if _BARE.fullmatch(part) else json.dumps(part))
    return text


def read_text(path: Path, *, links: bool = True) -> str:
    """The file's text. Raises `Problems` where it is no ordinary file, too large or not UTF-8; `links` as in `open_foreign`."""
    try:
        data = read_foreign(path, Kind.SETTINGS, links=links)
    except OSError as error:
        raise Problems([Problem(str(path), None, "", error.strerror or str(error))]) from error
    except ValueError as error:  # a NUL in the name
        raise Problems([Problem(ascii(str(path)), None, "", "is not a file's name")]) from error
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise Problems([Problem(str(path), line, "", f"is not UTF-8 (byte {error.start})")]) from error


def parse(text: str, file: str) -> TomlText:
    """Tables and lines of `text`. Raises `Problems` where it does not parse or goes beyond a limit."""
    if len(text) > MAX_BYTES:
        raise Problems([Problem(file, None, "", f"is larger than {MAX_BYTES // 1024} KiB")])
    plain = text.removeprefix("\ufeff")
    scan = KeyScan(plain)
    try:
        scan.run()
    except TooLarge as error:
        raise Problems([Problem(file, error.line, "", str(error))]) from error
    except Lost as error:
        raise Problems([_syntax(plain, file, error.line)]) from error
    if scan.twice:
        twice = [Problem(file, line, dotted(key), f"given twice, first in line {first}") for key, line, first in scan.twice]
        raise Problems(shortened(twice))
    return TomlText(file, text, _tables(plain, file), scan.lines)


def _tables(text: str, file: str) -> dict[str, object]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise Problems([Problem(file, None, "", "is nested too deeply")]) from error
    except ValueError as error:  # TOMLDecodeError, and what a date or number of its own raises
        raise Problems([_sentence(str(error), text, file)]) from error


def _syntax(text: str, file: str, line: int) -> Problem:
    """tomllib's opinion of the text up to `line`, where the scan lost the thread."""
    beginning = "\n".join(text.split("\n")[:line])
    try:
        _tables(beginning, file)
    except Problems as found:
        return found.problems[0]
    return Problem(file, line, "", "this line is not TOML")


def _sentence(message: str, text: str, file: str) -> Problem:
    at = _AT_LINE.search(message)
    line = int(at[1]) if at and at[1] else text.count("\n") + 1
    return Problem(file, line, "", f"this is not TOML: {_AT_LINE.sub('', message)}")


def hidden(source: TomlText) -> list[Problem]:
    """Characters that do not show, in values, names or comments."""
    found = list(_hidden_in(source, (), source.tables))
    told = {problem.line for problem in found}
    for line, text in enumerate(source.text.removeprefix("\ufeff").split("\n"), 1):
        sign = _HIDDEN_IN_TEXT.search(text)
        if sign is not None and line not in told:
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


def _holds(sign: str) -> str:
    return f"holds the hidden or control character U+{ord(sign):04X}"
