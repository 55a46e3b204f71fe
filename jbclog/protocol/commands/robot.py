"""The command tables of JBC soldering stations in Robot mode.

Notes cite docs/reference/contradictions.md ("B-nn") where the manuals are in doubt or contradict
each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType

from jbclog.core.quantities import (
    AlarmDelay,
    AlarmLimit,
    Choice,
    Delay,
    DigitWord,
    Flags,
    HexLength,
    Number,
    Quantity,
    Scaled,
    Text,
    Unsigned,
    Whole,
)
from jbclog.protocol.commands.command import Command, Effect, InferredLimits, Limits, Scope

# Printed for UCR alone (manuals 002 and 004).

FUSE = Choice(("absent", "present"))

UCR = (
    Command(
        "fuse", "FST", Scope.STATION, FUSE, "r", "002 R-FST", note="B-39: garbled row; UCR only"
    ),
    Command(
        "address",
        "SAD",
        Scope.STATION,
        Number(),
        "w",
        "002 W-SAD; 004 WSAD",
        Limits(0, 99, 1),
        Effect.ERASES,
        True,
        note="B-9: 00000 switches addresses off",
    ),
)


CELSIUS = Whole("°C")
# manual 000, 3.1 prints "." for the sign (docs/reference/contradictions.md, B-3)
OFFSET = Whole("°C", minus="-.")
HOURS = Unsigned("h")
COUNT = Unsigned("count")
NOTHING = Number()
TOOL_CODE = Number()
UNPRINTED = Limits(printed=False)
STEPS_OF_5 = Limits(step=5)
FACTORY_RANGE = InferredLimits("002 Factory Settings", Limits(90, 500))
"""The factory range of temperature settings of 002; R-MIT and R-MAT read a station's own."""
TIP_WITHIN = ("minimum_temperature", "maximum_temperature")
SLEEP_WITHIN = (None, "maximum_temperature")
"""002 prints that R-MIT bounds W-STx, and no bound for W-Sxy: the station decides below R-MIT."""
STATUS_WORD = DigitWord((0, 2, 1, 1, 3))
ALARM_FLAGS = Flags((0, 0, 0, 1, 1))


def per_port(
    name: str,
    letters: str,
    quantity: Quantity,
    manual: str,
    limits: Limits = UNPRINTED,
    note: str = "",
    **more: object,
) -> Command:
    """Return a read-only command of one port. Ranges are printed for few."""
    return Command(name, letters, Scope.PORT, quantity, "r", manual, limits, note=note, **more)  # type: ignore[arg-type]  # table helper


def setting(
    name: str,
    letters: str,
    scope: Scope,
    quantity: Quantity,
    manual: str,
    limits: Limits,
    note: str = "",
    **more: object,
) -> Command:
    """Return a command that is written and read back."""
    return Command(name, letters, scope, quantity, "rw", manual, limits, note=note, **more)  # type: ignore[arg-type]  # table helper


READINGS = (
    per_port("tip_temperature", "TT", CELSIUS, "002 R-TTx; 000 4.8.3"),
    per_port(
        "power",
        "PP",
        Unsigned("‰"),
        "002 R-PPx; 000 4.8.4",
        limits=Limits(0, 1000),
        note="B-32: per mille",
    ),
    per_port(
        "port_error",
        "PE",
        Number(printed_for=((80000, 8),)),
        "002 R-PEx, Port Errors; 000 4.8.5",
        note="B-28: 80000 is read as 8",
    ),
    per_port("tool", "CT", TOOL_CODE, "002 R-CTx, Tools; 000 4.8.8"),
    per_port(
        "time_to_sleep",
        "ED",
        Unsigned("s"),
        "002 R-EDx; 000 4.8.9",
        note="B-25: value when not counting unprinted",
    ),
    per_port("transistor_temperature", "QT", CELSIUS, "002 R-QTx; 000 4.8.18"),
    per_port(
        "alarm_flags",
        "TA",
        ALARM_FLAGS,
        "002 R-TAx; 000 4.8.27",
        effect=Effect.CLEARS,
        note="B-24: latched, cleared by reading (000); units high, tens low",
    ),
    Command(
        "model",
        "SMN",
        Scope.STATION,
        Text(),
        "r",
        "002 R-SMN; 000 4.8.28",
        answer_digits=None,
        note="B-34: six letters occur",
    ),
    Command(
        "station_error",
        "SER",
        Scope.STATION,
        Number(),
        "r",
        "002 R-SER, Station Errors; 000 4.8.33",
    ),
    Command(
        "transformer_temperature",
        "TT",
        Scope.STATION,
        CELSIUS,
        "r",
        "002 R-TT; 000 4.8.34",
        UNPRINTED,
        note="B-10: two letters",
    ),
)

