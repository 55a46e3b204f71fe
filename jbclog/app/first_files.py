"""A first line file and its recipes, from user input or the result of a scan. Opens nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.config.line import Described, StationTable, line_text, parse_line
from jbclog.config.load_recipe import parse_recipe
from jbclog.protocol.commands.family import FAMILIES, OMEGA

LINE: Final = "line.toml"
HEADING: Final = (
    "Written by jbclog init. One [[station]] for each station; more keys stand in the"
    " documentation, Files and keys."
)


class Kind(NamedTuple):
    """A kind of stations that share a recipe: the question for their temperature, its usual and
    allowed values, and the sections.
    """

    name: str
    question: str | None
    usual_c: int
    allowed_c: range
    sections: str


TIPS: Final = Kind(
    "tips",
    "Tip temperature, °C",
    350,
    range(90, 451, 5),
    """
[temperature]
select_c = {celsius}                # what the tip is set to, in steps of 5

[run]
status = "working"            # ordered once every setting is confirmed
safe_state = "stand"          # ordered at the end of a run, however it ends
""",
)
AIR: Final = Kind(
    "hot-air",
    "Air temperature, °C",
    300,
    range(50, 601),
    """
[air]
mode = "manual"
temperature_c = {celsius}           # of the air

[run]
status = "on"                 # heater and pump, ordered once every setting is confirmed
safe_state = "cooling"        # heater off, pump on: ordered at the end of a run, however it ends
""",
)
STATES: Final = Kind("omega", None, 0, range(0), "")
AFTER: Final = """
[sampling]
rate_hz = "auto"              # the highest rate that leaves a fifth of the link free

[acceptance]                  # what the verdict rests on
coverage_percent = 99.5       # of the readings that were due
longest_gap_s = 5             # s without a reading
"""


def kind_of(family: str) -> Kind:
    return {"jtse": AIR, OMEGA: STATES}.get(family, TIPS)


def kinds_of(stations: Sequence[Described]) -> list[Kind]:
    """Return the kinds of these stations; each gets a recipe of its own."""
    return list(dict.fromkeys(kind_of(station.family) for station, _ in stations))


def station(name: str, url: str, family: str) -> Described:
    """Return a station named by a person, with the usual line format of its family."""
    usual: dict[str, object] = {"baudrate": 9600, "address": False} if family == OMEGA else {}
    return (
        StationTable.model_validate({"name": name, "url": url, "family": family, **usual}),
        FAMILIES[family].title,
    )


def files(
    stations: Sequence[Described], name: str, celsius: Mapping[str, int], folder: Path
) -> Iterator[tuple[Path, str]]:
    """Yield path and text of the line file, then of its recipes. `celsius`: kind's name -> °C.

    Raises `Problems`.
    """
    kinds = kinds_of(stations)
    paths = {
        kind: Path("recipe.toml" if len(kinds) == 1 else f"recipe-{kind.name}.toml")
        for kind in kinds
    }
    with_recipe = [
        (one.model_copy(update={"recipe": paths[kind_of(one.family)]}), text)
        for one, text in stations
    ]
    line = line_text("line", with_recipe, HEADING)
    parse_line(line, folder / LINE)
    yield folder / LINE, line
    for kind, path in paths.items():
        families = sorted({one.family for one, _ in stations if kind_of(one.family) is kind})
        yield (
            folder / path,
            _recipe(
                f"{name}-{kind.name}" if len(kinds) > 1 else name,
                families,
                kind,
                celsius.get(kind.name),
            ),
        )


def _recipe(name: str, families: Sequence[str], kind: Kind, celsius: int | None) -> str:
    listed = ", ".join(f'"{family}"' for family in families)
    head = (
        f'[recipe]\nname = "{name}"\nrevision = 1                  # raise it with every'
        f" change\nfamilies = [{listed}]\n"
    )
    text = f"{head}{kind.sections.format(celsius=celsius)}{AFTER}"
    parse_recipe(text)
    return text
