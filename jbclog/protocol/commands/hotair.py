"""The command table of hot air stations (JTSE, manual 001), which have little in common with
soldering stations but the frame.

Manual 001 prints no range, no step and no factory setting: R-MAT, R-MIT, R-MAF, R-MIF, R-MAE and
R-MIE read a station's own limits. It prints no unit of the flow (docs/reference/contradictions.md,
B-33), so the tables have the raw number. There are no sleep, hibernation, alarm, store, address,
transistor and transformer commands.
"""

from __future__ import annotations

from types import MappingProxyType

from jbclog.core.quantities import Choice, DigitWord, Number, Quantity, Text, Unsigned
from jbclog.protocol.commands.command import Command, Limits, Scope
from jbclog.protocol.commands.error_tables import ErrorTable
from jbclog.protocol.commands.robot import (
    CELSIUS,
    COUNT,
    HOURS,
    OFFSET,
    TOOL_CODE,
    UNPRINTED,
    order,
    per_port,
    setting,
)
from jbclog.protocol.commands.signals import STATUS, ReadInterval, Signal, UsageCounter
from jbclog.protocol.commands.status import StatusTable

FLOW = Unsigned("raw")  # no manual prints its unit
MODES = Choice(("manual", "profile"))
STATUS_WORD = DigitWord((0, 0, 1, 1, 1))


def _selected(
    name: str, letters: str, quantity: Quantity, manual: str, note: str, share_of: str | None = None
) -> Command:
    name, within = f"selected_{name}", (f"minimum_{name}", f"maximum_{name}")
    return Command(
        name,
        letters,
        Scope.PORT,
        quantity,
        "rw",
        manual,
        UNPRINTED,
        note=note,
        within=within,
        share_of=share_of,
    )


def _limit(name: str, letters: str, quantity: Quantity, manual: str, note: str = "") -> Command:
    return Command(
        name, letters, Scope.STATION, quantity, "rw", manual, UNPRINTED, dangerous=True, note=note
    )


READINGS = (
    per_port("air_temperature", "AT", CELSIUS, "001 4.9.7"),
    per_port(
        "external_temperature",
        "ET",
        CELSIUS,
        "001 4.9.8",
        note="B-44: without a thermocouple (port error 4) it means nothing",
    ),
    per_port(
        "power",
        "PP",
        Unsigned("‰"),
        "001 4, 4.9.11",
        limits=Limits(0, 1000),
        note="B-32: per mille, printed here",
    ),
    per_port(
        "port_error",
        "PE",
        Number(),
        "001 4.3, 4.9.12",
        note="B-30: other meanings than on soldering stations",
    ),
    per_port("tool", "CT", TOOL_CODE, "001 4.1, 4.9.15"),
    Command(
        "model",
        "SMN",
        Scope.STATION,
        Text(),
        "r",
        "001 4.9.18",
        answer_digits=None,
        note="B-34: filled with blanks on the left",
    ),
    Command(
        "station_error",
        "SER",
        Scope.STATION,
        Number(),
        "r",
        "001 4.4, 4.9.31",
        note="B-45: 1 and 2 not used, 7 is not printed",
    ),
)

SETTINGS = (
    _selected(
        "air_temperature",
        "ST",
        CELSIUS,
        "001 4.9.1, 4.9.2",
        "B-27: whether it is volatile is not printed here",
    ),
    _selected(
        "air_flow", "SF", FLOW, "001 4.9.3, 4.9.4", "B-33: unit unprinted", "maximum_air_flow"
    ),
    _selected(
        "external_temperature", "SE", CELSIUS, "001 4.9.5, 4.9.6", 'B-38: its text says "air flow"'
    ),
    setting(
        "work_mode",
        "WM",
        Scope.PORT,
        MODES,
        "001 4.7, 4.9.9, 4.9.10",
        Limits(),
        "B-42: what a running profile does is unprinted",
    ),
    setting(
        "status",
        "PS",
        Scope.PORT,
        STATUS_WORD,
        "001 4.6, 4.9.13, 4.9.14",
        Limits(),
        "B-43: the answer to a write is unprinted",
    ),
    setting(
        "adjust",
        "A",
        Scope.TOOL,
        OFFSET,
        "001 3.1, 4.9.16, 4.9.17",
        Limits(low=-50),
        "B-4: the lowest is in 3.1",
    ),
)