TIP_STATUS = Command(
    "status",
    "PS",
    Scope.PORT,
    STATUS_WORD,
    "rw",
    "002 W-PSx, Tool Operating Status; 000 4.6, 4.8.7",
    note="B-19: only 00000, 00001 and, not in 000, 00010 are written",
)


def _alarm_delay(name: str, letters: str, manual: str) -> Command:
    """Return an alarm delay; both manuals print the form ss.cc, which bounds the value."""
    return setting(
        name,
        letters,
        Scope.PORT,
        AlarmDelay(),
        manual,
        Limits(0, 99.99, 0.01, off=True),
        "B-21, B-22",
    )


ALARM_DELAYS = (
    _alarm_delay("alarm_high_delay", "HD", "002 W-HDx; 000 4.8.24"),
    _alarm_delay("alarm_low_delay", "LD", "002 W-LDx; 000 4.8.26"),
)
SELECTED = Command(
    "selected_temperature",
    "ST",
    Scope.PORT,
    CELSIUS,
    "rw",
    "002 W-STx",
    STEPS_OF_5,
    note="B-27: volatile",
    within=TIP_WITHIN,
    inferred=FACTORY_RANGE,
)
SETTINGS = (  # 002 and 004
    SELECTED,
    TIP_STATUS,
    setting(
        "adjust",
        "A",
        Scope.TOOL,
        OFFSET,
        "002 W-Axy",
        Limits(-50, 50, 1),
        "B-3: the sign was once a dot",
    ),
    setting(
        "sleep_temperature",
        "S",
        Scope.TOOL,
        CELSIUS,
        "002 W-Sxy",
        STEPS_OF_5,
        "R-MIT bounds W-STx alone",
        within=SLEEP_WITHIN,
        inferred=FACTORY_RANGE,
    ),
    setting(
        "sleep_delay",
        "D",
        Scope.TOOL,
        Delay("min"),
        "002 W-Dxy",
        Limits(0, 9, 1, off=True),
        "B-20: minutes",
    ),
    setting(
        "hibernation_delay",
        "H",
        Scope.TOOL,
        Delay("min"),
        "002 W-Hxy",
        Limits(0, 60, 5, off=True),
        "B-20: minutes",
    ),
    setting(
        "alarm_high_limit",
        "HA",
        Scope.PORT,
        AlarmLimit(),
        "002 W-HAx",
        STEPS_OF_5,
        "B-23: not set is 99999 or 0",
    ),
    setting(
        "alarm_low_limit",
        "LA",
        Scope.PORT,
        AlarmLimit(),
        "002 W-LAx",
        STEPS_OF_5,
        "B-23: not set is 99999 or 0",
    ),
    *ALARM_DELAYS,
)
_NO_RANGE = Limits(printed=False, off=True)
# 000 prints no range, no step and no unit of a delay; only the lowest number (3.1)
OLD_SETTINGS = (
    replace(
        SELECTED,
        manual="000 4.8.2",
        limits=UNPRINTED,
        note="B-27: whether it is volatile is not printed here",
        inferred=InferredLimits("002 W-STx, Factory Settings", Limits(90, 500, 5)),
    ),
    TIP_STATUS,
    setting(
        "adjust",
        "A",
        Scope.TOOL,
        OFFSET,
        "000 3.1, 4.8.11",
        Limits(low=-50),
        "B-3: the sign is a dot here; B-4: the lowest is in 3.1",
        inferred=InferredLimits("002 W-Axy", Limits(-50, 50, 1)),
    ),
    setting(
        "sleep_temperature",
        "S",
        Scope.TOOL,
        CELSIUS,
        "000 4.8.13",
        UNPRINTED,
        within=SLEEP_WITHIN,
        inferred=InferredLimits("002 W-Sxy, Factory Settings", Limits(90, 500, 5)),
    ),
    setting(
        "sleep_delay",
        "D",
        Scope.TOOL,
        Delay("min"),
        "000 4.8.15",
        _NO_RANGE,
        "B-20: no unit is printed here",
        inferred=InferredLimits("002 W-Dxy", Limits(0, 9, 1, off=True), unit=True),
    ),
    setting(
        "hibernation_delay",
        "H",
        Scope.TOOL,
        Delay("min"),
        "000 4.8.17",
        _NO_RANGE,
        "B-20: no unit is printed here",
        inferred=InferredLimits("002 W-Hxy", Limits(0, 60, 5, off=True), unit=True),
    ),
    setting(
        "alarm_high_limit",
        "HA",
        Scope.PORT,
        AlarmLimit(),
        "000 4.8.20",
        UNPRINTED,
        "B-23: not set is 99999 or 0",
        inferred=InferredLimits("002 W-HAx", STEPS_OF_5),
    ),
    setting(
        "alarm_low_limit",
        "LA",
        Scope.PORT,
        AlarmLimit(),
        "000 4.8.22",
        UNPRINTED,
        "B-23: not set is 99999 or 0",
        inferred=InferredLimits("002 W-LAx", STEPS_OF_5),
    ),
    *ALARM_DELAYS,
)

