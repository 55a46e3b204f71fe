"""What is taken from a station beside the recommended form, by command name; each with its row of
docs/reference/contradictions.md.

Nothing of this is ever sent by itself, but for R-TT with a blank and orders without data, once the station has refused the
recommended form.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class OddForm:
    """Data fields that mean something and are not what the manuals recommend; `data` matches the whole field."""

    number: int
    data: re.Pattern[str]


def _odd(number: int, pattern: str) -> OddForm:
    return OddForm(number, re.compile(pattern, re.ASCII))


_NO_DOT = _odd(22, r"0\d{4}")
_NO_LIMIT = _odd(23, r"00000|(?!99999|00600|00[0-5]\d\d)\d{5}")

ODD_FORMS: Mapping[str, OddForm] = MappingProxyType(
    {
        "adjust": _odd(3, r"\.\d{4}"),
        "software_version": _odd(5, r"(?!.{5}$).*"),
        "alarm_high_delay": _NO_DOT,
        "alarm_low_delay": _NO_DOT,
        "alarm_high_limit": _NO_LIMIT,
        "alarm_low_limit": _NO_LIMIT,
        "alarm_flags": _odd(24, r"000(?![01]{2})\d\d"),
        "time_to_sleep": _odd(25, r"65535"),
        "port_error": _odd(28, r"80000"),
        "power": _odd(32, r"(?!00\d{3}|01000)\d{5}"),
        "model": _odd(34, r"(?!.{5}$).*|.* |UCR24|UCR47"),
        "selected_air_flow": _odd(33, r".*"),  # whose unit nothing decides: always marked
        "dispensed_length": _odd(35, r"(?![0-9A-F]{5}$).*|(?!0000\d)\d{5}"),
    }
)
"""Which data fields of which answer are odd."""

READ_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType({"dispensed_cycles": (36, "CD")})
"""Reads that may be answered under the letters of another, with those letters."""

WRITE_ANSWERED_AS: Mapping[str, tuple[int, str]] = MappingProxyType({"alarm_high_delay": (53, "LD")})
"""Writes that may be acknowledged under the letters of another."""

ACKNOWLEDGED_WITH_VALUE: Mapping[str, int] = MappingProxyType({"status": 43})
"""Writes whose acknowledgement may repeat the value."""

WITHOUT_DATA: Mapping[str, int] = MappingProxyType({"stop_feeding": 37, "ignore_fuse_error": 37})
"""Orders that may be sent without data once 00000 was badly formed; those that act or erase are not among them."""


def odd_form(command: str, data: str) -> int | None:
    """The B-number by which the data field of an answer to `command` is odd; None where it is as recommended."""
    form = ODD_FORMS.get(command)
    return form.number if form is not None and form.data.fullmatch(data) else None
