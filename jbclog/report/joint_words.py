"""The joints of a report in rows and sentences, from the facts as plain data, for page and
paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from jbclog.analysis.verdict.evidence import joints_not_known
from jbclog.core.text import number
from jbclog.report.text import RowView, items, mapping, measured

# share of joints that the next one followed before the tip recovered
NEVER, SELDOM = 0.95, 0.5
ENOUGH: Final = 5  # joints below which no share is stated
REFUSED: Final = {
    "too_few": "too few joints",
    "unresolved": "their spread is that of the resolution",
    "autocorrelated": "neighbours are alike",
    "not_recovered": "too many joints without recovery",
}
NOTE: Final = (
    "Found by the tip's heat balance; nothing here says that a joint is good. Recovery: from a"
    " joint's start until the tip is back at the level at which it rests; a joint that the next one"
    " follows before that counts as longer (Kaplan and Meier 1958). The idle error is how far that"
    " level lies from the setpoint. Deficit: setpoint minus temperature at the start. Deficit,"
    " depth, dwell and heat: medians."
)


def jointed(report: Mapping[str, object]) -> list[RowView]:
    """Return a row for each port in which joints were searched: `station`, `port` and `joints`."""
    return [
        {"station": station["name"], "port": port["port"], "joints": port["joints"]}
        for station in items(report["stations"])
        for port in items(station["ports"])
        if port["joints"] is not None
    ]


def never_back(late: int, seen: int, deficit_c: float | None) -> str | None:
    """Return a sentence if most joints begin before the tip recovered; `late`: how many of the
    `seen` recoveries.
    """
    if seen < ENOUGH or late < SELDOM * seen:
        return None
    how = "never lets the tip recover" if late == seen else "hardly ever lets the tip recover"
    how = how if late >= NEVER * seen else "seldom lets the tip recover"
    begins = (
        ""
        if deficit_c is None or deficit_c < 0.5
        else f"; joints begin {deficit_c:.0f} °C below the setpoint (median)"
    )
    return (
        f"This line {how}: after {late} of {seen} joints the next one began before the tip was"
        f" back{begins}."
    )


def never_back_at(rows: Sequence[RowView]) -> list[str]:
    """Return these sentences of all ports, each with its place."""
    found = [(row, mapping(row["joints"]).get("never_back")) for row in rows]
    return [f"{_place(row)}: {text}" for row, text in found if text is not None]


def _place(row: RowView) -> str:
    return f"{row['station']} port {row['port']}"


def found_with(rows: Sequence[RowView]) -> list[str]:
    """Return what counts as a joint, what of it was learned from the run, and where the feeder
    decides: a sentence each.
    """
    texts: dict[str, list[str]] = {}
    fed: list[str] = []
    for row in rows:
        taken = mapping(mapping(row["joints"]).get("taken"))
        if taken:
            texts.setdefault(_found_with(taken), []).append(_place(row))
            fed += [_place(row)] if taken["wire_decides"] else []
    criteria = (
        list(texts)
        if len(texts) == 1
        else [f"{', '.join(places)}: {text}" for text, places in texts.items()]
    )
    return [
        *criteria,
        *_regular(rows),
        *([f"Each feed of the feeder is a joint: {', '.join(fed)}."] if fed else []),
    ]


def _regular(rows: Sequence[RowView]) -> list[str]:
    """Return the regular interval of joints that the run shows, if the recipe states none."""
    places: dict[str, list[str]] = {}
    for row in rows:
        taken = mapping(mapping(row["joints"]).get("taken"))
        if taken and taken.get("expected_every_s") is None:
            every = taken.get("every_s")
            text = "not regular or too few" if every is None else f"{number(every, 1)} s"
            places.setdefault(text, []).append(_place(row))
    if not places:
        return []
    parts = (
        list(places)
        if len(places) == 1
        else [f"{text} ({', '.join(ports)})" for text, ports in places.items()]
    )
    text = "Time between joint starts, learned from the run (the recipe sets no expected_every_s)"
    return [f"{text}: {'; '.join(parts)}. Not used to find joints."]


def _found_with(taken: RowView) -> str:
    learnt = [str(name) for name in items(taken.get("learnt"))]
    expected = taken.get("expected_every_s")
    parts = [
        f"A joint lasts {measured(taken['least_dwell_s'], 's')} or more",
        f"contacts less than {measured(taken['merge_gap_s'], 's')} apart are one",
        f"the tip is back within {measured(taken['recovered_within_c'], '°C')}",
        *([] if expected is None else [f"one is expected every {measured(expected, 's')}"]),
    ]
    by_run = (
        f" Learned from the run, as the recipe's [joints] does not set them: {', '.join(learnt)}."
        if learnt
        else ""
    )
    return f"{'; '.join(parts)}.{by_run}"


def heat(row: RowView) -> str:
    """Return the median heat of a joint, in joules if watts are known."""
    figures = mapping(mapping(row["joints"])["figures"])
    joules, relative = (
        mapping(figures[name])["value"] for name in ("joint_heat_j", "joint_heat_permille_s")
    )
    if joules is not None:
        return f"{number(joules, 1)} J"
    return "–" if relative is None else f"{number(relative, 0)} ‰·s"


def idle(row: RowView) -> str:
    """Return the idle error of the port."""
    error = mapping(mapping(mapping(row["joints"])["figures"]).get("idle_error_c")).get("value")
    return "not known" if not isinstance(error, float) else f"{number(round(error, 1), 1)} °C"


def count(row: RowView) -> str:
    """Return the number of joints; not known if the record has gaps."""
    joints = mapping(row["joints"])
    known = mapping(mapping(joints["figures"])["joints"])["value"]
    return number(joints["found"]) if known is not None else "not known"


def remark(row: RowView) -> str:
    """Return why the count is not known, whether the tip recovers, what may not be a joint, and the
    result of the chart.
    """
    joints = mapping(row["joints"])
    figures = mapping(joints["figures"])
    parts = [
        _not_known(joints),
        joints["never_back"],
        _kind(figures),
        *_feeds(figures),
        _chart(joints),
    ]
    return " ".join(str(part) for part in parts if part)


def _not_known(joints: RowView) -> str | None:
    why = mapping(mapping(joints["figures"])["joints"])["why"]
    return None if why is None else joints_not_known(str(why), are_some=bool(joints["found"]))


def _kind(figures: RowView) -> str | None:
    unknown, alone = (
        _value(figures, name) for name in ("joints_kind_not_known", "joints_fed_alone")
    )
    drawn = (unknown or 0.0) - (alone or 0.0)
    if drawn <= 0:
        return None
    return (
        f"{drawn:.0f} may be {'wipes or touches' if drawn != 1 else 'a wipe or a touch'} without"
        " solder: kind not known."
    )


def _feeds(figures: RowView) -> list[str]:
    """Return how joints by heat and feeds compare; nothing without a feeder."""
    feeds, alone = _value(figures, "joints_by_feeder"), _value(figures, "joints_fed_alone")
    if feeds is None:
        return []
    heat, without, draws = (
        _value(figures, name)
        for name in ("joints_by_heat", "feeds_without_draw", "draws_without_feed")
    )
    only = f" {alone:.0f} of the joints by the feeder alone." if alone else ""
    if heat is None or without is None or draws is None:
        return [f"Feeds: {feeds:.0f}; joints by heat: not known.{only}"]
    beside = f"feeds without a draw of heat: {without:.0f}; draws without a feed: {draws:.0f}"
    return [f"Joints by heat: {heat:.0f}; feeds: {feeds:.0f}; {beside}.{only}"]


def _value(figures: RowView, name: str) -> float | None:
    value = mapping(figures.get(name)).get("value")
    return float(value) if isinstance(value, int | float) else None


def _chart(joints: RowView) -> str | None:
    if not joints["found"]:
        return None if _not_known(joints) else "No joints were found."
    if joints["signals"] is None:
        return (
            f"Chart without limits: {REFUSED.get(str(joints['refused_kind']), 'see its caption')}."
        )
    if not joints["signals"]:
        return "No point out of the ordinary."
    return f"{joints['signals']} point{'s' if joints['signals'] != 1 else ''} out of the ordinary."
