"""Kinds of values in a recipe: what TOML holds, and the typed value that the station's tables know.

Each is a check of type only; ranges are the command tables' and stand in `recipe_checks.py`.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, PlainValidator

from jbclog.config.schema import FromList, said, shown, unknown
from jbclog.core.quantities import OFF, Off
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega_values import CONDITIONS, is_condition

FIVE_DIGITS: Final = "as far as five digits go; no manual prints a range"
TENTHS: Final = "0 to 409.5 in steps of 0.1"
AUTO: Final = "auto"
RATES: Final = f'Hz, from 0.001 to 1000, or "{AUTO}"'
METADATA: Final = ("operator", "order", "product", "unit", "wire_lot", "flux_lot", "tip")


def _minutes(value: object) -> int | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f'{shown(value)} is not allowed; whole minutes, or "off"')
    return value


def _seconds(value: object) -> float | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise said(f'{shown(value)} is not allowed; seconds in steps of 0.01, or "off"')
    return float(value)


def _limit(value: object) -> int:
    if value == "off":
        raise said('"off" is not allowed; no manual prints how a limit is taken back: use delay_s = "off"')
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f"{shown(value)} is not allowed; whole °C in steps of 5")
    return value


def _rate(value: object) -> float | str:
    if value == AUTO:
        return AUTO
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.001 <= value <= 1000:
        raise said(f"{shown(value)} is not allowed; {RATES}")
    return float(value)


def _confidence(value: object) -> float | Literal["none"]:
    if value == "none":
        return "none"
    if isinstance(value, float) and value == 0.95:
        return value
    raise ValueError('must be 0.95 or "none"')


def _on_off(value: object) -> str:
    if not isinstance(value, bool):
        raise said(f"{shown(value)} is not allowed; true or false")
    return "on" if value else "off"


def _tenths(value: float) -> float:
    if abs(value * 10 - round(value * 10)) > 1e-6:
        raise said(f"{value} is not allowed; {TENTHS}")
    return round(value, 1)


def _condition(number: int) -> int:
    if not is_condition(number):
        raise said(f"{number} is not allowed; {CONDITIONS}")
    return number


def _family(name: str) -> str:
    if name not in FAMILIES:
        raise said(f"{shown(name)} is {unknown(name, list(FAMILIES))}")
    return name


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    seen: set[str] = set()
    for value in values:
        if value in seen:
            raise said(f"{shown(value)} stands there twice")
        seen.add(value)
    return values


def _metadata(name: str) -> str:
    if name not in METADATA and not name.removeprefix("tag."):
        raise said("a tag's name is missing behind tag.")
    if name not in METADATA and not name.startswith("tag."):
        raise said(f"{shown(name)} is {unknown(name, [*METADATA, 'tag.NAME'])}")
    return name


Minutes = Annotated[int | Off, PlainValidator(_minutes)]
Seconds = Annotated[float | Off, PlainValidator(_seconds)]
LimitC = Annotated[int, PlainValidator(_limit)]
Rate = Annotated[float | str, PlainValidator(_rate)]
Confidence = Annotated[float | Literal["none"], PlainValidator(_confidence)]
Switch = Annotated[str, PlainValidator(_on_off)]
Families = Annotated[tuple[Annotated[str, AfterValidator(_family)], ...], FromList, AfterValidator(_no_repeats)]
Required = Annotated[tuple[Annotated[str, AfterValidator(_metadata)], ...], FromList, AfterValidator(_no_repeats)]
Condition = Annotated[int, AfterValidator(_condition)]
Tenths = Annotated[float, Field(ge=0, le=409.5), AfterValidator(_tenths)]