STATION_LIMITS = (
    _limit("maximum_air_temperature", "MAT", CELSIUS, "001 4.9.19, 4.9.20"),
    _limit("minimum_air_temperature", "MIT", CELSIUS, "001 4.9.21, 4.9.22"),
    _limit(
        "maximum_air_flow", "MAF", FLOW, "001 4.9.23, 4.9.24", "B-33: what a flow is a share of"
    ),
    _limit("minimum_air_flow", "MIF", FLOW, "001 4.9.25, 4.9.26", "B-33: unit unprinted"),
    _limit("maximum_external_temperature", "MAE", CELSIUS, "001 4.9.27, 4.9.28"),
    _limit("minimum_external_temperature", "MIE", CELSIUS, "001 4.9.29, 4.9.30"),
)

COUNTERS = (
    per_port(
        "plugged_hours",
        "OH",
        HOURS,
        "001 4.8, 4.9.33",
        note='B-41: "on hours" in the list, "plugged hours" in the text',
    ),
    per_port("work_hours", "WH", HOURS, "001 4.9.34"),
    per_port("tool_cycles", "TC", COUNT, "001 4.9.35"),
    per_port("suction_cycles", "SC", COUNT, "001 4.9.36"),
)

RESETS = (
    order(
        "restart",
        "RST",
        "001 4.8",
        'B-40: "reset station settings", not described; answer unprinted; B-37: data 00000',
    ),
    order("factory_reset", "RSP", "001 4.9.32", "B-37: data 00000"),
)

HOT_AIR = READINGS + SETTINGS + STATION_LIMITS + COUNTERS + RESETS

TOOLS = {0: "none", 1: "JT", 2: "TE"}  # 001 4.1

# The causes in brackets are not printed: they are those of the same numbers over USB
# (docs/reference/manuals.md).
PORT_ERRORS = ErrorTable(  # 001 4.3
    "port",
    MappingProxyType(
        {
            0: "ok",
            1: "air pump malfunction",
            2: (
                "insufficient air flow; check for leaks, or an obstruction in the heater"
                " (the protection thermocouple is too hot)"
            ),
            3: "heater malfunction; replace the heater (the control thermocouple is too hot)",
            4: "external thermocouple needed",
            5: "set temperature not reached",
            6: "short circuit; replace the heater (its current is too high)",
            7: "wrong tool resistance (too low)",
            8: "wrong heater",
            9: "no tool",
            10: "checking the tool",
        }
    ),
    states=frozenset({9, 10}),
    warnings=frozenset({4}),  # a sensor is not connected; nothing is broken
    no_tool=9,
    voids=((4, "external_c", "no_thermocouple"),),  # docs/reference/contradictions.md, B-44
)

STATION_ERRORS = ErrorTable(  # 001 4.4
    "station",
    MappingProxyType(
        {
            0: "ok",
            1: "stopped: transformer overload (not used on hot air)",
            2: "temperature sensor of the transformer (not used on hot air)",
            3: "memory",
            4: "mains frequency",
            5: "station model",
            6: "tool controller not connected",
            # not printed here (docs/reference/contradictions.md, B-45)
            7: "warning: transformer overload",
        }
    ),
    warnings=frozenset({7}),
)

# 001 4.6. On and cooling at once is not described; it counts as at work, because the heater may be
# on.
AIR_STATUS = StatusTable(
    names=("off", "on"),
    heating=frozenset({1}),
    resting=frozenset({0}),
    orders=MappingProxyType(
        {"on": (0, 0, 0, 0, 1), "off": (0, 0, 0, 0, 0), "cooling": (0, 0, 0, 1, 0)}
    ),
    last_resorts=("off", "cooling"),
    tens="cooling",
    tens_rests=False,
    has_suction=True,
)

AIR_SIGNALS = (
    Signal("air_temperature", ("temperature_c",), ReadInterval.FAST),
    Signal("power", ("power_permille",), ReadInterval.FAST),
    STATUS,
    Signal("external_temperature", ("external_c",), ReadInterval.FAST),
    Signal("port_error", ("port_error",), ReadInterval.ALARMS),
    Signal("selected_air_temperature", ("setpoint_c",), ReadInterval.FIVE),
    Signal("selected_air_flow", ("set_flow_permille",), ReadInterval.FIVE),
    Signal("tool", ("tool",), ReadInterval.FIVE),
    Signal("station_error", ("station_error",), ReadInterval.FIVE),
)

AIR_COUNTERS = (
    UsageCounter("plugged_hours", "on_h", "h"),
    UsageCounter("work_hours", "work_h", "h"),
    UsageCounter("tool_cycles", "tool_cycles", "count"),
    UsageCounter("suction_cycles", "suction_cycles", "count"),
)
