"""A recipe: what a job asks of stations, how it is sampled, and what it is judged by. Unchangeable.

Its tables are in `recipe_sections.py`; ranges and what belongs together are checked in `load_recipe.py`, because those are the
families'. `asked(port)` is what one port is to hold, the port's own tables before the common ones.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from pydantic import Field

from jbclog.config.recipe_sections import PortSettings, RecipeTables
from jbclog.config.schema import Table
from jbclog.config.toml_keys import KeyPath
from jbclog.config.toml_reader import TomlText
from jbclog.core.errors import Problem
from jbclog.core.quantities import Value
from jbclog.protocol.commands.family import FAMILIES, Family

USUAL_HZ = 10.0
PORTS = (1, 2, 3, 4)  # that any station can have
NO_SAFE_STATE = "none"
"""What a family has that no order makes safe (omega)."""


class Asked(NamedTuple):
    """One value that the recipe asks for: the setting's key, where it stands in the file, and the value."""

    setting: str  # "alarm.high.limit_c", whichever table it comes from
    key: KeyPath  # ("port", "2", "alarm", "high", "limit_c")
    value: Value


def asked_in(table: Table, at: KeyPath = ()) -> Iterator[Asked]:
    """Every value that is given in a table of settings and below, in the schema's order."""
    for name in type(table).model_fields:
        value = getattr(table, name)
        if isinstance(value, Table):
            yield from asked_in(value, (*at, name))
        elif value is not None:
            key = (*at, name)
            yield Asked(".".join(map(str, key[2:] if at[:1] == ("port",) else key)), key, value)


class Recipe(RecipeTables):
    """A recipe that has been read and checked, with the text it was read from."""

    source: TomlText = Field(repr=False)

    @property
    def name(self) -> str:
        return self.recipe.name

    @property
    def revision(self) -> int:
        return self.recipe.revision

    @property
    def families(self) -> tuple[str, ...]:
        return self.recipe.families

    @property
    def path(self) -> Path:
        return Path(self.source.file)

    @property
    def text(self) -> str:
        """The file's text: ``text.encode()`` are its very bytes."""
        return self.source.text

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()

    def ports_named(self) -> tuple[int, ...]:
        """The ports that have tables of their own."""
        return tuple(sorted(int(name) for name in self.port))

    def asked(self, port: int | None = None) -> dict[str, Asked]:
        """What the port is asked to hold, by setting (``"alarm.high.limit_c"``); its own tables win.

        Without a port: what a port without tables of its own is asked to hold.
        """
        common = PortSettings(**{name: getattr(self, name) for name in PortSettings.model_fields})
        own = self.asked_of(port) if port is not None else ()
        return {asked.setting: asked for asked in (*asked_in(common), *own)}

    def asked_of(self, port: int) -> Iterator[Asked]:
        """What the port's own tables ask for."""
        for name, table in self.port.items():
            if int(name) == port:
                yield from asked_in(table, ("port", name))

    def heated_ports(self) -> frozenset[int]:
        """The ports whose temperature it sets, of those that any station can have."""
        if self.air.temperature_c is not None:
            return frozenset(PORTS)
        return frozenset(port for port in PORTS if "temperature.select_c" in self.asked(port))

    def safe_state(self, family: str) -> str:
        """What every touched tool is put in at the end on a station of this family (docs/reference/safe-states.md)."""
        known = FAMILIES.get(family)
        if "safe_state" in self.run.model_fields_set or known is None:
            return self.run.safe_state
        return known.safe_states[0] if known.safe_states else NO_SAFE_STATE

    def asked_rate(self, family: Family | None) -> float | str:
        """How often the fast signals are to be read: Hz, or ``auto``; where the recipe does not say, as usual for the family."""
        return self.sampling.rate_hz or self._usual_hz(family)

    @property
    def suction(self) -> str:
        """What becomes of a hot air station's suction at the start: ``keep``, ``on`` or ``off``."""
        return self.air.suction or "keep"

    def rate_hz(self, family: Family | None) -> float:
        """How often they are to be read at the most: the recipe's number, or what is usual for the family (None: for most)."""
        asked = self.sampling.rate_hz
        return asked if isinstance(asked, float) else self._usual_hz(family)

    @staticmethod
    def _usual_hz(family: Family | None) -> float:
        return USUAL_HZ if family is None else family.rate_hz

    def problem(self, key: KeyPath, text: str) -> Problem:
        """Something that is wrong with one of the recipe's keys, with file and line."""
        return self.source.problem(key, text)
