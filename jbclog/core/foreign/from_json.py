"""JSON into dataclasses, by their type hints; what does not fit is said with its key."""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Union, cast, get_args, get_origin, get_type_hints

from jbclog.core.foreign.numbers import LARGEST


class Misfit(Exception):
    """Something that is not what its type hint says."""


def build(hint: object, data: object, key: str = "") -> object:
    """`data` as the type `hint`: dataclasses, lists, tuples, dictionaries, unions and plain values. Raises `Misfit`.

    Keys that the dataclass does not have are left out: a later jbclog of the same schema may have added them.
    """
    if type(data) is hint:  # most are plain
        return data
    if is_dataclass(hint) and isinstance(hint, type):
        return _dataclass(hint, data, key)
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _first_that_fits(inside, data, key)
    if origin in (list, tuple) and isinstance(data, list):  # of tuples those of any length: tuple[int, ...]
        return origin(build(inside[0], item, f"{key}[{place}]") for place, item in enumerate(data))
    if origin is dict and isinstance(data, dict):
        return {_key(inside[0], name, key): build(inside[1], item, f"{key}.{name}") for name, item in data.items()}
    if hint is float and type(data) is int and abs(data) <= LARGEST:
        return float(data)
    if hint is object:
        return data
    raise Misfit(f"{key}: {data!r:.60} does not belong there")


def _dataclass(hint: type, data: object, key: str) -> object:
    if not isinstance(data, dict):
        raise Misfit(f"{key or hint.__name__}: not an object")
    hints, made = _hints(hint), {}
    for one in fields(hint):
        if one.name in data:
            made[one.name] = build(hints[one.name], data[one.name], f"{key}.{one.name}".lstrip("."))
        elif one.default is MISSING and one.default_factory is MISSING:
            raise Misfit(f"{key or hint.__name__}: {one.name} is missing")
    return cast(Callable[..., object], hint)(**made)


@cache
def _hints(hint: type) -> dict[str, object]:
    """Which take longer to find out than all the rest."""
    return get_type_hints(hint)


def _first_that_fits(hints: tuple[object, ...], data: object, key: str) -> object:
    for hint in hints:
        try:
            return build(hint, data, key)
        except Misfit:
            continue
    raise Misfit(f"{key}: {data!r:.60} does not belong there")


def _key(hint: object, name: str, key: str) -> str | int:
    if hint is int:
        try:
            return int(name)
        except ValueError:
            raise Misfit(f"{key}: {name!r} is not a number") from None
    return name
