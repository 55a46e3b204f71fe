"""Values of a fleet's audit, made without a ledger: what the page is drawn from, in every condition
that it has to show.
"""

from __future__ import annotations

import random
from dataclasses import replace
from datetime import timedelta
from functools import cache
from math import inf

from jbclog.maintenance.counter_totals.observed import Count, Errors, Fact, Identity
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import Difference, DifferenceKind, Trace
from jbclog.maintenance.due import Due, State, TaskState
from jbclog.maintenance.fleet import BEFORE, FLEET, Drift, FleetAudit, Meter, StationAudit
from jbclog.maintenance.use import Past, use_of
from jbclog.maintenance.weeks import weeks_of
from support.fleets.counters import NOW, ago, between, went

LIVES = (
    ("tip-change", "Tip change", 1, "work_h", "h", 400.0),
    ("tip-change", "Tip change", 2, "work_h", "h", 400.0),
    ("handle", "Handpiece", 1, "plugged_h", "h", 6000.0),
    ("stand", "Stand switch", 1, "sleep_cycles", "count", 12_000.0),
    ("rollers", "Feeder rollers", 1, "dispensed_mm", "mm", 900_000.0),
    ("verification", "Tip temperature verified", None, "days", "d", 90.0),
)


UNITS = {"les": "count", "_mm": "mm"}


def on(days: float) -> str:
    return (NOW + timedelta(days=days)).date().isoformat()


def task(
    at: int, percent: float, *, doubt: float = 0.5, pace: float = 0.4, audits: int = 9
) -> TaskState:
    """The task of that number, used so far, with a due range from a pace in per cent a day."""
    name, title, port, counter, unit, life = LIVES[at % len(LIVES)]
    used = Interval(max(percent - doubt, 0) * life / 100, (percent + doubt) * life / 100)
    states = {120: State.OVERDUE, 100: State.DUE, 80: State.SOON}
    state = next((state for limit, state in states.items() if percent >= limit), State.FINE)
    days = (100 - percent) / pace
    due = (
        None
        if audits < 4 or days < 0
        else Due(on(days * 0.85), on(days), on(days * 1.2) if days < 400 else None)
    )
    why = "" if due else f"not enough data: {audits} of 4 audits" if audits < 4 else ""
    found = TaskState(
        name,
        title,
        port,
        counter,
        unit,
        life,
        used,
        used.per(life / 100),
        state,
        ago(120),
        at % 2 == 0,
    )
    return replace(found, due=due, why=why, part="T-0231" if counter == "work_h" else "")


def unknown_task(at: int) -> TaskState:
    found = task(at, 50)
    return replace(
        found,
        used=Interval(120, inf),
        percent=Interval(30, inf),
        state=State.UNKNOWN,
        due=None,
        why="a reset lost hours",
    )


def station(
    name: str,
    seed: int,
    *,
    hours: float = 5.0,
    tasks: tuple[TaskState, ...] | None = None,
    audits: int = 60,
) -> StationAudit:
    """A station of some years, read every week, that works about so many hours a day."""
    chance = random.Random(seed)
    past = Past(_series(chance, hours, audits), (), ago(0), 130)
    weeks = weeks_of([past.traces[1, "work_h"]], ago(0))
    chosen = (
        tasks
        if tasks is not None
        else tuple(
            task(at, chance.uniform(5, 78), pace=chance.uniform(0.1, 0.9)) for at in range(6)
        )
    )
    meters = tuple(
        Meter(
            port,
            counter,
            UNITS.get(counter[-3:], "h"),
            _read(one.differences[-1]),
            one.counter_total,
            one.differences[-1],
            None,
        )
        for (port, counter), one in past.traces.items()
    )
    url, model = f"/dev/serial/by-id/usb-{name}", ("ALE", "DDE", "DME")[seed % 3]
    told = Identity(model.lower(), model, "0203456")
    return StationAudit(
        "bench-3",
        name,
        url,
        True,
        "",
        "wire",
        ago(0),
        audits,
        told,
        meters,
        chosen,
        use_of(past),
        Errors("ok", {1: "ok"}),
        weeks=weeks,
    )


def _series(chance: random.Random, hours: float, audits: int) -> dict[tuple[int, str], Trace]:
    days = [7.0 * week for week in range(audits - 1, -1, -1)]
    plugged, work, feeds = [2000.0], [900.0], [31_000.0]
    for _ in days[1:]:
        worked = 7 * hours * chance.uniform(0.6, 1.2)
        plugged.append(plugged[-1] + 7 * 9)
        work.append(work[-1] + worked)
        feeds.append(feeds[-1] + round(worked * chance.uniform(60, 130)))
    rest = [0.7 * (on_h - worked) for on_h, worked in zip(plugged, work, strict=True)]
    columns = {
        "plugged_h": plugged,
        "work_h": work,
        "sleep_h": rest,
        "hibernation_h": [0.1 * one for one in rest],
        "no_tool_h": [0.05 * one for one in plugged],
        "dispensed_cycles": feeds,
        "dispensed_mm": [4.9 * one for one in feeds],
    }
    read = {name: [float(int(one)) for one in column] for name, column in columns.items()}
    return {
        (1, name): went(name, list(zip(days, column, strict=True))) for name, column in read.items()
    }


def _read(last: Difference) -> Count:
    return Count(1, last.counter, "h", last.after, values=(last.after, last.after))


def fleet(*stations: StationAudit, **more: object) -> FleetAudit:
    whole = FleetAudit(
        "bench-3", NOW.isoformat(), "counters.jsonl", "8f14e45fceea167a" * 4, stations
    )
    return replace(whole, **more)  # type: ignore[arg-type]


