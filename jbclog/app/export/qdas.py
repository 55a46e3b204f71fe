"""Q-DAS: the features of joints as characteristics, a file (.dfq) for each port with tips.

The format is the Q-DAS ASCII transfer format, V12 (2015), of the AQDEF working group: `Kxxxx/n
TEXT` on a line, n the number of the characteristic; then a line for each joint, characteristics
separated by the character 15, their fields by 20: value (K0001), attribute (K0002), time (K0004).
Hexagon's pages "Defined contents K00xx" and "Defined contents K2xxx" repeat the contents of K0002,
K0004 and K2004. docs/reference/export.md lists what is written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.analysis.joints.port_rows import kind_of
from jbclog.analysis.run_joints import joints_of_port
from jbclog.app.export.source import SCHEMA_OF, Source
from jbclog.core.errors import UsageError
from jbclog.core.rows import StationFacts
from jbclog.core.text import BOM, REPLACEMENT, clean
from jbclog.record.chains import short_head
from jbclog.record.folder import recipe_table

BETWEEN_CHARACTERISTICS: Final = "\x0f"
BETWEEN_FIELDS: Final = "\x14"
VALID, NOT_EVALUATED, PLACEHOLDER = 0, 129, 255
"""K0002: a valid value; a value that is shown but not evaluated; a placeholder, which is not
shown.
"""
# written before the attribute 255: no joint has it, whatever a reader makes of the attribute
MISSING: Final = "-99999"
NO_LIMIT, LIMIT, NATURAL = 0, 1, 2
"""K2120 and K2121: type of a limit."""
UNDEFINED, TEMPERATURE, TIME = 0, 250, 800
"""K2009: measured quantity."""
DECIMALS: Final = 3  # as in the table of joints
JOINT: Final = "joint"  # kind of a certain joint
NOT_STATED: Final = "not stated"
OF_95_JOINTS: Final = (
    "The recipe limits the time of 95 of 100 joints (recovery_p95_s), not of each joint"
)


@dataclass(frozen=True, slots=True)
class Characteristic:
    """A feature of joints. `is_natural`: it cannot be below 0. `needs_power`: known only if the
    rated power is declared.
    """

    column: str
    text: str
    unit: str
    quantity: int = UNDEFINED
    is_natural: bool = True
    needs_power: bool = False


CHARACTERISTICS: Final = (
    Characteristic("dwell_s", "Dwell time", "s", TIME),
    Characteristic("recovery_s", "Recovery time", "s", TIME),
    Characteristic("depth_c", "Temperature drop", "degC", TEMPERATURE),
    Characteristic(
        "deficit_c", "Setpoint minus temperature at start", "degC", TEMPERATURE, is_natural=False
    ),
    Characteristic(
        "resting_below_c",
        "Resting level minus temperature at start",
        "degC",
        TEMPERATURE,
        is_natural=False,
    ),
    Characteristic("peak_permille", "Peak heat flow", "permille"),
    Characteristic("heat_permille_s", "Heat into the joint", "permille*s"),
    Characteristic("energy_permille_s", "Energy above holding power", "permille*s"),
    Characteristic("heat_j", "Heat into the joint", "J", needs_power=True),
    Characteristic("energy_j", "Energy above holding power", "J", needs_power=True),
)
"""Features for quality engineers; units in ASCII, so that a file reads the same in every code
page.
"""

LENGTHS: Final = {
    "K1001": 30,
    "K1002": 80,
    "K1004": 20,
    "K1053": 40,
    "K1081": 24,
    "K1082": 40,
    "K1342": 40,
    "K1900": 255,
}
"""Maximum lengths of fields with foreign text."""


def write(source: Source, folder: Path) -> dict[str, int]:
    """Write a file for each port with tips into a new folder; return the number of joints.

    Raises `OSError`, `UsageError`, `RecordError`.
    """
    ports = [
        (facts, port)
        for facts in source.run.stations
        if kind_of(facts) == "tip"
        for port in facts.ports
    ]
    if not ports:
        raise UsageError(
            f"{source.run.folder}: no station with tips, so no joints; Q-DAS takes features of"
            " joints"
        )
    folder.mkdir()
    for facts, port in ports:
        text = "\r\n".join(_lines(source, facts, port)) + "\r\n"
        with (folder / file_name(facts.name, port)).open("xb") as file:
            file.write((text if text.isascii() else BOM + text).encode())
    return {"joints": source.joints.num_rows}


def file_name(station: str, port: int) -> str:
    """Return the name of a port's file; characters that no station's name has become
    underscores.
    """
    return f"{re.sub('[^A-Za-z0-9._-]', '_', station)}-port{port}.dfq"


def _lines(source: Source, facts: StationFacts, port: int) -> Iterator[str]:
    chosen = [
        one for one in CHARACTERISTICS if facts.rated_power_w is not None or not one.needs_power
    ]
    yield f"K0100 {len(chosen)}"
    yield from _part(source, facts, port)
    limit = recovery_limit(source.run.folder, facts)
    for number, one in enumerate(chosen, 1):
        upper = limit if one.column == "recovery_s" else None
        yield from (f"{key}/{number} {text}" for key, text in _described(one, upper).items())
    yield from _values(joints_of_port(source.joints, facts.name, port), chosen)


def _part(source: Source, facts: StationFacts, port: int) -> Iterator[str]:
    """Yield the fields of the part: what was soldered, on which tool, in which run."""
    manifest, said = source.run.manifest, source.run.manifest.metadata
    recipe = next((one for one in manifest.recipes if one.file == facts.recipe), None)
    fields = {
        "K1001": said.product or NOT_STATED,
        "K1002": f"Joints of {facts.name} port {port}",
        "K1053": said.order,
        "K1081": f"{facts.name}:{port}",
        "K1082": facts.model,
        "K1204": _moment(manifest.start),
        "K1205": _moment(manifest.stop),
        "K1342": f"{recipe.name} revision {recipe.revision}" if recipe is not None else None,
        "K1900": _remark(source),
    }
    yield from (f"{key}/1 {_fitted(key, text)}" for key, text in fields.items() if text)


def _remark(source: Source) -> str:
    """Return the source of the values, most important first: run, fingerprint, verdict, ..."""
    facts = source.facts
    print_of = (
        short_head(facts["fingerprint"])
        if " " not in facts["fingerprint"]
        else facts["fingerprint"]
    )
    texts = [
        f"run {source.run.name}",
        f"fingerprint {print_of}",
        facts["exported by"],
        facts["integrity"],
        "times in UTC",
    ]
    texts += [f"{name} {facts[name]}" for name in ("verdict", "state", "tips") if name in facts]
    return "; ".join(texts)


def _described(one: Characteristic, upper: float | None) -> dict[str, str]:
    """Return the fields of a characteristic; `upper`: its upper limit, if the recipe has one."""
    definition = (SCHEMA_OF["joints"].field(one.column).metadata or {})[b"definition"].decode()
    lower = {"K2110": "0", "K2120": str(NATURAL)} if one.is_natural else {"K2120": str(NO_LIMIT)}
    above = (
        {"K2111": f"{upper:g}", "K2121": str(LIMIT)}
        if upper is not None
        else {"K2121": str(NO_LIMIT)}
    )
    return {
        "K2001": one.column,
        "K2002": one.text,
        "K2004": "0",
        "K2009": str(one.quantity),
        "K2022": str(DECIMALS),
        **dict(sorted({**lower, **above}.items())),
        "K2142": one.unit,
        "K2900": _ascii(definition if upper is None else f"{definition}. {OF_95_JOINTS}"),
    }


def _values(joints: pa.Table, chosen: list[Characteristic]) -> Iterator[str]:
    """Yield a line for each joint, and one with the serial of its unit (K0014, for all
    characteristics) if known.
    """
    for row in joints.to_pylist():
        time = _time(row["start"])
        yield BETWEEN_CHARACTERISTICS.join(
            _value(row[one.column], row["kind"], time) for one in chosen
        )
        if row["unit"]:
            yield f"K0014/0 {_fitted('K0014', row['unit'])}"


def _value(value: float | None, kind: str, time: str) -> str:
    if value is None:
        return BETWEEN_FIELDS.join([MISSING, str(PLACEHOLDER), time])
    return BETWEEN_FIELDS.join(
        [f"{value:.{DECIMALS}f}", str(VALID if kind == JOINT else NOT_EVALUATED), time]
    )


def _time(moment: datetime) -> str:
    return moment.strftime("%d.%m.%Y/%H:%M:%S")


def _moment(text: str | None) -> str | None:
    return None if text is None else _time(datetime.fromisoformat(text))


def _fitted(key: str, text: str) -> str:
    """Return foreign text on one line, without separators, cut to the field's length."""
    plain, most = clean(text).replace(REPLACEMENT, "?").strip(), LENGTHS.get(key, 40)
    return plain if len(plain) <= most else plain[: most - 3] + "..."


def _ascii(text: str) -> str:
    """Return one of our own texts in ASCII."""
    return text.replace("×", "*").replace("‰", "permille").replace("·", "*").replace("°C", "degC")


def recovery_limit(run: Path, facts: StationFacts) -> float | None:
    """Return the recipe's limit of recovery in s; None if it states none or cannot be read."""
    limit = recipe_table(run, facts, "acceptance").get("recovery_p95_s")
    return float(limit) if isinstance(limit, int | float) and not isinstance(limit, bool) else None
