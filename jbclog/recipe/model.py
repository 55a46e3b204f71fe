"""A recipe: what a job asks of stations, how it is sampled, and what it is judged by. Unchangeable.

Each table of the file is a class here, each key a field; a setting that the file does not name is None and is
left alone. Types are checked here, ranges and what belongs together in `checks.py`, because those are the
families'. `asked(port)` is what one port is to hold, the port's own tables before the common ones.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import AfterValidator, Field, PlainValidator

from jbclog.commands.family import FAMILIES
from jbclog.errors import Problem
from jbclog.quantities import OFF, Off, Value
from jbclog.recipe.keys import KeyPath
from jbclog.recipe.schema import NAME_ALLOWED, FromList, Name, Table, said, shown, unknown
from jbclog.recipe.toml import TomlText

NOT_DRIVEN: Final = ("jtse", "omega")
"""Families that files may name and that this version does not drive."""

KNOWN_FAMILIES: Final = (*FAMILIES, *NOT_DRIVEN)
_FIVE_DIGITS: Final = "as far as five digits go; no manual prints a range"
_TENTHS: Final = "0 to 409.5 in steps of 0.1"
_CONDITIONS: Final = "101 to 199, 201 to 299 or 301 to 399"
METADATA: Final = ("operator", "order", "product", "unit")


def _minutes(value: object) -> int | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f'{shown(value)} is not allowed; whole minutes, or "off"')
    return value


def _seconds(value: object) -> float | Off:
    if value == "off":
        return OFF
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise said(f'{shown(value)} is not allowed; seconds in steps of 0.01, or "off"')
    return float(value)


def _limit(value: object) -> int:
    if value == "off":
        raise said('"off" is not allowed; no manual prints how a limit is taken back: use delay_s = "off"')
    if isinstance(value, bool) or not isinstance(value, int):
        raise said(f"{shown(value)} is not allowed; whole °C in steps of 5")
    return value


def _on_off(value: object) -> str:
    if not isinstance(value, bool):
        raise said(f"{shown(value)} is not allowed; true or false")
    return "on" if value else "off"


def _tenths(value: float) -> float:
    if abs(value * 10 - round(value * 10)) > 1e-6:
        raise said(f"{value} is not allowed; {_TENTHS}")
    return round(value, 1)


def _condition(number: int) -> int:
    if number // 100 not in (1, 2, 3) or number % 100 == 0:
        raise said(f"{number} is not allowed; {_CONDITIONS}")
    return number


def _family(name: str) -> str:
    if name not in KNOWN_FAMILIES:
        raise said(f"{shown(name)} is {unknown(name, list(KNOWN_FAMILIES))}")
    return name


def _no_repeats(values: tuple[str, ...]) -> tuple[str, ...]:
    twice = next((value for place, value in enumerate(values) if value in values[:place]), None)
    if twice is not None:
        raise said(f"{shown(twice)} stands there twice")
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
Switch = Annotated[str, PlainValidator(_on_off)]
Families = Annotated[tuple[Annotated[str, AfterValidator(_family)], ...], FromList, AfterValidator(_no_repeats)]
Required = Annotated[tuple[Annotated[str, AfterValidator(_metadata)], ...], FromList, AfterValidator(_no_repeats)]


class Head(Table):
    name: Name = Field(description=NAME_ALLOWED)
    revision: int = Field(ge=0, le=999_999, description="a whole number from 0 on")
    families: Families = Field(min_length=1, description=f"a list of some of {', '.join(KNOWN_FAMILIES)}")


class Temperature(Table):
    select_c: int | None = Field(None, description="whole °C in steps of 5")
    adjust_c: int | None = Field(None, description="whole °C from -50 to 50")


class Sleep(Table):
    temperature_c: int | None = Field(None, description="whole °C in steps of 5")
    delay_min: Minutes | None = None


class Hibernation(Table):
    delay_min: Minutes | None = None


class Alarm(Table):
    limit_c: LimitC | None = None
    delay_s: Seconds | None = None


class Alarms(Table):
    high: Alarm = Alarm()
    low: Alarm = Alarm()


class PortSettings(Table):
    """The tables that hold for every port of a station, or below `[port.N]` for one."""

    temperature: Temperature = Temperature()
    sleep: Sleep = Sleep()
    hibernation: Hibernation = Hibernation()
    alarm: Alarms = Alarms()


class Feeder(Table):
    mode: Literal["continuous", "discontinuous", "program", "reload"] | None = Field(
        None, description="one of continuous, discontinuous, program, reload"
    )
    length_mm: float | None = Field(None, ge=0, le=9999.9, description=f"mm in steps of 0.1, {_FIVE_DIGITS}")
    speed_mm_s: float | None = Field(None, gt=0, le=9999.9, description=f"mm/s in steps of 0.1, {_FIVE_DIGITS}")
    diameter_mm: float | None = Field(None, gt=0, le=999.99, description=f"mm in steps of 0.01, {_FIVE_DIGITS}")
    backward_mm: float | None = Field(None, ge=0, le=9999.9, description=f"mm in steps of 0.1, {_FIVE_DIGITS}")
    clog_detection: Switch | None = None


class Air(Table):
    """Hot air (jtse), a family that this version does not drive: checked, and kept with the run."""

    temperature_c: int | None = Field(None, description="whole °C")
    flow_permille: int | None = Field(None, ge=0, le=1000, description="0 to 1000, the share of the station's greatest flow")
    external_set_c: int | None = Field(None, description="whole °C")
    mode: Literal["manual", "profile"] | None = Field(None, description="manual or profile")


Tenths = Annotated[float, Field(ge=0, le=409.5), AfterValidator(_tenths)]


class Omega(Table):
    """One solder condition (omega), a family that this version does not drive: its whole record of fifteen fields."""

    condition: Annotated[int, AfterValidator(_condition)] = Field(description=_CONDITIONS)
    mode: int = Field(ge=0, le=4, description="0 to 4: special point, special slide, the same without iron up, pre-solder")
    rise_s: Tenths = Field(description=_TENTHS)
    feed1_mm: Tenths = Field(description=_TENTHS)
    feed1_mm_s: Tenths = Field(description=_TENTHS)
    reverse1_mm: Tenths = Field(description=_TENTHS)
    reverse1_mm_s: Tenths = Field(description=_TENTHS)
    preheat_s: Tenths = Field(description=_TENTHS)
    feed2_mm: Tenths = Field(description=_TENTHS)
    feed2_mm_s: Tenths = Field(description=_TENTHS)
    reverse2_mm: Tenths = Field(description=_TENTHS)
    reverse2_mm_s: Tenths = Field(description=_TENTHS)
    heating_s: Tenths = Field(description=_TENTHS)
    feed3_mm: Tenths = Field(description=_TENTHS)
    feed3_mm_s: Tenths = Field(description=_TENTHS)
    reverse3_mm: Tenths = Field(description=_TENTHS)
    reverse3_mm_s: Tenths = Field(description=_TENTHS)


class Sampling(Table):
    """Hz of the fast signals, and the ceilings of the slow ones in seconds."""

    rate_hz: float = Field(10.0, ge=0.001, le=1000, description="Hz, from 0.001 to 1000")
    alarms_every_s: float = Field(2.0, ge=0.1, le=3600, description="seconds, from 0.1 to 3600")
    counters_every_s: float = Field(60.0, ge=1, le=86400, description="seconds, from 1 to 86400")


class Run(Table):
    """How the run treats the tools. `status` None: not changed at the start. Ask `Recipe.safe_state` for a family's own."""

    status: Literal["working", "stand", "extractor", "on", "off"] | None = Field(
        None, description="working, stand or extractor (jtse: on, off)"
    )
    safe_state: Literal["stand", "extractor", "cooling", "off"] = Field(
        "stand", description="stand or extractor (jtse: cooling, off)"
    )
    require_tool: bool = Field(True, description="true or false")
    on_difference: Literal["stop", "continue"] = Field("stop", description="stop or continue")
    allow_no_cooldown: bool = Field(False, description="true or false")