@cache
def three() -> FleetAudit:
    """A line where something is to be done."""
    first = station(
        "ale-1", 0, hours=5, tasks=(task(0, 131), task(4, 88, pace=0.7), task(2, 34), task(5, 61))
    )
    second = station("dde-1", 1, hours=3, tasks=(task(0, 84, pace=0.5), task(1, 22), task(3, 71)))
    third = station("dde-2", 2, hours=2, tasks=(task(0, 41), task(5, 20)))
    facts = (
        Fact(
            ago(120),
            ago(120),
            "M. Weber",
            "bench-3",
            "dde-1",
            "tip-change",
            1,
            "T-0231",
            "worn at the edge",
        ),
    )
    return fleet(first, second, third, facts=facts)


@cache
def trouble() -> FleetAudit:
    """A fleet of eight in which everything that can go wrong did."""
    reset = between(
        "work_h",
        (7, 941),
        (0, 12),
        kind=DifferenceKind.RESET,
        delta=Interval(12, 121),
        rule="fell together",
        text="Four counters of the port fell together: it was reset.",
    )
    over = between(
        "dispensed_cycles",
        (14, 99_917),
        (7, 44),
        kind=DifferenceKind.ROLL_OVER,
        delta=Interval(127, 127),
        rule="five digits",
        text="It fell alone, and with 100000 more it went on at its pace.",
    )
    wild = between(
        "plugged_h",
        (7, 400),
        (0, 1220),
        kind=DifferenceKind.IMPOSSIBLE,
        delta=Interval(0, 169),
        rule="faster than time",
        text="820 h more in 168 h: nothing can count so.",
    )
    lost = between(
        "dispensed_cycles",
        (7, 4000),
        (0, 31),
        kind=DifferenceKind.SUSPECT,
        delta=Interval(31, inf),
        rule="fell alone",
        text="It fell, and nothing tells why.",
    )
    made = [
        station(f"line3-{name}", seed, hours=1 + seed)
        for seed, name in enumerate(("ale", "dde-a", "dde-b", "dde-c", "dme", "hde", "nae", "jtse"))
    ]
    made[0] = _marked(
        replace(
            made[0],
            tasks=(task(0, 142), task(4, 121), task(1, 104), task(3, 96, pace=0.2), task(2, 83)),
        ),
        over,
    )
    made[1] = _marked(
        replace(
            made[1],
            tasks=(unknown_task(0), task(1, 30)),
            notes=("port 1: work_h moved while it was read: 12, 13, 14",),
        ),
        reset,
    )
    made[2] = replace(
        made[2],
        seen=False,
        why="did not answer within 2 s",
        last_seen=ago(41),
        tasks=(task(0, 91, pace=0.3),),
        errors=None,
    )
    made[3] = replace(
        made[3],
        seen=False,
        why="Robot mode is off: it speaks its binary protocol",
        last_seen=None,
        tasks=(),
        use=(),
        weeks=(),
        meters=(),
        audits=0,
        identity=None,
        errors=None,
    )
    made[4] = _marked(
        replace(
            made[4],
            tasks=(task(0, 113, doubt=9),),
            errors=Errors("ok", {1: "ok", 2: "short circuit"}, {"port.error": 3}),
        ),
        wild,
    )
    drift = (
        Drift("1.sleep_delay", "off", "5", FLEET, 6, 7),
        Drift("software", "0203457", "0203456", BEFORE),
    )
    made[5] = _marked(replace(made[5], drifts=drift, tasks=(task(0, 79.9), task(5, 100))), lost)
    made[6] = replace(made[6], drifts=drift[:1], tasks=())
    wrong = ("line 41 is no observation or fact, or was changed",)
    return fleet(*made, wrong=wrong)


def _marked(one: StationAudit, mark: Difference) -> StationAudit:
    meters = tuple(
        (
            replace(
                meter,
                last=mark,
                counter_total=replace(meter.counter_total, marks=(mark,), is_known=mark.is_known),
            )
            if meter.counter == mark.counter
            else meter
        )
        for meter in one.meters
    )
    return replace(one, meters=meters)


@cache
def hundred() -> FleetAudit:
    """A hall."""
    chance = random.Random(7)
    made = [
        station(f"hall-{number:03}", number, hours=chance.uniform(0.5, 8), audits=20)
        for number in range(1, 101)
    ]
    for at in range(0, 100, 9):
        made[at] = replace(
            made[at],
            tasks=(
                task(at, chance.uniform(80, 135), pace=chance.uniform(0.2, 0.8)),
                *made[at].tasks[1:],
            ),
        )
    for at in range(4, 100, 30):
        made[at] = replace(
            made[at],
            seen=False,
            why="did not answer within 2 s",
            last_seen=ago(chance.randrange(3, 90)),
        )
    return fleet(*made)


@cache
def first_ever() -> FleetAudit:
    """Three stations, seen for the first time."""
    made = [
        replace(station(name, 0, audits=2), audits=1, weeks=(), use=use_of(Past({}, (), ago(0))))
        for name in ("ale-1", "dde-1", "dde-2")
    ]
    return fleet(
        *(replace(one, tasks=(task(0, 0.5, audits=1), task(3, 0, audits=1))) for one in made)
    )


@cache
def empty() -> FleetAudit:
    """Nothing at all."""
    return fleet(ledger_head="")


ALL = {
    "three": three,
    "trouble": trouble,
    "hundred": hundred,
    "first_ever": first_ever,
    "empty": empty,
}