STATION_LIMITS = (
    Command(
        "maximum_temperature",
        "MAT",
        Scope.STATION,
        CELSIUS,
        "rw",
        "002 W-MAT; 000 4.8.30",
        UNPRINTED,
        dangerous=True,
    ),
    Command(
        "minimum_temperature",
        "MIT",
        Scope.STATION,
        CELSIUS,
        "rw",
        "002 W-MIT; 000 4.8.32",
        UNPRINTED,
        dangerous=True,
    ),
)

COUNTERS = (
    per_port("plugged_hours", "CP", HOURS, "002 R-CPx; 000 4.8.36"),
    per_port("no_tool_hours", "CN", HOURS, "002 R-CNx; 000 4.8.37"),
    per_port("sleep_hours", "CS", HOURS, "002 R-CSx; 000 4.8.38"),
    per_port("hibernation_hours", "CH", HOURS, "002 R-CHx; 000 4.8.39"),
    per_port("work_hours", "CW", HOURS, "002 R-CWx; 000 4.8.40"),
    per_port("sleep_cycles", "CC", COUNT, "002 R-CCx; 000 4.8.41"),
    per_port(
        "desolder_cycles",
        "CD",
        COUNT,
        "002 R-CDx; 000 4.8.42",
        note="B-36: the printed example RCC1 is a misprint",
    ),
)


def _order(name: str, letters: str, manual: str, effect: Effect, note: str = "") -> Command:
    return Command(
        name, letters, Scope.STATION, NOTHING, "w", manual, Limits(0, 0), effect, True, note=note
    )


ORDERS = (
    _order(
        "restart",
        "RST",
        "002 W-RST; 000 4.7",
        Effect.ERASES,
        "B-40: answer unprinted, may be silence; B-37: data 00000",
    ),
    _order("factory_reset", "RSP", "002 W-RSP; 000 4.9.35", Effect.ERASES, "B-37: data 00000"),
)
STORE = _order(
    "store",
    "NVS",
    "002 W-NVS",
    Effect.ERASES,
    "writes the selected temperature into the EEPROM, which wears",
)
SOFTWARE_VERSION = Command(
    "software_version",
    "SVR",
    Scope.STATION,
    Text(),
    "r",
    "002 R-SVR",
    answer_digits=None,
    note="B-5: format unprinted",
)

IGNORE_FUSE_ERROR = _order(
    "ignore_fuse_error", "IFE", "002 W-IFE", Effect.ERASES, "B-37: data 00000"
)

COMMON = (*READINGS, TIP_STATUS, *ALARM_DELAYS, *STATION_LIMITS, *COUNTERS, *ORDERS)
"""Printed alike in 000, 002 and 004."""
OLD = (*READINGS, *OLD_SETTINGS, *STATION_LIMITS, *COUNTERS, *ORDERS)
BENCH = (
    *READINGS,
    *SETTINGS,
    *STATION_LIMITS,
    *COUNTERS,
    *ORDERS,
    STORE,
    SOFTWARE_VERSION,
    IGNORE_FUSE_ERROR,
)
"""Printed in 002 for all stations, or without naming any."""

TOOLS_000 = {
    0: "none",
    1: "T210",
    2: "T245/T470",
    3: "PA",
    4: "HT",
    5: "DS",
    6: "DR",
    7: "NT105",
    8: "NP105",
}
TOOLS_002 = {
    0: "none",
    1: "T210",
    # two rows with the same number (docs/reference/contradictions.md, B-29)
    2: "T245/T470/TR245/TR470",
    3: "PA120/AM120",
    4: "HT420/AT420",
    5: "DS360",
    6: "DR560",
    7: "NT115",
    8: "NP115/AN115",
    9: "TRA245/TRA470",
}
TOOLS_004 = {0: "none", 2: "TR245/TR470", 9: "TRA245/TRA470"}


