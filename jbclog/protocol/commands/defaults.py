"""Factory settings as the manuals print them, and a choice where they print none.

Virtual stations start with them, and a factory reset restores them. A driver assumes none: it reads
the station's settings.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from jbclog.core.quantities import OFF, Value
from jbclog.protocol.commands.status import EXTRACTOR, WORKING

PRINTED_AT = "002 Factory Settings; 004 Factory Settings"


@dataclass(frozen=True, slots=True)
class Default:
    """Factory value of one setting. `printed` is the manual's text; if empty, `value` is a choice.

    `model` is the beginning of model names that it applies to; empty for the whole family.
    """

    command: str
    value: Value
    printed: str = ""
    manual: str = ""
    note: str = ""
    model: str = ""


def values_of(defaults: Iterable[Default], model: str = "") -> dict[str, Value]:
    """Return the values by command; a row for the model overrides one for all."""
    rows = [row for row in defaults if model.upper().startswith(row.model)]
    return {row.command: row.value for row in sorted(rows, key=lambda row: len(row.model))}


def _printed(command: str, value: Value, printed: str, note: str = "") -> Default:
    return Default(command, value, printed, PRINTED_AT, note)


_DELAY_NOTE = (
    "B-20: the wire counts minutes, so seconds cannot be meant; a virtual station's own choice"
)

SOLDERING_DEFAULTS = (
    _printed("selected_temperature", 350, "350 °C"),
    _printed("status", EXTRACTOR, "Extract (stand by)"),
    _printed("adjust", 0, "0 °C", "B-26: the 32 °F beside it is no offset"),
    _printed("sleep_temperature", 150, "150 °C"),
    _printed("sleep_delay", 5, "10 sec. (general), 0 sec. (tool)", _DELAY_NOTE),
    _printed("hibernation_delay", 30, "10 sec.", _DELAY_NOTE),
    _printed(
        "alarm_high_limit", OFF, "not set", "B-23: no manual prints how to write it; read as 99999"
    ),
    _printed(
        "alarm_low_limit", OFF, "not set", "B-23: no manual prints how to write it; read as 99999"
    ),
    Default("alarm_high_delay", OFF),
    Default("alarm_low_delay", OFF),
    _printed("maximum_temperature", 500, "500 °C"),
    _printed("minimum_temperature", 90, "90 °C"),
)

UCR_DEFAULTS = (
    *SOLDERING_DEFAULTS,
    Default(
        "maximum_temperature",
        450,
        "450 °C",
        "004 Factory Settings",
        "B-31: 002 prints 500 °C for all",
        "UCR245",
    ),
)

FEEDER_DEFAULTS = (
    Default("feeder_mode", "discontinuous"),
    Default("feeder_length", 5.0),
    Default("feeder_speed", 10.0),
    Default("feeder_diameter", 1.0),
    Default("feeder_backward", 1.0),
    Default("clog_detection", "off"),
)

OLD_DEFAULTS = tuple(
    replace(row, printed="", manual="", note="000 prints no factory settings")
    for row in SOLDERING_DEFAULTS
)

AIR_DEFAULTS = tuple(
    Default(command, value, note="001 prints no factory settings")
    for command, value in (
        ("selected_air_temperature", 300),
        ("selected_air_flow", 500),
        ("selected_external_temperature", 200),
        ("work_mode", "manual"),
        ("status", WORKING),  # 00000: off, on hot air
        ("adjust", 0),
        ("maximum_air_temperature", 450),
        ("minimum_air_temperature", 150),
        ("maximum_air_flow", 1000),
        ("minimum_air_flow", 100),
        ("maximum_external_temperature", 500),
        ("minimum_external_temperature", 25),
    )
)
