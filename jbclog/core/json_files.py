"""Read untrusted JSON within limits, and build dataclasses from it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from jbclog.core.files import Kind, read_regular
from jbclog.core.quantities import LARGEST, WHOLE

T = TypeVar("T")

# Python's JSON accepts NaN, infinity and numbers of any length; here a number is finite and at most
# `LARGEST`
MOST_OBJECTS: Final = 400_000  # and lists; an empty one takes three bytes in the file, 64 in memory
# a recorder's files have at most one in 25 bytes; one of three bytes takes 30 in memory
MOST_VALUES: Final = 1_400_000
LONGEST: Final = 20  # digits
FIRST_S, LAST_S = 0.0, 7_258_118_400.0  # 1970 to 2200, in seconds: pandas' times end in 2262
LEAST_PERIOD_S, MOST_PERIOD_S = 1e-6, 1e6  # far beyond the limits of `rate_hz`
YEARS: Final = range(1970, 2200)


def json_of(data: bytes | str, *, in_utf8: bool = False) -> Any:
    """Parse `data`. Raises ValueError for invalid JSON, excessive nesting, or a number out of
    range.

    `in_utf8`: the writer used no escapes, so half a surrogate pair is invalid.
    """
    text = data if isinstance(data, str) else data.decode()
    if text.count("{") + text.count("[") > MOST_OBJECTS:
        raise ValueError(f"it has more than {MOST_OBJECTS} objects and lists")
    if text.count(",") > MOST_VALUES:
        raise ValueError(f"it has more than {MOST_VALUES} values")
    try:
        parsed = (_CAREFUL if _is_doubtful(text.encode(errors="surrogatepass")) else _PLAIN).decode(
            text
        )
        if in_utf8 and _HALF.search(text):
            json.dumps(parsed, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return parsed


def read_json(path: Path, kind: Kind, *, in_utf8: bool = False) -> Any:
    """Read and parse the file at `path`. Raises OSError or ValueError."""
    return json_of(read_regular(path, kind), in_utf8=in_utf8)


def _whole(text: str) -> int:
    if len(text) > LONGEST or not -WHOLE <= (number := int(text)) <= WHOLE:
        raise ValueError(f"{text[:LONGEST]}… is too large a number")
    return number


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number) or abs(number) > LARGEST:
        raise ValueError(f"{text[:LONGEST]} is too large a number")
    return number


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")


_PLAIN: Final = json.JSONDecoder(parse_constant=_no_number)
# three times slower than `_PLAIN`
_CAREFUL: Final = json.JSONDecoder(parse_int=_whole, parse_float=_finite, parse_constant=_no_number)


def _has_few(data: bytes) -> bool:
    """Return True if `data` is within `json_of`'s limits for objects and values."""
    return len(data) <= MOST_OBJECTS or (
        data.count(b"{") + data.count(b"[") <= MOST_OBJECTS and data.count(b",") <= MOST_VALUES
    )


_SHAPES: Final = bytes.maketrans(b"123456789E \t\r\n:,[", b"000000000e" + b" " * 7)
_MANY_DIGITS: Final = b"0" * 19
_EXPONENT: Final = re.compile(rb"0e\+?0")  # begins with plain text, which `re` finds fast
_LONGEST_BEFORE: Final = 40  # of a number without `_MANY_DIGITS`, before its exponent


def _is_doubtful(data: bytes) -> bool:
    """Return True if it may contain a large number: many digits, or an exponent preceded only by
    digits, unlike in most hashes.
    """
    shapes = data.translate(_SHAPES)
    if _MANY_DIGITS in shapes:
        return True
    exponents = (found.start() for found in _EXPONENT.finditer(shapes))
    before = (shapes[max(at + 1 - _LONGEST_BEFORE, 0) : at + 1].rstrip(b"0.") for at in exponents)
    return any(not text or text.endswith((b" ", b"-")) for text in before)


_HALF: Final = re.compile(r"\\u[dD][89a-fA-F]")
"""Escape of half a surrogate pair, invalid without the other half."""


def expect_moment(seconds: float | None) -> None:
    """Raise ValueError unless `seconds` since 1970 are within 1970 to 2200; None passes."""
    if seconds is not None and not FIRST_S <= seconds < LAST_S:
        raise ValueError(f"{seconds:g} s is no time between {YEARS[0]} and {YEARS[-1]}")


def expect_period(seconds: float | None) -> None:
    """Raise ValueError unless `seconds` can be a sampling period; None is a run without a fixed
    rate.
    """
    if seconds is not None and not LEAST_PERIOD_S <= seconds <= MOST_PERIOD_S:
        raise ValueError(
            f"{seconds:g} s is no sampling period ({LEAST_PERIOD_S:g} to {MOST_PERIOD_S:g} s)"
        )


def expect_year(year: int) -> None:
    """Raise ValueError for a year out of range."""
    if year not in YEARS:
        raise ValueError(f"{year} is no year between {YEARS[0]} and {YEARS[-1]}")


def expect_time(text: str | None) -> None:
    """Raise ValueError for a text that is no time in range, or has no time zone and so cannot be
    compared.
    """
    if text is None:
        return
    moment = datetime.fromisoformat(text)
    expect_year(moment.year)
    if moment.tzinfo is None:
        raise ValueError(f"{text!r:.60} does not say which zone it is of")


def builder(kind: type[T]) -> Callable[[object], T]:
    """Return a converter from parsed JSON to `kind`, which raises ValueError naming the key. Call
    this at import only.

    Ignores unknown keys: a later jbclog of the same schema may have added them. Keys of `dict[int,
    ...]` are digits in JSON.
    """
    # describe the type now: two threads that describe it at first use crash the process
    msgspec.json.Decoder(kind)

    def build(data: object) -> T:
        return msgspec.convert(data, kind, str_keys=True)

    return build


def decoder(kind: type[T]) -> Callable[[bytes], T]:
    """Return a decoder of UTF-8 JSON to `kind`: as `builder` after `json_of`, without the cost of
    unknown keys. It raises ValueError.

    Call this at import only.
    """
    build, typed = builder(kind), msgspec.json.Decoder(kind)

    @lru_cache(maxsize=1)  # a command reads the same manifest several times
    def careful(data: bytes) -> T:
        return build(json_of(data, in_utf8=True))

    def decode(data: bytes) -> T:
        if _has_few(data) and b"\\u" not in data and not _is_doubtful(data):
            # then `json_of` accepts it, or says what is wrong
            with suppress(ValueError, RecursionError):
                data.decode()
                return typed.decode(data)
        return careful(data)

    return decode
