"""Demonstration runs: some seconds of every station that there is a profile for, recorded with
their trouble and kept.

``python tests/support records.demonstration [NAME...]`` records them anew into tests/data/runs (all
of them, or those named): a line file, a recipe, what passed over the wire, and the decoded tables
as text. A test lives through each again and holds the tables against those. After a change to what
sessions ask or decide, record anew and read the difference that git shows.

A new profile in profiles/lines with one station is a new demonstration; it needs nothing but this
command.
"""

from __future__ import annotations

import csv
import io
import re
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from jbclog.config.line import load_line
from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS, CounterRow, EventRow, SettingRow
from support.virtual.captured_run import RECIPE_FILE, recorded
from support.virtual.virtual_run import Memory

RUNS = Path(__file__).parents[2] / "data" / "runs"
PROFILES = Path(__file__).parents[3] / "profiles"
TABLES = ("samples", "events", "settings", "counters")
PORT = "/dev/ttyUSB0"  # of a machine that there is not
HZ, SECONDS = 4.0, 6.0
SLOW_HZ, SLOW_SECONDS = 1.0, 14.0  # omega

TROUBLE = """
# what becomes of this demonstration

[[station.sim.fault]]
kind = "flip"
at_s = 0.5
every = 43

[[station.sim.fault]]
kind = "silence"
at_s = 1.0
only = "read"
every = 97

[[station.sim.fault]]
kind = "dropout"
at_s = {dropout_s}
for_s = 0.8
"""


def profiles() -> dict[str, Path]:
    """The line files of one station, by name."""
    paths = sorted((PROFILES / "lines").glob("*.toml"))
    return {path.stem: path for path in paths if len(load_line(path).stations) == 1}


def record(name: str) -> None:
    """Record one demonstration, in place of the one that is there."""
    path, folder = profiles()[name], RUNS / name
    (spec,) = load_line(path).stations
    assert spec.recipe is not None
    is_slow = spec.family == "omega"
    line = re.sub(r'^url = "[^"]*"', f'url = "{PORT}"', path.read_text(), flags=re.MULTILINE)
    line = re.sub(
        r'^recipe = "[^"]*"', f'recipe = "recipes/{RECIPE_FILE}"', line, flags=re.MULTILINE
    )
    line += TROUBLE.format(dropout_s=12.0 if is_slow else 5.0)
    if folder.exists():
        shutil.rmtree(folder)
    hz, seconds = (SLOW_HZ, SLOW_SECONDS) if is_slow else (HZ, SECONDS)
    run = recorded(folder, line, spec.recipe.read_text(), seconds, hz, allow_omega_write=is_slow)
    for table, text in tables_of(run.memory).items():
        (folder / f"{table}.csv").write_text(text)


def tables_of(memory: Memory) -> dict[str, str]:
    """The decoded tables as text; of the samples' columns those that hold anything."""
    filled = [
        name
        for name in SAMPLE_COLUMNS
        if any(row[COLUMN[name]] is not None for row in memory.samples)
    ]
    return {
        "samples": _text(
            filled, ([row[COLUMN[name]] for name in filled] for row in memory.samples)
        ),
        "events": _text(EventRow._fields, memory.events),
        "settings": _text(SettingRow._fields, memory.settings),
        "counters": _text(CounterRow._fields, memory.counters),
    }


def _text(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


if __name__ == "__main__":
    for name in sys.argv[1:] or profiles():
        record(name)
        print(RUNS / name)
