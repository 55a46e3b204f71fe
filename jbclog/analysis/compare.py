"""Compares two runs: metadata, recipe, settings, metrics, alarms, and whether their idle
temperatures are equivalent.

Stations are matched by name, ports by number. Metrics are those of `Run.metrics`; a difference is
the second minus the first, unknown if one of them is. Idle means are compared by two one-sided
tests (`spc.equivalence_of`), with the bounds of each (`verdict/bounds.py`), within a stated margin;
a mean without a bound is not compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import unified_diff
from typing import Final

import numpy as np
import pandas as pd

from jbclog.analysis import spc
from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.run import Run
from jbclog.analysis.runs import WHAT_A_RATE_CHANGES, is_same_rate, rate_text
from jbclog.analysis.verdict.idle import IdleError
from jbclog.analysis.verdict.samples import Measures, columns_for, measures_of
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.text import exact
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS
from jbclog.record.find_runs import ending
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import Manifest

MARGIN_C: Final = 2.0
KEY: Final = ["station", "port"]
METADATA: Final = ("operator", "order", "product")


@dataclass(frozen=True, slots=True)
class Fact:
    """A fact that differs between the runs, with its two values as text."""

    what: str
    first: str
    second: str


@dataclass(frozen=True, slots=True)
class SameIdle:
    """Whether the idle means of a port are equivalent, or why this is not known."""

    station: str
    port: int
    result: spc.Equivalence | spc.Refused


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The differences between two runs. The tables have columns `first` and `second`; `recipe` has
    the lines of a unified diff.
    """

    first: Run
    second: Run
    facts: list[Fact]
    recipe: list[str]
    settings: pd.DataFrame
    metrics: pd.DataFrame
    alarms: pd.DataFrame
    idle: list[SameIdle]
    margin_c: float
    warnings: list[str]


def compare(first: Run, second: Run, margin_c: float = MARGIN_C) -> Comparison:
    """Compare two sealed runs; `margin_c` in °C is the largest difference of idle means that counts
    as equivalent.

    Raises `RecordError` for a run that is not sealed, `UsageError` for a margin that is not above
    0.
    """
    for run in (first, second):
        if not run.manifest.is_sealed:
            raise RecordError(
                f"{run.folder} is not sealed; compare it when it has ended (`jbclog recover` ends a"
                " crashed run)"
            )
    one, two = first.manifest, second.manifest
    return Comparison(
        first,
        second,
        list(_facts(one, two)),
        _recipe_difference(first, second),
        _settings(first, second),
        _metrics(first, second),
        _alarms(first, second),
        list(_idle(first, second, margin_c)),
        margin_c,
        list(_other_rates(one, two)),
    )


def _other_rates(one: Manifest, two: Manifest) -> Iterator[str]:
    """Yield a sentence for each station with another sampling rate in the second run."""
    for first in one.stations:
        second = two.station(first.name)
        if (
            second is None
            or None in (first.first_tick, second.first_tick)
            or is_same_rate(first.period_s, second.period_s)
        ):
            continue
        rates = (
            f"{first.name}: sampled at {rate_text(first.period_s)} and at"
            f" {rate_text(second.period_s)}"
        )
        yield f"{rates}; {WHAT_A_RATE_CHANGES}"


def _facts(one: Manifest, two: Manifest) -> Iterator[Fact]:
    pairs = [(name, getattr(one.metadata, name), getattr(two.metadata, name)) for name in METADATA]
    pairs += [
        ("line", one.line and one.line.name, two.line and two.line.name),
        ("recipe", _recipes(one), _recipes(two)),
        ("wire lots", ", ".join(one.metadata.wire_lots), ", ".join(two.metadata.wire_lots)),
        ("flux lots", ", ".join(one.metadata.flux_lots), ", ".join(two.metadata.flux_lots)),
        ("tips", ", ".join(one.metadata.tips), ", ".join(two.metadata.tips)),
        ("rate", one.rate, two.rate),
        ("jbclog", one.host.get("jbclog"), two.host.get("jbclog")),
        ("verdict", one.verdict, two.verdict),
        ("state", ending(one.exit_status, one.state), ending(two.exit_status, two.state)),
    ]
    for name in sorted({facts.name for facts in (*one.stations, *two.stations)}):
        a, b = one.station(name), two.station(name)
        pairs += [
            (
                f"station {name}",
                "recorded" if a else "not recorded",
                "recorded" if b else "not recorded",
            )
        ]
        if a and b:
            rates = [
                None if side.first_tick is None else rate_text(side.period_s) for side in (a, b)
            ]
            pairs += [(f"{name} rate", rates[0], rates[1])]
            pairs += [
                (f"{name} {what.replace('_', ' ')}", getattr(a, what), getattr(b, what))
                for what in ("model", "software", "ports", "tool_names")
            ]
    return (Fact(what, _text(a), _text(b)) for what, a, b in pairs if (a or None) != (b or None))


def _recipes(manifest: Manifest) -> str:
    return ", ".join(f"{one.name}@{one.revision}" for one in manifest.recipes)


def _text(value: object) -> str:
    return "not stated" if value in (None, "", [], {}) else str(value)


