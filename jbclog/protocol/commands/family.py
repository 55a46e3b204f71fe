"""Families of stations, found by their model names. Start with `Family`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from jbclog.protocol.commands import hotair, omega, robot
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.defaults import AIR_DEFAULTS, FEEDER_DEFAULTS, OLD_DEFAULTS, SOLDERING_DEFAULTS, UCR_DEFAULTS, Default
from jbclog.protocol.commands.robot import ErrorTable
from jbclog.protocol.commands.signals import (
    DISPENSING_COUNTERS,
    FEEDER_COUNTERS,
    FEEDER_SIGNALS,
    HOUR_COUNTERS,
    SOLDERING_SIGNALS,
    Counter,
    Signal,
)
from jbclog.protocol.commands.status import NO_STATUS, SOLDERING_STATUS, StatusTable

# -- family -------------------------------------------------------------------------------------------------------------------

_MODEL = re.compile(r"[A-Za-z]+[A-Za-z0-9 _.-]*")
ROBOT, OMEGA = "robot", "omega"
"""Protocols: JBC's Robot mode, and OMEGA's own."""

NEEDS_A_TOOL = frozenset({"temperature_c", "power_permille", "delay_s"})
"""Signals that mean nothing while there is no tool."""
NO_TOOL = "no_tool"


def _by_name(commands: Iterable[Command]) -> Mapping[str, Command]:
    return MappingProxyType({command.name: command for command in commands})


@dataclass(frozen=True, slots=True)
class Family:
    """One family of control units. All of its tables are read-only data.

    `models` are the beginnings of model names that prove the family. `ports` is None where the manual
    does not say how many there are: then those that answer R-CT are meant. The first of `safe_states` is the usual one;
    those in `proven_by_cooling` count only when the tool is seen to cool. `harmless` are reads that change nothing, with
    which the turnaround is measured; `answered_by_kind` are reads whose letters only soldering stations, or only hot air, have:
    with them a family is borne out where the model name cannot prove it. `plausible_c` are temperatures that its tools can
    have, and `jump_c` is more than they change from one tick to the next. `defaults` are what a station of it holds fresh from
    the factory.

    Where `models` is empty the station does not say what it is; where `tools` is, it does not say what is connected.
    `protocol` is how it is spoken to, `baudrate` and `rate_hz` are what holds where a file names none, and `turnaround_ms` is
    what its manual prints of it, from least to most.
    `hot_part` is what its temperature is the temperature of, in messages.
    """

    name: str
    title: str
    models: tuple[str, ...]
    commands: Mapping[str, Command]
    ports: tuple[int, ...] | None
    tools: Mapping[int, str]
    status: StatusTable = SOLDERING_STATUS
    safe_states: tuple[str, ...] = ("stand",)
    proven_by_cooling: frozenset[str] = frozenset({"extractor"})
    run_statuses: tuple[str, ...] = ("working", "stand")
    signals: tuple[Signal, ...] = SOLDERING_SIGNALS
    counters: tuple[Counter, ...] = HOUR_COUNTERS
    harmless: tuple[str, ...] = ("station_error", "tip_temperature")
    answered_by_kind: tuple[str, ...] = ("tip_temperature", "transistor_temperature")
    port_errors: ErrorTable = robot.PORT_ERRORS
    station_errors: ErrorTable = robot.STATION_ERRORS
    plausible_c: range = range(601)  # no unit is made for more than 500 °C (manual 002, factory settings)
    jump_c: int = 50  # the quickest cartridges make little more in half a second
    hot_part: str = "tip"
    has_feeder: bool = False
    defaults: tuple[Default, ...] = SOLDERING_DEFAULTS
    note: str = ""
    manual: str = "002"
    protocol: str = ROBOT
    baudrate: int = 19200
    rate_hz: float = 10.0
    turnaround_ms: tuple[float, float] | None = None

    def may_stand_at_last(self, safe_state: str) -> bool:
        """Whether a tool whose safe state is `safe_state` may end in stand, which cools by the station's own delays only."""
        return safe_state == "stand" or (safe_state in self.proven_by_cooling and "stand" in self.status.last_resorts)

    def tool_name(self, code: int) -> str:
        """The tool's name; an unknown code is kept as ``tool_<n>``."""
        return self.tools.get(code, f"tool_{code}")

    def command_of(self, signal: str) -> Command | None:
        """The command that fills the columns of `signal` (``temperature_c``, ``set_c``); None where it has none."""
        return next((self.commands[one.command] for one in self.signals if one.name == signal), None)

    def is_empty(self, tool: int | None, error: int | None) -> bool:
        """Whether a port has no tool, by what it last said of its tool and its error; None is what it did not say."""
        return bool(self.tools) and (tool == 0 or (error is not None and error == self.port_errors.no_tool))

    def void(self, signal: str, tool: int | None, error: int | None) -> str | None:
        """Why what a port says as `signal` means nothing, as the word in the record; None where it counts.

        docs/reference/contradictions.md, B-44.
        """
        if signal in NEEDS_A_TOOL and self.is_empty(tool, error):
            return NO_TOOL
        return self.port_errors.void(error, signal)

    def may_be_void(self, signal: str | None) -> bool:
        """Whether there is anything for which `void` would say that `signal` means nothing."""
        return signal in NEEDS_A_TOOL or any(name == signal for _, name, _ in self.port_errors.voids)

    def signal_of(self, command: str) -> str | None:
        """The signal that `command` fills; None where it fills none."""
        return next((one.name for one in self.signals if one.command == command), None)

    @property
    def hours(self) -> str | None:
        """The command that counts the hours since the station was made; None where there is none."""
        return self.counters[0].command if self.counters else None

    def proves(self, model: str) -> bool:
        """Whether a station that calls itself `model` is of this family. A name has letters and digits, nothing else odd."""
        return bool(_MODEL.fullmatch(model)) and model.upper().startswith(self.models)


