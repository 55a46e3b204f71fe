"""Read JSON, and build dataclasses from it."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from jbclog.core.files import Kind, read_regular

T = TypeVar("T")

FIRST_S, LAST_S = 0.0, 7_258_118_400.0  # 1970 to 2200, in seconds: pandas' times end in 2262
LEAST_PERIOD_S, MOST_PERIOD_S = 1e-6, 1e6  # far beyond the limits of `rate_hz`
YEARS: Final = range(1970, 2200)


def json_of(data: bytes | str) -> Any:
    """Parse `data`. Raises ValueError for invalid JSON, which includes NaN and infinity here, and
    for excessive nesting.
    """
    text = data if isinstance(data, str) else data.decode()
    try:
        return _DECODER.decode(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_json(path: Path, kind: Kind) -> Any:
    """Read and parse the file at `path`. Raises OSError or ValueError."""
    return json_of(read_regular(path, kind))


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")


_DECODER: Final = json.JSONDecoder(parse_constant=_no_number)


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
    typed = msgspec.json.Decoder(kind)

    def decode(data: bytes) -> T:
        try:
            return typed.decode(data)
        except RecursionError:
            raise ValueError("it is nested too deeply") from None

    return decode