@dataclass(frozen=True, slots=True)
class ErrorTable:
    """What error numbers mean. `states` are not faults; `no_tool` is the number for an empty port.

    `voids` are error, signal and reason: the signal means nothing during the error.
    """

    kind: str
    texts: Mapping[int, str]
    states: frozenset[int] = frozenset()
    warnings: frozenset[int] = frozenset()
    no_tool: int | None = None
    voids: tuple[tuple[int, str, str], ...] = ()

    def text(self, code: int) -> str:
        """Return the meaning of `code`; an unknown one stays a number."""
        return self.texts.get(code, f"unknown {self.kind} error {code}")

    def void(self, code: int | None, signal: str) -> str | None:
        """Return why `signal` means nothing during the error `code`; None where it counts."""
        if not self.voids:
            return None
        return next(
            (reason for error, name, reason in self.voids if (error, name) == (code, signal)), None
        )


PORT_ERRORS = ErrorTable(
    "port",
    MappingProxyType(
        {
            0: "ok",
            1: "short circuit",
            2: "short circuit, not recoverable; restart the station",
            3: "open circuit",
            4: "no tool",
            5: "tool not accepted",
            6: "detecting the tool",
            7: "stopped: maximum power",
            8: "stopped: overload (MOS)",
            9: "warning: overload (MOS)",
        }
    ),
    states=frozenset({4, 6}),  # docs/reference/station-commands.md, Port errors
    warnings=frozenset({9}),
    no_tool=4,
)

STATION_ERRORS = ErrorTable(
    "station",
    MappingProxyType(
        {
            0: "ok",
            1: "stopped: transformer overload",
            2: "temperature sensor",
            3: "memory",
            4: "mains frequency",
            5: "station model",
            6: "tool controller not connected",
            7: "warning: transformer overload",
        }
    ),
    warnings=frozenset({7}),
)

COMMUNICATION_ERRORS = {
    1: "wrong check byte",
    2: "wrong format",
    3: "value out of range",
    4: "command not accepted",
    5: "Robot mode is off",
    6: "station model unknown",
    99999: "undefined",
}


# The solder feeder of ALE, and the dispensing counters (manual 002). No manual prints their ranges.


class FeederState(StrEnum):
    STOPPED = "stopped"
    RUNNING = "running"


MODES = Choice(("continuous", "discontinuous", "program", "reload"))
SWITCH = Choice(("off", "on"))


def _feeder(
    name: str, letters: str, quantity: Quantity, manual: str, access: str = "rw", note: str = ""
) -> Command:
    limits = Limits() if isinstance(quantity, Choice) else UNPRINTED  # choices are printed
    return Command(name, letters, Scope.STATION, quantity, access, manual, limits, note=note)


def _motor(name: str, letters: str, manual: str, effect: Effect) -> Command:
    return Command(
        name,
        letters,
        Scope.STATION,
        NOTHING,
        "w",
        manual,
        Limits(0, 0),
        effect,
        effect is Effect.MOVES,
        note="B-37: data 00000",
    )


FEEDER = (
    _feeder("feeder_mode", "MOD", MODES, "002 R-MOD, W-MOD"),
    _feeder(
        "feeder_length",
        "LEN",
        Scaled("mm", 10),
        "002 R-LEN, W-LEN",
        note="B-38; the wire carries dmm",
    ),
    _feeder(
        "feeder_speed",
        "SPD",
        Scaled("mm/s", 10),
        "002 R-SPD, W-SPD",
        note="B-38; the wire carries dmm/s",
    ),
    _feeder(
        "feeder_diameter", "DIA", Scaled("mm", 100), "002 R-DIA, W-DIA", note="the wire carries cmm"
    ),
    _feeder(
        "feeder_backward", "BCK", Scaled("mm", 10), "002 R-BCK, W-BCK", note="the wire carries dmm"
    ),
    _feeder(
        "clog_detection",
        "WCD",
        SWITCH,
        "002 R-WCD, W-WCD",
        note="whether detection is on, not a clog",
    ),
    _feeder("feeding", "FEE", Choice(tuple(one.value for one in FeederState)), "002 R-FEE", "r"),
    _motor("start_feeding", "STR", "002 W-STR", Effect.MOVES),
    _motor("stop_feeding", "STP", "002 W-STP", Effect.STOPS),
)

DISPENSED = (
    per_port(
        "dispensed_cycles",
        "DC",
        COUNT,
        "002 R-DCx",
        note="B-36: the printed text is a copy of R-CDx",
    ),
    per_port(
        "dispensed_length",
        "DL",
        HexLength(),
        "002 R-DLx",
        answer_digits=None,
        note="B-35: hexadecimal, any width",
    ),
)
