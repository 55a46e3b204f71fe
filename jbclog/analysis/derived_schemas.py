"""The tables that are derived from a run's record, kept in its folder `derived/`: columns, types,
units and meanings.

Each is a Parquet file of its own, with the same columns and types in every run, also without a row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import pyarrow as pa

from jbclog.core.rows import QUALITIES
from jbclog.record.folder import DERIVED_TABLES
from jbclog.record.schema import FLAG, FLOAT, INT, TEXT, TIME, Column, field_of, pandas_hint

RUN: Final[Column] = ("run!", TEXT, "", "name of the run's folder")
PLACE: Final[Sequence[Column]] = (
    RUN,
    ("station!", TEXT, "", "station"),
    ("port!", INT, "", "port"),
)

JOINTS: Final[Sequence[Column]] = (
    *PLACE,
    ("joint!", INT, "count", "number of the joint in this port, from 1"),
    ("start!", TIME, "UTC", "time of the first row at or after the joint's start"),
    (
        "stop!",
        TIME,
        "UTC",
        (
            "time of the first row at or after the end of its draw of heat, not of its recovery;"
            " else of the last row"
        ),
    ),
    ("start_s!", FLOAT, "s", "the same between rows, after tick 0"),
    ("stop_s!", FLOAT, "s", "the same between rows, after tick 0"),
    ("unit", TEXT, "", "serial of the unit on the bench at `start`; null where not known"),
    ("tip", TEXT, "", "the port's cartridge, as named at the start; null where it was not"),
    ("touches!", INT, "count", "contacts joined in it; 0: a feed without a draw of heat"),
    ("dwell_s", FLOAT, "s", "time in which heat flows into the work"),
    ("depth_c", FLOAT, "°C", "temperature at the start minus the lowest until the tip is back"),
    (
        "recovery_s",
        FLOAT,
        "s",
        "from the start until the tip is back near the level at which it rests",
    ),
    ("peak_permille", FLOAT, "‰", "highest flow of heat into the work"),
    ("heat_permille_s", FLOAT, "‰·s", "heat that went into the work"),
    (
        "energy_permille_s",
        FLOAT,
        "‰·s",
        "power above holding power from the start until the tip is back",
    ),
    ("energy_j", FLOAT, "J", "the same × full-scale power / 1000, where that is declared"),
    ("fed", FLAG, "", "solder wire was fed; null where that is not known"),
    (
        "confidence!",
        FLOAT,
        "",
        (
            "0 to 1, not a probability: peak above noise; half if feeds cut the joint, 0.3 for a"
            " feed alone"
        ),
    ),
    (
        "why",
        TEXT,
        "",
        "why recovery, depth, dwell or energy is null; or that only the feeder shows the joint",
    ),
    (
        "kind!",
        TEXT,
        "",
        (
            "joint, or not known: as short or small as a wipe or a touch without solder, without"
            " wire, or wire alone"
        ),
    ),
    ("heat_j", FLOAT, "J", "heat_permille_s × full-scale power / 1000, where that is declared"),
    ("setpoint_c", FLOAT, "°C", "setpoint at the start"),
    ("deficit_c", FLOAT, "°C", "setpoint minus temperature at the start"),
    (
        "resting_below_c",
        FLOAT,
        "°C",
        "level at which the tip rests at this setpoint minus temperature at the start",
    ),
    ("lowest_c", FLOAT, "°C", "lowest temperature from the start until the tip is back"),
    ("stop_c", FLOAT, "°C", "temperature at the end of its draw of heat"),
    (
        "recovered",
        FLAG,
        "",
        "the tip was back before the next draw of heat; null where it was cut off before",
    ),
    ("had_s", FLOAT, "s", "from the start until the next draw of heat, or until it was cut off"),
)

ALARMS: Final[Sequence[Column]] = (
    *PLACE,
    ("episode!", TEXT, "", "name of the episode"),
    ("incident!", INT, "count", "number of the alarm; its rows have the same"),
    (
        "main!",
        FLAG,
        "",
        (
            "the row that describes its alarm, of which each alarm has one: the first of B, else of"
            " A; excursions alone have none"
        ),
    ),
    ("witnesses!", TEXT, "", "detectors of all rows of the incident, such as `A, B ×2, C`"),
    ("side!", TEXT, "", "`high` or `low`"),
    (
        "detector!",
        TEXT,
        "",
        (
            "A: the station's flags, B: the samples with delays and deadband, C: every excursion of"
            " the samples, no alarm by itself"
        ),
    ),
    ("state!", TEXT, "", "`active`, `cleared`, or `uncertain` (not read for too long)"),
    (
        "start_earliest",
        TIME,
        "UTC",
        (
            "it began after this, the reading before; of A also one whose answer was lost: a"
            " station that heard the question has cleared its flags"
        ),
    ),
    ("start", TIME, "UTC", "and no later than this"),
    ("stop_earliest", TIME, "UTC", "it ended after this"),
    ("stop", TIME, "UTC", "and no later than this; null while it lasts"),
    ("raised", TIME, "UTC", "when it became known"),
    ("stop_reason", TEXT, "", "what ended it"),
    ("seconds", FLOAT, "s", "from `start` to `stop`"),
    ("seconds_least", FLOAT, "s", "without its unread time; null where all of it was read"),
    ("seconds_most", FLOAT, "s", "with the unread time right before `start`; null as before"),
    ("peak_c", FLOAT, "°C", "furthest temperature read"),
    ("limit_c", FLOAT, "°C", "limit of the alarm"),
    ("delay_s", FLOAT, "s", "by which the detector waits"),
    ("confirmed", FLAG, "", "a temperature supports the flag"),
    ("uncertain", FLAG, "", "not read for too long in between"),
    ("finding", TEXT, "", "how the detectors disagree"),
    ("acknowledged_by", TEXT, "", "from `jbclog alarms ack`"),
    ("acknowledged_at", TIME, "UTC", "by the run's clock"),
    ("acknowledged_why", TEXT, "", "reason given"),
)

UNITS: Final[Sequence[Column]] = (
    RUN,
    ("unit!", TEXT, "", "serial of the workpiece"),
    ("start", TIME, "UTC", "when its serial was read; null for a unit that was only named"),
    ("stop", TIME, "UTC", "when it left the bench, or the next one came; null where not known"),
    (
        "joints",
        INT,
        "count",
        (
            "joints that begin in it, of all ports; null where the number of a port is not known,"
            " a gap of more than one reading is in it, or a crash may have cut readings off"
        ),
    ),
    (
        "energy_j",
        FLOAT,
        "J",
        (
            "energy of all ports in it, from the first to the last reading of each; null where a"
            " port's full-scale power is not declared, a gap of more than one reading is in it, or"
            " a crash may have cut readings off"
        ),
    ),
    ("coverage", FLOAT, "%", "readings of temperature and power in it, of those due"),
    ("alarms", INT, "count", "alarms (incidents of A or B) that were on at some time of it"),
)

TIPS: Final[Sequence[Column]] = (
    *PLACE,
    ("tip!", TEXT, "", "the cartridge that was named for this port, its station, or the run"),
)

METRICS: Final[Sequence[Column]] = (
    *PLACE,
    ("metric!", TEXT, "", "name, as in the [definitions](verdict.md)"),
    ("value", FLOAT, "", "value in `uom`; null for the reason in `why`"),
    ("low", FLOAT, "", "least value that the record allows; null where no range is known"),
    ("high", FLOAT, "", "greatest value that the record allows; null where no range is known"),
    ("uom!", TEXT, "", "unit of measure"),
    ("n!", INT, "count", "readings, joints or heat-ups in it"),
    ("coverage", FLOAT, "%", "readings obtained, of those due"),
    ("resolution", FLOAT, "", "smallest difference that it can show, in `uom`"),
    ("why", TEXT, "", "why there is no value"),
)

OTHER: Final = "other"
"""Column of the readings that are missing for a reason that has no column."""
REASONS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(QUALITIES[:-1], "see `quality` of the samples"),
        "no_thermocouple": "hot air without a thermocouple",
        "not_counting": "no time to sleep runs",
        "no_digit": "OMEGA answered A without a digit",
        OTHER: "any other reason",
    }
)
"""Columns of the accounting: the readings lost for each reason; `nak`: any refusal."""

ACCOUNTING: Final[Sequence[Column]] = (
    RUN,
    ("station!", TEXT, "", "station"),
    ("port", INT, "", "port; null: of the whole station"),
    ("signal!", TEXT, "", "name of the column, counter or setting"),
    ("due!", INT, "count", "readings due: `obtained` and all columns after it"),
    ("obtained!", INT, "count", "readings obtained"),
    *((f"{name}!", INT, "count", text) for name, text in REASONS.items()),
)

GAPS: Final[Sequence[Column]] = (
    *PLACE,
    ("signal!", TEXT, "", "signal, named as its column in samples"),
    ("start!", TIME, "UTC", "time of the last reading before it"),
    ("stop!", TIME, "UTC", "time of the first reading after it"),
    ("seconds!", FLOAT, "s", "`stop` minus `start`"),
    ("missing!", INT, "count", "readings that were due in it"),
    ("reasons!", TEXT, "", "why, each reason once in order of appearance, with `;` between"),
    (
        "at_least!",
        FLAG,
        "",
        (
            "no reading is before it or none after it: from the first or to the last row in which"
            " one was due, and it may have lasted longer"
        ),
    ),
)


def _schema(columns: Sequence[Column]) -> pa.Schema:
    fields = [field_of(column, "definition") for column in columns]
    return pa.schema(fields, metadata={"pandas": pandas_hint(fields)})


JOINTS_SCHEMA: Final = _schema(JOINTS)
ALARMS_SCHEMA: Final = _schema(ALARMS)
UNITS_SCHEMA: Final = _schema(UNITS)
TIPS_SCHEMA: Final = _schema(TIPS)
METRICS_SCHEMA: Final = _schema(METRICS)
ACCOUNTING_SCHEMA: Final = _schema(ACCOUNTING)
GAPS_SCHEMA: Final = _schema(GAPS)

DERIVED_SCHEMAS: Final[Mapping[str, pa.Schema]] = MappingProxyType(
    dict(
        zip(
            DERIVED_TABLES,
            (
                JOINTS_SCHEMA,
                ALARMS_SCHEMA,
                UNITS_SCHEMA,
                TIPS_SCHEMA,
                METRICS_SCHEMA,
                ACCOUNTING_SCHEMA,
                GAPS_SCHEMA,
            ),
            strict=True,
        )
    )
)
"""By name, in the order in which they are shown."""
