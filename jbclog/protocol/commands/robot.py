"""The command tables of JBC soldering stations in Robot mode.

Notes cite docs/reference/contradictions.md ("B-nn") where the manuals are unclear or contradict
each other.
"""

from __future__ import annotations

from dataclasses import replace

from jbclog.core.quantities import (
    AlarmDelay,
    AlarmLimit,
    Choice,
    Delay,
    DigitWord,
    Flags,
    Number,
    Quantity,
    Text,
    Unsigned,
    Whole,
)
from jbclog.protocol.commands.command import Command, Effect, InferredLimits, Limits, Scope

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
"""The factory range of temperature settings in 002; R-MIT and R-MAT read a station's own."""
TIP_WITHIN = ("minimum_temperature", "maximum_temperature")
SLEEP_WITHIN = (None, "maximum_temperature")
"""002 prints that R-MIT bounds W-STx, and no bound for W-Sxy: below R-MIT the station decides."""
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
    """Return a read-only command of one port. The manuals print few ranges."""
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
    per_port(
        "tip_temperature",
        "TT",
        CELSIUS,
        "002 R-TTx; 000 4.8.3",
        note=(
            "tweezers have two tips and one number, probably their mean: a hot and a cold tip can"
            " hide in it"
        ),
    ),
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
    """Return an alarm delay; both manuals print the form ss.cc, which limits the value."""
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


def _old(name: str, manual: str, note: str = "", limits: Limits | None = None) -> Command:
    """Return a setting as 000 prints it: without range, step or unit of a delay, only the lowest
    number (3.1). The rest is inferred from 002.
    """
    newer = next(command for command in SETTINGS if command.name == name)
    source, known = newer.manual, newer.limits
    if newer.inferred is FACTORY_RANGE:
        source, known = f"{source}, Factory Settings", replace(FACTORY_RANGE.limits, step=5)
    return replace(
        newer,
        manual=manual,
        limits=limits or Limits(printed=False, off=known.off),
        note=note,
        inferred=InferredLimits(source, known, unit=isinstance(newer.quantity, Delay)),
    )


OLD_SETTINGS = (
    _old("selected_temperature", "000 4.8.2", "B-27: whether it is volatile is not printed here"),
    TIP_STATUS,
    _old(
        "adjust",
        "000 3.1, 4.8.11",
        "B-3: the sign is a dot here; B-4: the lowest is in 3.1",
        Limits(low=-50),
    ),
    _old("sleep_temperature", "000 4.8.13"),
    _old("sleep_delay", "000 4.8.15", "B-20: no unit is printed here"),
    _old("hibernation_delay", "000 4.8.17", "B-20: no unit is printed here"),
    _old("alarm_high_limit", "000 4.8.20", "B-23: not set is 99999 or 0"),
    _old("alarm_low_limit", "000 4.8.22", "B-23: not set is 99999 or 0"),
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


def order(
    name: str, letters: str, manual: str, note: str = "", effect: Effect = Effect.ERASES
) -> Command:
    """Return a write without a value. All are dangerous, except those that stop the machine."""
    return Command(
        name,
        letters,
        Scope.STATION,
        NOTHING,
        "w",
        manual,
        Limits(0, 0),
        effect,
        dangerous=effect is not Effect.STOPS,
        note=note,
    )


ORDERS = (
    order(
        "restart",
        "RST",
        "002 W-RST; 000 4.7",
        "B-40: answer unprinted, may be silence; B-37: data 00000",
    ),
    order("factory_reset", "RSP", "002 W-RSP; 000 4.9.35", "B-37: data 00000"),
)
STORE = order(
    "store",
    "NVS",
    "002 W-NVS",
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

IGNORE_FUSE_ERROR = order("ignore_fuse_error", "IFE", "002 W-IFE", "B-37: data 00000")

FUSE = Choice(("absent", "present"))

UCR = (  # printed for UCR alone (manuals 002 and 004)
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
    # 002 prints the first two, real stations over USB say T470
    # (docs/reference/contradictions.md, B-29)
    9: "TRA245/TRA470/T470",
}
TOOLS_004 = {0: "none", 2: "TR245/TR470", 9: "TRA245/TRA470"}
