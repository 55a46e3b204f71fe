"""Families of stations, recognized by their model names. Start with `Family`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from jbclog.protocol.commands import feeder, hotair, omega, robot
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.defaults import (
    AIR_DEFAULTS,
    FEEDER_DEFAULTS,
    OLD_DEFAULTS,
    SOLDERING_DEFAULTS,
    UCR_DEFAULTS,
    Default,
)
from jbclog.protocol.commands.error_tables import PORT_ERRORS, STATION_ERRORS, ErrorTable
from jbclog.protocol.commands.signals import (
    DISPENSING_COUNTERS,
    FEEDER_COUNTERS,
    FEEDER_SIGNALS,
    HOUR_COUNTERS,
    SOLDERING_SIGNALS,
    ReadInterval,
    Signal,
    UsageCounter,
)
from jbclog.protocol.commands.status import NO_STATUS, SOLDERING_STATUS, StatusTable

_MODEL = re.compile(r"[A-Za-z]+[A-Za-z0-9 _.-]*")
ROBOT, OMEGA = "robot", "omega"
"""Protocols: JBC's Robot mode, and OMEGA's."""

NEEDS_A_TOOL = frozenset({"temperature_c", "power_permille", "delay_s"})
"""Signals that have no meaning without a tool."""
NO_TOOL = "no_tool"


def _by_name(commands: Iterable[Command]) -> Mapping[str, Command]:
    return MappingProxyType({command.name: command for command in commands})


@dataclass(frozen=True, slots=True)
class Family:
    """One family of control units. All tables are read-only.

    `models`: beginnings of model names that prove the family; empty if the station reports no
    model. `ports`: None if the manual does not print their number; then those that answer R-CT.
    `tools`: empty if the station reports none. `safe_states`: the first is the default; those in
    `proven_by_cooling` count only if the tool is seen to cool. `harmless`: reads without effect,
    for measuring the response time. `answered_by_kind`: reads that only soldering stations, or only
    hot air, have; they prove the kind where the model name cannot. `plausible_c`: possible
    temperatures of its tools; `jump_c`: more than they change within a tick. `defaults`: factory
    settings. `baudrate` and `rate_hz` apply if a file sets none; `turnaround_ms` is the printed
    range of the response time. `hot_part`: what the temperature is of, for messages.
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
    counters: tuple[UsageCounter, ...] = HOUR_COUNTERS
    harmless: tuple[str, ...] = ("station_error", "tip_temperature")
    answered_by_kind: tuple[str, ...] = ("tip_temperature", "transistor_temperature")
    port_errors: ErrorTable = PORT_ERRORS
    station_errors: ErrorTable = STATION_ERRORS
    # no unit is made for more than 500 °C (manual 002, factory settings)
    plausible_c: range = range(601)
    jump_c: int = 50  # the fastest cartridges change little more in half a second
    hot_part: str = "tip"
    has_feeder: bool = False
    defaults: tuple[Default, ...] = SOLDERING_DEFAULTS
    note: str = ""
    manual: str = "002"
    protocol: str = ROBOT
    baudrate: int = 19200
    rate_hz: float = 10.0
    turnaround_ms: tuple[float, float] | None = None
    _of_signal: Mapping[str, Command] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        of_signal = {
            signal.name: self.commands[signal.command] for signal in reversed(self.signals)
        }
        object.__setattr__(self, "_of_signal", of_signal)  # looked up at nearly every exchange

    def may_stand_at_last(self, safe_state: str) -> bool:
        """Return True if a tool with this safe state may end in stand, where it cools only by the
        station's own delays.
        """
        return safe_state == "stand" or (
            safe_state in self.proven_by_cooling and "stand" in self.status.last_resorts
        )

    def tool_name(self, code: int) -> str:
        """Return the tool's name; ``tool_<n>`` for an unknown code."""
        return self.tools.get(code, f"tool_{code}")

    def command_of(self, signal: str) -> Command | None:
        """Return the command that fills the columns of `signal` (``temperature_c``,
        ``setpoint_c``); None if there is none.
        """
        return self._of_signal.get(signal)

    def is_empty(self, tool: int | None, error: int | None) -> bool:
        """Return True if a port has no tool, by its last tool code and error (None: not known)."""
        return bool(self.tools) and (
            tool == 0 or (error is not None and error == self.port_errors.no_tool)
        )

    def void(self, signal: str, tool: int | None, error: int | None) -> str | None:
        """Return why a port's `signal` has no meaning; None if it has one.

        See docs/reference/contradictions.md, B-44.
        """
        if signal in NEEDS_A_TOOL and self.is_empty(tool, error):
            return NO_TOOL
        return self.port_errors.void(error, signal)

    def may_be_void(self, signal: str | None) -> bool:
        """Return True if `void` can ever return a reason for `signal`."""
        return signal in NEEDS_A_TOOL or any(
            name == signal for _, name, _ in self.port_errors.voids
        )

    def signal_of(self, command: str) -> str | None:
        """Return the signal that `command` fills; None if there is none."""
        return next((signal.name for signal in self.signals if signal.command == command), None)

    def is_fast(self, command: str) -> bool:
        """Return True if `command` fills a signal that is read on every tick."""
        return any(
            signal.command == command and signal.interval is ReadInterval.FAST
            for signal in self.signals
        )

    @property
    def hours(self) -> str | None:
        """The command that counts the hours since manufacture; None if there is none."""
        return self.counters[0].command if self.counters else None

    def proves(self, model: str) -> bool:
        """Return True if the model name `model` proves this family. A valid name has only letters,
        digits and a few separators.
        """
        return bool(_MODEL.fullmatch(model)) and model.upper().startswith(self.models)


