"""Settings as a station holds them when it comes from the factory: by the family's table, `protocol/commands/defaults.py`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import TypeVar

from jbclog.protocol.commands.defaults import Default, values_of

T = TypeVar("T")


def fresh(kind: type[T], defaults: Iterable[Default], model: str = "") -> T:
    """A dataclass of settings, whose fields are named for their commands."""
    values = values_of(defaults, model)
    return kind(**{one.name: values[one.name] for one in fields(kind)})  # type: ignore[arg-type]  # a dataclass, as all settings are