STAND_OR_EXTRACTOR = ("stand", "extractor")
RUN_STATUSES_002 = ("working", *STAND_OR_EXTRACTOR)
"""Manual 002 prints 00010 for W-PSx without a limit of family."""

_BENCH = _by_name(robot.BENCH)
_OLD = _by_name(robot.OLD)
_UCR = _by_name((*robot.BENCH, *robot.UCR, *robot.DISPENSED))
_ALE = _by_name((*robot.BENCH, *robot.FEEDER, *robot.DISPENSED))


def _bench(name: str, title: str, ports: tuple[int, ...] | None) -> Family:
    return Family(
        name,
        title,
        (name.upper(),),
        _BENCH,
        ports,
        robot.TOOLS_002,
        safe_states=STAND_OR_EXTRACTOR,
        run_statuses=RUN_STATUSES_002,
    )


FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        family.name: family
        for family in (
            Family(
                "soldering",
                "older soldering stations (manual 000)",
                # 000 prints "DDR" alone. The others are inferred, and whole: two letters would also take DDE for one of these
                ("DDR", "DIR", "CDR", "HDR", "NAR", "DMR"),
                _OLD,
                None,
                robot.TOOLS_000,
                defaults=OLD_DEFAULTS,
                note="Its manual prints one model name, DDR; the others are inferred from it and from the newer units' names.",
                manual="000",
            ),
            _bench("dde", "DDE 2-tool control unit", (1, 2)),
            _bench("nae", "NAE 2-tool nano control unit", (1, 2)),
            _bench("dme", "DME 4-tool control unit", (1, 2, 3, 4)),
            _bench("hde", "HDE heavy-duty control unit", None),
            Family(
                "ucr",
                "UCR control unit for robots (UCR245, UCR470)",
                ("UCR",),
                _UCR,
                (1,),
                robot.TOOLS_004,
                safe_states=STAND_OR_EXTRACTOR,
                run_statuses=RUN_STATUSES_002,
                counters=(*HOUR_COUNTERS, *DISPENSING_COUNTERS),
                defaults=UCR_DEFAULTS,
                manual="004, 002",
            ),
            Family(
                "ale",
                "ALE automatic-feed control unit",
                ("ALE",),
                _ALE,
                (1,),
                robot.TOOLS_002,
                safe_states=STAND_OR_EXTRACTOR,
                run_statuses=RUN_STATUSES_002,
                signals=FEEDER_SIGNALS,
                counters=(*HOUR_COUNTERS, *FEEDER_COUNTERS),
                has_feeder=True,
                defaults=(*SOLDERING_DEFAULTS, *FEEDER_DEFAULTS),
            ),
            Family(
                "jtse",
                "JTSE hot air station",
                ("JT",),
                _by_name(hotair.HOT_AIR),
                (1,),
                hotair.TOOLS,
                status=hotair.AIR_STATUS,
                safe_states=("cooling", "off"),
                proven_by_cooling=frozenset(),  # 001 4.6 prints that the heater is off in both
                run_statuses=("on", "off"),
                signals=hotair.AIR_SIGNALS,
                counters=hotair.AIR_COUNTERS,
                harmless=("station_error", "air_temperature"),
                answered_by_kind=("air_temperature", "maximum_air_flow"),
                port_errors=hotair.PORT_ERRORS,
                station_errors=hotair.STATION_ERRORS,
                hot_part="air",
                defaults=AIR_DEFAULTS,
                manual="001",
            ),
            Family(
                "omega",
                "Apollo Seiko OMEGA soldering controller",
                (),
                _by_name(omega.OMEGA),
                (1,),
                {},
                status=NO_STATUS,
                safe_states=(),
                proven_by_cooling=frozenset(),
                run_statuses=(),
                signals=omega.OMEGA_SIGNALS,
                counters=(),
                harmless=("information", "temperature_control", "set_temperature_state"),
                answered_by_kind=(),
                port_errors=omega.NO_ERRORS,
                station_errors=omega.NO_ERRORS,
                defaults=(),
                manual="003",
                protocol=OMEGA,
                baudrate=9600,
                rate_hz=1.0,
                turnaround_ms=(0.0, 250.0),  # 003 11.1
            ),
        )
    }
)


