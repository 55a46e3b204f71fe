"""Two runs side by side, and that in words.

Stations are matched by their names, ports by their numbers; what only one run has is said. Metrics are those of `Run.metrics`; a
difference is the second minus the first, and is not known where one of them is not. Idle means are held against each other by
TOST (`spc.equivalence_of`) by the bounds of each (`judge.bound`), within a stated margin; one without a bound is not compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import asdict, dataclass
from difflib import unified_diff
from typing import Final

import pandas as pd

from jbclog.analysis import spc
from jbclog.analysis.run import Run
from jbclog.analysis.runs import WHAT_A_RATE_CHANGES, is_same_rate, rate_text
from jbclog.analysis.spc import Refused
from jbclog.analysis.verdict import measure
from jbclog.analysis.verdict.idle import IdleError
from jbclog.analysis.verdict.samples import Measures
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.record.find_runs import ending
from jbclog.record.folder import recipe_copy
from jbclog.record.manifest import Manifest

# -- compare ------------------------------------------------------------------------------------------------------------------

MARGIN_C: Final = 2.0
KEY: Final = ["station", "port"]
IDLE: Final = "idle_error_c"
SAID: Final = ("operator", "order", "product")


@dataclass(frozen=True, slots=True)
class Fact:
    """Something of which the runs say different things."""

    what: str
    first: str
    second: str


@dataclass(frozen=True, slots=True)
class SameIdle:
    """Whether the idle means of one port are equivalent."""

    station: str
    port: int
    result: spc.Equivalence | spc.Refused


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Tables with the columns `first` and `second`; `recipe` are the lines of a unified diff; `facts` what differs beside."""

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
    """Compare two sealed runs. Raises `RecordError` where one of them is not sealed, `UsageError` for a margin that is none."""
    for run in (first, second):
        if run.manifest.state != "sealed":
            raise RecordError(
                f"{run.folder} is not sealed; runs are compared when they have ended (`jbclog recover` ends a crashed one)"
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
    """A sentence for each station that was not sampled as often in both runs."""
    for before in one.stations:
        behind = two.station(before.name)
        if behind is None or None in (before.first_tick, behind.first_tick) or is_same_rate(before.period_s, behind.period_s):
            continue
        rates = f"{before.name}: sampled at {rate_text(before.period_s)} and at {rate_text(behind.period_s)}"
        yield f"{rates}; {WHAT_A_RATE_CHANGES}"


# -- what was said and asked --------------------------------------------------------------------------------------------------


def _facts(one: Manifest, two: Manifest) -> Iterator[Fact]:
    pairs = [(name, getattr(one.metadata, name), getattr(two.metadata, name)) for name in SAID]
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
        pairs += [(f"station {name}", "recorded" if a else "not in it", "recorded" if b else "not in it")]
        if a and b:
            rates = [None if side.first_tick is None else rate_text(side.period_s) for side in (a, b)]
            pairs += [(f"{name} rate", rates[0], rates[1])]
            pairs += [(f"{name} {what}", getattr(a, what), getattr(b, what)) for what in ("model", "software", "ports", "tools")]
    return (Fact(what, _told(a), _told(b)) for what, a, b in pairs if (a or None) != (b or None))


def _recipes(manifest: Manifest) -> str:
    return ", ".join(f"{one.name}@{one.revision}" for one in manifest.recipes)


def _told(value: object) -> str:
    return "not said" if value in (None, "", [], {}) else str(value)


def _recipe_difference(first: Run, second: Run) -> list[str]:
    """The lines in which the recipes differ, as a unified diff; empty where they are the same."""
    texts = [_recipe_texts(run) for run in (first, second)]
    lines: list[str] = []
    names = dict.fromkeys([*texts[0], *texts[1]])
    if len(texts[0]) == len(texts[1]) == 1:  # the file may have another name and be the same recipe
        pairs = [(next(iter(texts[0])), next(iter(texts[1])))]
    else:
        pairs = [(name, name) for name in names]
    for one, two in pairs:
        before, behind = texts[0].get(one, ""), texts[1].get(two, "")
        lines += unified_diff(
            before.splitlines(), behind.splitlines(), f"{first.name}/{one}", f"{second.name}/{two}", lineterm="", n=1
        )
    return lines


def _recipe_texts(run: Run) -> dict[str, str]:
    found = {}
    for recipe in run.manifest.recipes:
        try:
            found[recipe.file] = read_foreign(recipe_copy(run.folder, recipe.file), Kind.SETTINGS).decode(errors="replace")
        except OSError:
            found[recipe.file] = "(its copy cannot be read)"
    return found


# -- what was set and what came of it -----------------------------------------------------------------------------------------


def _settings(first: Run, second: Run) -> pd.DataFrame:
    """Settings of which the last reading differs, or that only one run read."""
    table = _side_by_side(_last_settings(first), _last_settings(second), [*KEY, "setting", "unit"])
    differs = table["first"].fillna("") != table["second"].fillna("")
    return table[differs].reset_index(drop=True)


def _last_settings(run: Run) -> pd.DataFrame:
    rows = run.settings()
    rows = rows[rows["readback"].notna()].assign(port=rows["port"].fillna(0).astype("int64"))
    last = rows.drop_duplicates([*KEY, "setting", "unit"], keep="last")
    return last[[*KEY, "setting", "unit", "readback"]].rename(columns={"readback": "value"})


def _metrics(first: Run, second: Run) -> pd.DataFrame:
    """Every metric of every port, and the difference where both are known."""
    one, two = (run.metrics()[[*KEY, "metric", "unit", "value"]] for run in (first, second))
    order = {name: place for place, name in enumerate(dict.fromkeys([*one["metric"], *two["metric"]]))}
    table = _side_by_side(one, two, [*KEY, "metric", "unit"])
    table["difference"] = table["second"] - table["first"]
    return table.sort_values(
        [*KEY, "metric"], key=lambda column: column.map(order) if column.name == "metric" else column
    ).reset_index(drop=True)


def _alarms(first: Run, second: Run) -> pd.DataFrame:
    """How many episodes each detector has, by port and side."""
    table = _side_by_side(_counted(first), _counted(second), [*KEY, "side", "detector"])
    return table.fillna({"first": 0, "second": 0})


def _counted(run: Run) -> pd.DataFrame:
    """Episodes by port, side and detector, from the objects, which also know how to be none."""
    episodes = [one for incident in run.alarm_findings().incidents for one in incident.episodes]
    counted = Counter((one.station, one.port, str(one.side), str(one.detector)) for one in episodes)
    rows = [(*place, count) for place, count in counted.items()]
    kinds = {"station": "str", "port": "int64", "side": "str", "detector": "str", "value": "Int64"}
    return pd.DataFrame(rows, columns=list(kinds)).astype(kinds)


def _side_by_side(one: pd.DataFrame, two: pd.DataFrame, on: list[str]) -> pd.DataFrame:
    texts = dict.fromkeys((name for name in on if name != "port"), object)  # pandas cannot join empty columns of Arrow's texts
    left, right = one.rename(columns={"value": "first"}).astype(texts), two.rename(columns={"value": "second"}).astype(texts)
    return left.merge(right, on=on, how="outer").sort_values(on, kind="stable").reset_index(drop=True)


# -- whether they are the same --------------------------------------------------------------------------------------------------


def _idle(first: Run, second: Run, margin_c: float) -> Iterator[SameIdle]:
    one, two = (_measures(run) for run in (first, second))
    for station, port in sorted(one.keys() & two.keys()):
        yield SameIdle(station, port, _same_idle(one[station, port].idle, two[station, port].idle, margin_c))


def _same_idle(first: IdleError, second: IdleError, margin_c: float) -> spc.Equivalence | spc.Refused:
    """TOST of two idle errors by their bounds, or why one of them has none."""
    means = []
    for idle, which in ((first, "first"), (second, "second")):
        found = idle.known()
        if isinstance(found, str):
            return spc.Refused("too_few", f"The {which} run's idle error has no bound. {found}")
        means.append(spc.Mean(idle.mean_c or 0.0, found.half))
    return spc.equivalence_of(means[0], means[1], margin_c)


def _measures(run: Run) -> Measures:
    tell = {facts.name: facts for facts in run.manifest.stations if not facts.signals or "temperature_c" in facts.signals}
    return measure(run.folder, tell)


# -- compare words ------------------------------------------------------------------------------------------------------------
# Two runs side by side in words: lines for a terminal, facts for JSON.


def lines(found: Comparison) -> Iterator[str]:
    """Everything that differs, and the metrics."""
    yield f"first   {found.first.folder}"
    yield f"second  {found.second.folder}"
    yield from (f"warning: {text}" for text in found.warnings)
    yield from (f"{one.what}: {one.first} | {one.second}" for one in found.facts)
    yield from ["", "The recipes differ:", *found.recipe] if found.recipe else ["", "The recipes are the same."]
    if len(found.settings):
        yield from ("", "Settings as read back, first | second:")
        for row in found.settings.to_dict("records"):
            place = f"{row['station']} port {row['port']}" if row["port"] else row["station"]
            yield f"  {place}  {row['setting']}: {_or_none(row['first'])} | {_or_none(row['second'])} {row['unit']}"
    yield from ("", "Metrics, first | second (difference):")
    yield from _metric_lines(found)
    yield from ("", "Alarm episodes, first | second:")
    yield from _alarm_lines(found)
    yield from ("", f"Idle means, second minus first, within ±{found.margin_c:g} °C:")
    yield from (f"  {one.station} port {one.port}: {idle_text(one)}" for one in found.idle)


def _metric_lines(found: Comparison) -> Iterator[str]:
    place = None
    for row in found.metrics.itertuples():
        if (row.station, row.port) != place:
            place = row.station, row.port
            yield f"  {row.station} port {row.port}"
        if not (_is_none(row.first) and _is_none(row.second)):
            apart = "" if _is_none(row.difference) else f"  ({_figure(row.difference)})"
            yield f"    {row.metric:28} {_figure(row.first):>10} | {_figure(row.second):<10} {row.unit}{apart}"


def _alarm_lines(found: Comparison) -> Iterator[str]:
    if not len(found.alarms):
        yield "  none in either"
    for row in found.alarms.itertuples():
        yield f"  {row.station} port {row.port}  {row.side}, detector {row.detector}: {row.first} | {row.second}"


def idle_text(one: SameIdle) -> str:
    """The result of the tests in a sentence."""
    if isinstance(one.result, Refused):
        return f"not known. {one.result.text}"
    told = one.result
    return f"{told.verdict}: {told.difference:+.2f} °C, 90 % interval {told.low:+.2f} to {told.high:+.2f} °C (p = {told.p:.2g})"


def _figure(value: object) -> str:
    """Of a number, or of something that stands for none."""
    return f"{value:.4g}" if isinstance(value, int | float) and not _is_none(value) else "-"


def _or_none(value: object) -> str:
    return "not read" if _is_none(value) else str(value)


def _is_none(value: object) -> bool:
    return value is None or value is pd.NA or (isinstance(value, float) and value != value)


def facts(found: Comparison) -> dict[str, object]:
    """As one JSON object."""
    tables = {name: getattr(found, name) for name in ("settings", "metrics", "alarms")}
    rows = {name: [_plain(row) for row in table.to_dict("records")] for name, table in tables.items()}
    idle = [{"station": one.station, "port": one.port, **_result(one)} for one in found.idle]
    head = {"first": str(found.first.folder), "second": str(found.second.folder), "margin_c": found.margin_c}
    head["warnings"] = found.warnings
    return {**head, "facts": [asdict(one) for one in found.facts], "recipe": found.recipe, **rows, "idle": idle}


def _plain(row: Mapping[Hashable, object]) -> dict[str, object]:
    return {str(name): None if _is_none(cell) else cell for name, cell in row.items()}


def _result(one: SameIdle) -> dict[str, object]:
    if isinstance(one.result, Refused):
        return {"verdict": "not known", "refused": asdict(one.result)}
    return {"verdict": one.result.verdict, **asdict(one.result)}