def _recipe_difference(first: Run, second: Run) -> list[str]:
    """Return a unified diff of the recipes; empty if they are the same."""
    texts = [_recipe_texts(run) for run in (first, second)]
    lines: list[str] = []
    names = dict.fromkeys([*texts[0], *texts[1]])
    if len(texts[0]) == len(texts[1]) == 1:  # the same recipe may have another file name
        pairs = [(next(iter(texts[0])), next(iter(texts[1])))]
    else:
        pairs = [(name, name) for name in names]
    for one, two in pairs:
        before, after = texts[0].get(one, "").splitlines(), texts[1].get(two, "").splitlines()
        lines += unified_diff(
            before, after, f"{first.name}/{one}", f"{second.name}/{two}", lineterm="", n=1
        )
    return lines


def _recipe_texts(run: Run) -> dict[str, str]:
    found = {}
    for recipe in run.manifest.recipes:
        try:
            found[recipe.file] = read_regular(
                recipe_copy(run.folder, recipe.file), Kind.SETTINGS
            ).decode(errors="replace")
        except OSError:
            found[recipe.file] = "(its copy cannot be read)"
    return found


def _settings(first: Run, second: Run) -> pd.DataFrame:
    """Return the settings whose last reading differs or that only one run read."""
    table = _side_by_side(_last_settings(first), _last_settings(second), [*KEY, "setting", "uom"])
    differs = table["first"].fillna("") != table["second"].fillna("")
    return table[differs].reset_index(drop=True)


def _last_settings(run: Run) -> pd.DataFrame:
    rows = run.settings()
    rows = rows[rows["readback"].notna()].assign(port=rows["port"].fillna(0).astype("int64"))
    last = rows.drop_duplicates([*KEY, "setting", "uom"], keep="last")
    return last[[*KEY, "setting", "uom", "readback"]].rename(columns={"readback": "value"})


def _metrics(first: Run, second: Run) -> pd.DataFrame:
    """Return each metric of each port, with the difference where both values are known."""
    one, two = (run.metrics()[[*KEY, "metric", "uom", "value"]] for run in (first, second))
    order = {
        name: place for place, name in enumerate(dict.fromkeys([*one["metric"], *two["metric"]]))
    }
    table = _side_by_side(one, two, [*KEY, "metric", "uom"])
    before, after = (
        table[name].to_numpy(dtype=np.float64, na_value=np.nan) for name in ("first", "second")
    )
    sizes = np.fmax(np.abs(before), np.abs(after))
    table["difference"] = [
        exact(float(left), float(size)) for left, size in zip(after - before, sizes, strict=True)
    ]
    return table.sort_values(
        [*KEY, "metric"],
        key=lambda column: column.map(order) if column.name == "metric" else column,
    ).reset_index(drop=True)


def _alarms(first: Run, second: Run) -> pd.DataFrame:
    table = _side_by_side(_counted(first), _counted(second), [*KEY, "side", "detector"])
    return table.fillna({"first": 0, "second": 0})


def _counted(run: Run) -> pd.DataFrame:
    """Return the number of episodes by port, side and detector; typed columns even if empty."""
    episodes = [one for incident in run.alarm_findings().incidents for one in incident.episodes]
    counts = Counter((one.station, one.port, str(one.side), str(one.detector)) for one in episodes)
    rows = [(*key, count) for key, count in counts.items()]
    kinds = {"station": "str", "port": "int64", "side": "str", "detector": "str", "value": "Int64"}
    return pd.DataFrame(rows, columns=list(kinds)).astype(kinds)


def _side_by_side(one: pd.DataFrame, two: pd.DataFrame, on: list[str]) -> pd.DataFrame:
    # pandas cannot join empty columns of Arrow strings
    texts = dict.fromkeys((name for name in on if name != "port"), object)
    left = one.rename(columns={"value": "first"}).astype(texts)
    right = two.rename(columns={"value": "second"}).astype(texts)
    return (
        left.merge(right, on=on, how="outer").sort_values(on, kind="stable").reset_index(drop=True)
    )


def _idle(first: Run, second: Run, margin_c: float) -> Iterator[SameIdle]:
    one, two = (_measures(run) for run in (first, second))
    for station, port in sorted(one.keys() & two.keys()):
        yield SameIdle(
            station, port, _same_idle(one[station, port].idle, two[station, port].idle, margin_c)
        )


def _same_idle(
    first: IdleError, second: IdleError, margin_c: float
) -> spc.Equivalence | spc.Refused:
    """Test two idle errors by their bounds, or return why one of them has none."""
    means = []
    for idle, which in ((first, "first"), (second, "second")):
        found = idle.bounds()
        if isinstance(found, str):
            return spc.Refused("too_few", f"The {which} run's idle error has no bound. {found}")
        means.append(spc.Mean(idle.mean_c or 0.0, found.half))
    return spc.equivalence_of(means[0], means[1], margin_c)


def _measures(run: Run) -> Measures:
    with_temperature = {
        one.name: one
        for one in run.manifest.stations
        if not one.signals or "temperature_c" in one.signals
    }
    samples = run.samples_by_port(columns_for(with_temperature))
    steps = steps_in(run.groups("events", STEP_COLUMNS))
    return measures_of(samples, with_temperature, steps)