def family_of(model: str) -> Family | None:
    """The family that a model name proves, newest tables first; None where none knows it."""
    named = [family for family in FAMILIES.values() if family.name != "soldering" and family.proves(model)]
    if named:
        return named[0]
    return FAMILIES["soldering"] if FAMILIES["soldering"].proves(model) else None


# -- models -------------------------------------------------------------------------------------------------------------------
# Model names: which the line file may accept, and what it must say where no table knows one.
#
# The manuals print two names, DDR (000) and JTSE (001); every other in `Family.models` is inferred. A station that calls itself
# anything else is driven as the line file says with its key `model`, within these bounds: status 00001 is "stand" for a soldering
# tool and "on" for hot air, so a name never makes a soldering station of a hot air station, nor the reverse.

HOT_AIR: Final = "JT"
"""How the model names of hot air stations begin (001, 4.9.18)."""


def model_problem(family: Family, model: str) -> str | None:
    """Why a station that calls itself `model` cannot be driven as `family`, or None."""
    if not family.models:
        return f"a station of family {family.name} does not say a model; leave it out"
    is_hot_air, named_so = family.models == (HOT_AIR,), model.upper().startswith(HOT_AIR)
    if named_so and not is_hot_air:
        return f'"{model}" begins with {HOT_AIR}: it is a hot air station, which status 00001 switches on, and no {family.name}'
    if is_hot_air and not named_so:
        return f'"{model}" does not begin with {HOT_AIR}, as the model names of hot air stations do: it is no {family.name}'
    return None


def foreign_reads(family: Family) -> Iterator[Command]:
    """Reads that only stations of another kind than this family's answer."""
    kinds = {one.answered_by_kind: one for one in FAMILIES.values() if one.protocol != OMEGA}
    for names, one in kinds.items():
        if names != family.answered_by_kind:
            yield from (one.commands[name] for name in names)


def accept_line(model: str) -> str:
    """The line of a line file that accepts this name: ``model = "DIE"``."""
    return f'model = "{model}"'


def unknown_model(model: str) -> str:
    """What to write where the family is to be learnt from a name that no table has."""
    return (
        f"it says model {model!r}, which no table has. If you know what it is, name its family in the line file in place of "
        f'"auto", and add {accept_line(model)}'
    )


def other_model(family: Family, model: str) -> str:
    """What to write where the line file's family is not the one that the name proves."""
    told = f"the line file says family {family.name}, the station says model {model}; nothing was written to it. "
    known = family_of(model)
    if model_problem(family, model) is not None:
        right = f' (family = "{known.name}")' if known is not None else ""
        return f"{told}Correct `family`{right}, or the cable"
    return f"{told}Correct `family`, or the cable; if it is a {family.name}, add {accept_line(model)}"


def not_accepted(accepted: str, model: str) -> str:
    """That the station's name is not the one that the line file accepts."""
    return f"the line file accepts model {accepted}, the station says model {model}"