STAND_OR_EXTRACTOR = ("stand", "extractor")
RUN_STATUSES_002 = ("working", *STAND_OR_EXTRACTOR)
"""Manual 002 prints 00010 for W-PSx without restriction to a family."""

_BENCH = _by_name(robot.BENCH)
_OLD = _by_name(robot.OLD)
_UCR = _by_name((*robot.BENCH, *robot.UCR, *feeder.DISPENSED))
_ALE = _by_name((*robot.BENCH, *feeder.FEEDER, *feeder.DISPENSED))


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
                # 000 prints only "DDR". The others are inferred, as whole names: two letters would
                # also match DDE
                ("DDR", "DIR", "CDR", "HDR", "NAR", "DMR"),
                _OLD,
                None,
                robot.TOOLS_000,
                defaults=OLD_DEFAULTS,
                note=(
                    "Its manual prints one model name, DDR; DIR, CDR, NAR and DMR are inferred from"
                    " it and from the newer units' names, and are in no public source. A DDR has"
                    " two ports and an HDR one (USB sources); which ports there are, R-CT decides."
                ),
                manual="000",
            ),
            _bench("dde", "DDE 2-tool control unit", (1, 2)),
            _bench("nae", "NAE 2-tool nano control unit", (1, 2)),
            _bench("dme", "DME 4-tool control unit", (1, 2, 3, 4)),
            # one port by USB sources (docs/reference/manuals.md); no manual prints it: R-CT decides
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
    """Return the family that a model name proves, newest tables first; None if there is none."""
    named = [
        family
        for family in FAMILIES.values()
        if family.name != "soldering" and family.proves(model)
    ]
    if named:
        return named[0]
    return FAMILIES["soldering"] if FAMILIES["soldering"].proves(model) else None


# The manuals print two model names, DDR (000) and JTSE (001); all others in `Family.models` are
# inferred. The line file's key `model` accepts another name, with one restriction: status 00001 is
# "stand" for a soldering tool and "on" for hot air, so a name never turns a hot air station into a
# soldering station, or the reverse.

HOT_AIR: Final = "JT"
"""Beginning of the model names of hot air stations (001, 4.9.18)."""


def model_problem(family: Family, model: str) -> str | None:
    """Describe why a station named `model` cannot be driven as `family`; None if it can."""
    if not family.models:
        return f"a station of family {family.name} reports no model; leave it out"
    is_hot_air, named_so = family.models == (HOT_AIR,), model.upper().startswith(HOT_AIR)
    if named_so and not is_hot_air:
        return (
            f'"{model}" begins with {HOT_AIR}: it is a hot air station, which status 00001 switches'
            f" on, and no {family.name}"
        )
    if is_hot_air and not named_so:
        return (
            f'"{model}" does not begin with {HOT_AIR}, as the model names of hot air stations do:'
            f" it is no {family.name}"
        )
    return None


def foreign_reads(family: Family) -> Iterator[Command]:
    """Yield reads that only stations of another kind answer."""
    kinds = {
        member.answered_by_kind: member for member in FAMILIES.values() if member.protocol != OMEGA
    }
    for names, member in kinds.items():
        if names != family.answered_by_kind:
            yield from (member.commands[name] for name in names)


def accept_line(model: str) -> str:
    """Return the line file's entry that accepts this name: ``model = "DIE"``."""
    return f'model = "{model}"'


def unknown_model_text(model: str) -> str:
    """Say what to put in the line file for a name that no table has."""
    return (
        f"it reports model {model!r}, which jbclog does not know. If you know what it is, name its"
        f' family in the line file in place of "auto", and add {accept_line(model)}'
    )


def other_model_text(family: Family, model: str) -> str:
    """Say what to put in the line file if the model name proves another family."""
    found = (
        f"the line file says family {family.name}, the station says model {model}; nothing was"
        " written to it. Compare with the label on the station: if the cable leads to another"
        " station, correct the cable"
    )
    known = family_of(model)
    right = "" if known is None else f' to "{known.name}"'
    advice = f"{found}; if it is the right one, correct `family`{right}"
    if model_problem(family, model) is not None:
        return advice
    return f"{advice}, or, if its label says {family.name.upper()}, add {accept_line(model)}"


def model_not_accepted_text(accepted: str, model: str) -> str:
    """Say that the station's name differs from the one that the line file accepts."""
    return f"the line file accepts model {accepted}, the station says model {model}"