class Metadata(Table):
    required: Required = Field((), description=f"a list of some of {', '.join(METADATA)}, tag.NAME")


class Acceptance(Table):
    """What the verdict rests on; a rule that is None is not applied."""

    coverage_percent: float | None = Field(None, ge=0, le=100, description="0 to 100")
    longest_gap_s: float | None = Field(None, ge=0, description="seconds from 0 on")
    idle_error_c: float | None = Field(None, ge=0, description="°C from 0 on")
    idle_sd_c: float | None = Field(None, ge=0, description="°C from 0 on")
    alarms_max: int | None = Field(None, ge=0, description="a whole number from 0 on")


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


PortName = Literal["1", "2", "3", "4"]
Ports = Annotated[Mapping[PortName, PortSettings], AfterValidator(MappingProxyType)]


class RecipeTables(PortSettings):
    """The whole file, table by table."""

    recipe: Head
    port: Ports = Field(MappingProxyType({}), description="a port is 1, 2, 3 or 4")
    feeder: Feeder = Feeder()
    air: Air = Air()
    omega: Omega | None = None
    sampling: Sampling = Sampling()
    run: Run = Run()
    metadata: Metadata = Metadata()
    acceptance: Acceptance | None = None


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

    def safe_state(self, family: str) -> str:
        """What every touched tool is put in at the end on a station of this family (contract, "Safe state")."""
        if family == "jtse" and "safe_state" not in self.run.model_fields_set:
            return "cooling"
        return self.run.safe_state

    def problem(self, key: KeyPath, text: str) -> Problem:
        """Something that is wrong with one of the recipe's keys, with file and line."""
        return self.source.problem(key, text)
