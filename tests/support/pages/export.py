"""docs/reference/export.md: what each format of `jbclog export` holds, from the tables by which it
is written.
"""

from __future__ import annotations

from jbclog.app.export import qdas, workbook
from jbclog.app.export.csv_files import METADATA
from jbclog.app.export.source import SCHEMA_OF
from support.lazy import mdf
from support.pages.md_table import MADE, code, table

PART = {
    "K0100": "number of characteristics in the file",
    "K1001": f"product, as `--product` stated it; `{qdas.NOT_STATED}` without one",
    "K1002": "station and port",
    "K1053": "order",
    "K1081": "station and port, as the machine's number",
    "K1082": "model of the station, as the machine's description",
    "K1204": "start of the run, UTC",
    "K1205": "end of the run, UTC",
    "K1342": "recipe and revision, as the test plan's name",
    "K1900": "run, fingerprint, version and methods, check, time zone, verdict, state, tips",
}
CHARACTERISTIC = {
    "K2001": "column of the [table of joints](tables.md#joints)",
    "K2002": "the same in words",
    "K2004": "0: variable",
    "K2009": "800: time, 250: temperature, 0: undefined",
    "K2022": f"{qdas.DECIMALS} decimal places",
    "K2110": "0, where nothing can be below it",
    "K2111": (
        "upper limit of `recovery_s`: `recovery_p95_s` of the recipe's `[acceptance]`. The recipe"
        " limits 95 of 100 joints; K2900 says so"
    ),
    "K2120": "type of the lower limit: 2, natural; 0, none",
    "K2121": "type of the upper limit: 1, a limit; 0, none",
    "K2142": "unit, in ASCII",
    "K2900": "definition",
}
VALUE = {
    "K0001": f"value; `{qdas.MISSING}` in the place of one that is not known",
    "K0002": (
        f"{qdas.VALID}: valid; {qdas.NOT_EVALUATED}: shown and not evaluated, because it is not"
        f" known whether it was a joint; {qdas.PLACEHOLDER}: a placeholder, because the value is"
        " not known"
    ),
    "K0004": "start of the joint, UTC, in whole seconds",
    "K0014": "serial of the unit, where it is known: on a line of its own behind the joint's",
}

TEXT = f"""
`jbclog export RUN --to csv|xlsx|mf4|qdas`; the guide is [Export a run](../how-to/export.md). Its tables are samples, events,
settings, counters, joints and alarms, with the columns of [Tables and columns](tables.md).

csv, xlsx and mf4 hold the same facts of their run, qdas the most important ones: name, fingerprint (SHA-256 of the manifest),
state, what a recovered run lost, start, end, verdict with the version of its rules, line, recipes with SHA-256, operator,
order, product, units, lots, tips and tags, each annotation, whether the run was checked, time zone, version of jbclog and of
its methods.

## csv

A folder: a file for each table, UTF-8 with a byte order mark, as RFC 4180 has it; and `{METADATA}` with facts, types and
units ("Metadata Vocabulary for Tabular Data", W3C Recommendation, 17 December 2015). Times are ISO 8601 with six decimals of
a second and `Z`. What is not known is an empty cell, without quotes; an empty text is `""`. A text that a spreadsheet would
evaluate has an apostrophe before it, as in the report's tables.

## xlsx

A sheet `about` with facts, sheets and columns, then a sheet for each table. A sheet holds {workbook.MOST_ROWS - 1:,} rows
below its header; a longer table continues on `samples 2` and so on, which `about` states. Times are text in UTC, because
Excel has no time zones and no microseconds. Numbers and flags are numbers and flags; what is not known is an empty cell.
Nothing is a formula or a link. A text of more than {workbook.MOST_CHARACTERS:,} characters is cut, and says so. The same run
and version give the same bytes.

## mf4

ASAM MDF {{mdf.VERSION}}. The file's start is tick 0 of the run, in UTC; the facts stand in the comment of its header.

| group | rows | master |
| --- | --- | --- |
| `STATION port N` | the samples of a port, with the channels that the station's family can fill | seconds on the run's grid |
| `STATION port N joints` | its joints | `start_s` |
| `events` `settings` `counters` | rows in the order of their times | seconds since the start |
| `alarms` | episodes | seconds from the start to `start` |

Units stand at each channel. `time_utc` and other times are microseconds since 1970-01-01 UTC. A value that is not known has
its invalidation bit set; a reader that ignores these bits finds NaN, and `{{mdf.NO_TEXT}}` or an empty text. Flags are 0 and 1;
`quality`, `status`, `motor` and `reasons` are numbers with a table of their texts, and no text has line ends or control characters. With `--rate max` there is no grid, and
the seconds are those of the rows' times.

mdfreader 4.3 does not read groups of 17 to 24 channels that can be invalid; asammdf does.

## qdas

A folder with a file `STATION-portN.dfq` for each port with tips, in the Q-DAS ASCII transfer format (V12, 2015; K-fields of
AQDEF): lines `Kxxxx/n TEXT` end with CR LF, a line of values has character 15 between characteristics and character 20
between the fields of one. Decimal sign is the point. A file is pure ASCII, unless a product, an order or a serial is not:
then it is UTF-8 with a byte order mark. Foreign text stays on its line, has no control characters, and is cut to the length
of its field (`...`).

The specification is "Q-DAS ASCII Transfer Format", V12, and Hexagon's pages "Defined contents K00xx" (K0002, K0004) and
"Defined contents K2xxx" (K2004). jbclog holds no certificate of Q-DAS.
"""


def page() -> str:
    """The whole page."""
    sections = [
        *("### Part", table(("field", "meaning"), _fields(PART))),
        *("### Characteristics", table(("field", "meaning"), _fields(CHARACTERISTIC))),
        table(
            ("K2001", "K2002", "K2142", "meaning"),
            [_characteristic(one) for one in qdas.CHARACTERISTICS],
        ),
        (
            "`heat_j` and `energy_j` stand only in files of stations whose line file has"
            " `rated_power_w`."
        ),
        *("### Values", table(("field", "meaning"), _fields(VALUE))),
    ]
    return f"{MADE}\n\n# Exports\n{TEXT.format(mdf=mdf)}\n" + "\n\n".join(sections) + "\n"


def _fields(fields: dict[str, str]) -> list[tuple[str, str]]:
    return [(code(key), text) for key, text in fields.items()]


def _characteristic(one: qdas.Characteristic) -> tuple[str, str, str, str]:
    definition = SCHEMA_OF["joints"].field(one.column).metadata[b"definition"].decode()
    return code(one.column), one.text, one.unit, definition
