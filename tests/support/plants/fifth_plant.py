"""A fifth plant for finding joints: written without reading the finder, fixed before its first
joint was found, never tuned on.

Its physics, from heater to board, in explicit steps of a half-cycle of 50 Hz:

- Heater, body of the tip, its end, and the shank to the handle are four masses. The thermocouple
  sits between heater and body, so that it reads too high while much power flows. Of a small tip
  1.69 J/K are published (IronOS, `source/Core/Inc/power.hpp`); here heater, body and end of the
  three tips have about 0.4, 1.2 and 3.4 J/K together.
- Work wets: the conductance of a contact begins with `DRY_SHARE` of its value and rises while the
  solder flows; the hand varies it by some percent. Wire melts half on the end of the tip, half on
  the work, while it is fed. A drag is one contact after another without a break, each with a fresh
  pad.
- A sponge boils at 100 °C; brass wool is two to four short dips; a dry touch has a poor contact.
  Draughts raise the loss, the room drifts.
- The line's voltage wanders and sags within ±10 %; the heater's power goes with its square, and the
  station does not know.

Its control unit, each 20 ms with the heater off for the reading: a table of what holds the setting,
plus the heat that is missing from the tip over the time in which it is to come back, plus a share
of the draw that a disturbance observer estimates with the unit's own, wrong, heat capacity, plus a
slow trim; a dead band; another limit of the slew upwards than downwards; phase angle in 64 steps.
It publishes power as a mean and temperature in whole °C, each at its own period: what a reader gets
is that old.

Operators take breaks with a lognormal excess, look at their work, clean the tip after some joints.
Seeds alone decide: a trial is the same in whatever company it is simulated.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from support.plants.filters import filtered
from support.plants.third_plant import Floats, Range, Script, Touch, Trial, Truth

STEP_S = 0.01
EVERY = 2  # steps from one decision of the control unit to the next
BEFORE_S = 20.0  # lived before the record begins
BOARD_C, AIM_IN_STAND_C = 28.0, 180.0
DRY_SHARE = 0.35  # of the conductance, before the solder wets
SETTING_EVERY_S, FEEDER_EVERY_S, LOST = 5.0, 2.0, 0.005
WIRE_ON_TIP = 0.5
LINE_BOUNDS = (0.90, 1.10)  # of the nominal voltage

# -- who solders what, when ------------------------------------------------------------------------

# W/K of the wetted contact, J/K, W/K into the board, W of wire
WORK: dict[str, tuple[Range, Range, Range, Range]] = {
    "pad": ((0.10, 0.22), (0.02, 0.05), (0.010, 0.025), (1.0, 3.5)),
    "pin": ((0.18, 0.40), (0.05, 0.16), (0.020, 0.060), (2.0, 5.0)),
    "plane": ((0.30, 0.65), (0.15, 0.50), (0.060, 0.160), (2.5, 6.5)),
    "lug": ((0.50, 1.10), (0.60, 1.80), (0.040, 0.120), (3.0, 7.0)),
    "drag": ((0.15, 0.35), (0.04, 0.12), (0.020, 0.050), (0.0, 2.5)),
}
USUAL = {
    "small": ("pad", "pad", "pin", "drag"),
    "medium": ("pin", "pin", "plane", "drag"),
    "large": ("plane", "plane", "lug", "drag"),
}
LEAST_S = {"pad": 0.0, "pin": 0.0, "plane": 0.5, "lug": 1.0, "drag": 1.2}
# of sponge, wool and dry metal: how much of the tip they touch
SIZE = {"small": 0.6, "medium": 1.0, "large": 1.6}
# of the joints; of those longer than 1.5 s; of the pauses
FED, FED_TWICE, FED_BESIDE = 0.95, 0.02, 0.4


@dataclass(frozen=True)
class Load(Touch):
    """A touch that wets with the time constant `wets_s`; wire melts in it from `wire_from` on for
    `wire_s`.
    """

    wets_s: float = 0.1
    wire_from: float = 0.0
    wire_s: float = 0.0


def script_of(tip: str, length: float, gap: float, seed: int) -> Script:
    """Joints at least so long and so far apart, at least twenty or 90 s of them."""
    rng = np.random.default_rng([seed, 52])
    seconds = max(90.0, 20 * (length + gap) * 1.15 + 40.0)
    begins_hot, cleans, rests = (bool(flag) for flag in rng.random(3) < (0.5, 0.6, 0.5))
    script = Script(tip, seconds, begins_hot, [(0.0, float(rng.integers(62, 80) * 5))])
    now = float(rng.uniform(1.0, 5.0) if begins_hot else rng.uniform(10.0, 14.0))
    to_clean, to_rest = int(rng.integers(5, 14)), int(rng.integers(6, 12))
    while now + length * 1.15 < seconds - 1.5:
        now = _joint(script, now, length * float(rng.uniform(1.0, 1.15)), rng)
        now += gap * (1 + min(float(rng.lognormal(np.log(0.12), 0.9)), 3.0))
        to_clean, to_rest = to_clean - 1, to_rest - 1
        if cleans and to_clean <= 0:
            now, to_clean = _clean(script, now + 0.4, rng) + max(gap, 0.6), int(rng.integers(5, 14))
        if rests and to_rest <= 0:
            now, to_rest = _rest(script, now + 0.5, rng) + max(gap, 0.6), int(rng.integers(6, 12))
    script.truths = [truth for truth in script.truths if truth.end <= seconds]
    return script


def _joint(script: Script, start: float, length: float, rng: np.random.Generator) -> float:
    kind = str(
        rng.choice([kind for kind in USUAL[script.tip] if LEAST_S[kind] <= length] or ["pin"])
    )
    end = start + length
    script.truths.append(Truth(start, end, kind))
    has_wire = rng.random() < FED
    feed = start + length * float(rng.uniform(0.08, 0.35)), length * float(rng.uniform(0.2, 0.55))
    if has_wire:
        script.feeds.append((feed[0], sum(feed)))
        if length > 1.5 and rng.random() < FED_TWICE:
            script.feeds.append((sum(feed) + 0.05, end))
    steps = [start, end]
    if kind == "drag":
        while steps[-2] + 0.9 < end:
            steps.insert(-1, steps[-2] + float(rng.uniform(0.25, 0.6)))
    for begins, ends in pairwise(steps):
        wire = (
            max(feed[0], begins),
            (max(min(sum(feed), ends) - max(feed[0], begins), 0.0) if has_wire else 0.0),
        )
        script.touches.append(
            _load(
                kind,
                begins,
                ends,
                wire,
                rng,
                BOARD_C if kind != "drag" else float(rng.uniform(40, 120)),
            )
        )
    return end


def _load(
    kind: str,
    start: float,
    end: float,
    wire: tuple[float, float],
    rng: np.random.Generator,
    begins_c: float,
) -> Load:
    conductance, capacity, leak, watts = (float(rng.uniform(*bounds)) for bounds in WORK[kind])
    return Load(
        start,
        end,
        conductance,
        capacity,
        leak,
        begins_c,
        watts,
        float(rng.uniform(0.04, 0.25)),
        *wire,
    )


def _clean(script: Script, start: float, rng: np.random.Generator) -> float:
    """On a wet sponge, or in brass wool."""
    size = SIZE[script.tip]
    if rng.random() < 0.5:
        end = start + float(rng.uniform(0.5, 1.4))
        sponge = size * float(rng.uniform(0.12, 0.35))
        script.touches.append(Load(start, end, sponge, 50.0, 0.0, 100.0))
    else:
        now = start
        for _ in range(int(rng.integers(2, 5))):
            end = now + float(rng.uniform(0.12, 0.35))
            script.touches.append(
                Load(now, end, size * float(rng.uniform(0.15, 0.45)), size * 0.8, 0.02, 30.0)
            )
            now = end + float(rng.uniform(0.08, 0.3))
    script.truths.append(Truth(start, end, "wipe"))
    return end


def _rest(script: Script, start: float, rng: np.random.Generator) -> float:
    """Looks at the work; or touches dry metal, changes the setting, puts the tool into its stand.
    The feeder may push meanwhile.
    """
    now = start
    match str(rng.choice(["look", "look", "touch", "setting", "stand"])):
        case "touch":
            end = now + float(rng.uniform(0.3, 2.0))
            script.touches.append(
                Load(
                    now,
                    end,
                    SIZE[script.tip] * float(rng.uniform(0.02, 0.08)),
                    2.0,
                    0.05,
                    BOARD_C,
                    wets_s=0.01,
                )
            )
            script.truths.append(Truth(now, end, "touch"))
            now = end
        case "setting":
            script.settings.append(
                (now, script.settings[-1][1] + float(rng.choice([-25, -15, 10, 20])))
            )
            now += 6.0
        case "stand":
            script.stands.append((now, now + float(rng.uniform(7, 14))))
            now = script.stands[-1][1] + 6.0
    if rng.random() < FED_BESIDE:
        script.feeds.append((now + 0.6, now + 1.1))
        script.dry_feeds.append(script.feeds[-1])
        now += 1.6
    return now + min(float(rng.lognormal(np.log(1.5), 0.6)), 8.0)


# -- tips and their control unit -------------------------------------------------------------------

TIPS: dict[str, dict[str, Range]] = {  # W, J/K, W/K
    "small": {
        "rated": (60, 80), "heater": (0.10, 0.15), "body": (0.18, 0.28), "end": (0.06, 0.09),
        "shank": (0.6, 1.0),
        "inner": (2.0, 3.0), "outer": (0.9, 1.5), "of_body": (0.005, 0.008),
        "of_end": (0.002, 0.004),
        "to_shank": (0.004, 0.008), "to_handle": (0.004, 0.008),
    },
    "medium": {
        "rated": (120, 145), "heater": (0.30, 0.45), "body": (0.50, 0.75), "end": (0.18, 0.30),
        "shank": (1.2, 2.2),
        "inner": (4.0, 7.0), "outer": (2.0, 4.0), "of_body": (0.010, 0.016),
        "of_end": (0.005, 0.009),
        "to_shank": (0.008, 0.016), "to_handle": (0.008, 0.016),
    },
    "large": {
        "rated": (220, 250), "heater": (0.80, 1.20), "body": (1.50, 2.20), "end": (0.50, 0.90),
        "shank": (3.0, 6.0),
        "inner": (9.0, 15.0), "outer": (5.0, 9.0), "of_body": (0.025, 0.040),
        "of_end": (0.012, 0.020),
        "to_shank": (0.015, 0.030), "to_handle": (0.015, 0.030),
    },
}  # fmt: skip
COMMON: dict[str, Range] = {
    "room_c": (20, 29),
    "drift_c": (0.3, 2.0),  # of the room, over some minutes
    # how much the thermocouple reads of the heater instead of the body
    "near_heater": (0.10, 0.30),
    "junction_s": (0.03, 0.12),
    "noise_c": (0.25, 0.7),  # of one reading of the control unit
    "filter_s": (0.04, 0.12),  # of the temperature by which it decides
    "capacity_off": (0.75, 1.15),  # its own capacity over the true one of heater, body and end
    "table_off": (0.85, 1.15),  # its table of holding power over the true one
    "back_s": (0.5, 1.2),  # in which the missing heat is to come back
    "trim_s": (6, 15),
    "share": (0.35, 0.7),  # of the draw as estimated
    "observer_s": (0.2, 0.5),
    "dead_c": (0.3, 1.0),
    "rise_s": (0.10, 0.35),  # from no power to full
    "fall_s": (0.05, 0.15),
    "mean_s": (0.06, 0.25),  # over which the published power is a mean
    "power_every_s": (0.04, 0.10),
    "shown_s": (0.05, 0.20),  # lag of the published temperature beyond the filter
    "shown_every_s": (0.05, 0.12),
    "phase_s": (0.0, 0.1),
}


@dataclass(frozen=True)
class Plants:
    """A number a trial; the units as in `TIPS` and `COMMON`."""

    rated: Floats
    heater: Floats
    body: Floats
    end: Floats
    shank: Floats
    inner: Floats
    outer: Floats
    of_body: Floats
    of_end: Floats
    to_shank: Floats
    to_handle: Floats
    room_c: Floats
    drift_c: Floats
    near_heater: Floats
    junction_s: Floats
    noise_c: Floats
    filter_s: Floats
    capacity_off: Floats
    table_off: Floats
    back_s: Floats
    trim_s: Floats
    share: Floats
    observer_s: Floats
    dead_c: Floats
    rise_s: Floats
    fall_s: Floats
    mean_s: Floats
    power_every_s: Floats
    shown_s: Floats
    shown_every_s: Floats
    phase_s: Floats

    @property
    def front(self) -> Floats:
        """J/K of heater, body and end."""
        return self.heater + self.body + self.end

    @property
    def loss(self) -> Floats:
        """W/K at rest, near 330 K above the room."""
        return (self.of_body + self.of_end) * _bent(330.0) + self.to_shank * self.to_handle / (
            self.to_shank + self.to_handle
        )


def plants_of(tips: Sequence[str], seeds: Sequence[int]) -> Plants:
    rows = []
    for tip, seed in zip(tips, seeds, strict=True):
        rng, bounds = np.random.default_rng([seed, 51]), {**TIPS[tip], **COMMON}
        rows.append([float(rng.uniform(*bounds[one.name])) for one in fields(Plants)])
    return Plants(*np.array(rows).T)


def _bent(above_c: float) -> float:
    """Convection and radiation grow a little faster than the temperature does."""
    return 0.8 + 0.0007 * above_c


# -- what happens ----------------------------------------------------------------------------------


@dataclass
class Lived:
    """Rows are trials, from `BEFORE_S` before the record on; `power` (commanded share) and `felt_c`
    by decision.
    """

    plants: Plants
    power: Floats
    felt_c: Floats
    heat_j: list[list[float]]  # of each truth of the script
    supplied_j: Floats
    lost_j: Floats  # to air and handle
    drawn_j: Floats
    stored_j: Floats  # in the four masses, at the end less at the start
    taken_j: Floats  # by work and wire: capacity, board, melting; counted on their side
    drawn_w: Floats | None = None  # by step, where asked for


def simulate(scripts: Sequence[Script], seeds: Sequence[int], keeps_flow: bool = False) -> Lived:
    """All side by side; nothing of one trial depends on the others."""
    plants = plants_of([script.tip for script in scripts], seeds)
    first = round(BEFORE_S / STEP_S)
    steps = first + round(max(script.seconds for script in scripts) / STEP_S)
    steps += -steps % EVERY
    count = len(scripts)
    noise, line, draught, hand = _disturbed(seeds, plants, steps // EVERY)
    aims, loads, wires = _events(scripts, first)
    unit = ControlUnit(plants)
    now_s = np.arange(steps // EVERY) * EVERY * STEP_S
    room = plants.room_c + plants.drift_c * np.sin(
        2 * np.pi * now_s[:, None] / 300 + 60 * plants.phase_s
    )
    hot = np.array([script.settings[0][1] if script.begins_hot else np.nan for script in scripts])
    heater = np.where(np.isnan(hot), plants.room_c, hot)
    body, end, junction = heater.copy(), heater.copy(), heater.copy()
    shank = plants.room_c + (heater - plants.room_c) * plants.to_shank / (
        plants.to_shank + plants.to_handle
    )
    unit.begin(heater)
    aim = np.where(np.isnan(hot), 0.0, hot)
    conductance, capacity, leak, wetting, wet, work, wire = (np.zeros(count) for _ in range(7))
    capacity += 1.0
    wetting += 1.0
    supplied, lost, drawn, stored, taken = (np.zeros(count) for _ in range(5))
    stored -= plants.heater * heater + plants.body * body + plants.end * end + plants.shank * shank
    power_told, felt_told = np.empty((steps // EVERY, count)), np.empty((steps // EVERY, count))
    flows = np.zeros((steps, count)) if keeps_flow else None
    sums = np.zeros((steps // EVERY + 1, count))
    to_heater, to_body, to_end, to_shank = (
        STEP_S / one for one in (plants.heater, plants.body, plants.end, plants.shank)
    )
    share, junction_step = plants.near_heater, 1 - np.exp(-STEP_S / plants.junction_s)
    watts = np.zeros(count)
    for step in range(steps):
        tick, is_decision = step // EVERY, step % EVERY == 0
        for trial, celsius in aims.get(step, ()):
            aim[trial] = celsius
        for trial, load, goes_on in loads.get(step, ()):
            if load is None:
                conductance[trial] = 0.0
            else:
                conductance[trial], capacity[trial], leak[trial] = (
                    load.conductance,
                    load.capacity,
                    load.leak,
                )
                work[trial], wetting[trial] = load.begins_c, load.wets_s
                wet[trial] = wet[trial] if goes_on else DRY_SHARE
        for trial, melting in wires.get(step, ()):
            wire[trial] = melting
        if is_decision:
            air, gust, grip = room[tick], draught[tick], 1 + hand[tick]
            sums[tick] = drawn
            command = unit.decide(aim, junction + noise[tick])
            power_told[tick], felt_told[tick] = command, unit.felt
            watts = command * plants.rated * line[tick]
        wet += (1 - wet) * (STEP_S / np.maximum(wetting, STEP_S))
        into_body, into_end, into_shank = (
            plants.inner * (heater - body),
            plants.outer * (body - end),
            plants.to_shank * (body - shank),
        )
        body_over, end_over = body - air, end - air
        from_body = plants.of_body * gust * body_over * (0.8 + 0.0007 * body_over)
        from_end = plants.of_end * gust * end_over * (0.8 + 0.0007 * end_over)
        to_handle = plants.to_handle * (shank - air)
        contact = conductance * wet * grip * (end - work)
        on_tip = WIRE_ON_TIP * wire
        into_board = leak * (work - BOARD_C) * (conductance > 0)
        heater = heater + to_heater * (watts - into_body)
        body = body + to_body * (into_body - into_end - into_shank - from_body)
        end = end + to_end * (into_end - from_end - contact - on_tip)
        shank = shank + to_shank * (into_shank - to_handle)
        before = work
        work = work + STEP_S * (contact - into_board - (wire - on_tip)) / capacity
        junction = junction + junction_step * (share * heater + (1 - share) * body - junction)
        supplied += watts
        lost += from_body + from_end + to_handle
        drawn += contact + on_tip
        taken += capacity * (work - before) / STEP_S + into_board + wire
        if flows is not None:
            flows[step] = contact + on_tip
    stored += plants.heater * heater + plants.body * body + plants.end * end + plants.shank * shank
    sums[-1] = drawn
    heat = [
        [
            STEP_S * float(sums[_tick(truth.end, first), n] - sums[_tick(truth.start, first), n])
            for truth in script.truths
        ]
        for n, script in enumerate(scripts)
    ]  # fmt: skip
    return Lived(
        plants,
        power_told.T,
        felt_told.T,
        heat,
        STEP_S * supplied,
        STEP_S * lost,
        STEP_S * drawn,
        stored,
        STEP_S * taken,
        None if flows is None else flows.T,
    )


class ControlUnit:
    """Holding table, heat that is missing, a share of the estimated draw, slow trim; dead band;
    limits of the slew.
    """

    def __init__(self, plants: Plants) -> None:
        period = EVERY * STEP_S
        self.plants = plants
        self.capacity = plants.front * plants.capacity_off / plants.rated  # s/K of full power
        self.holding = plants.loss * plants.table_off / plants.rated  # 1/K
        self.filtering = 1 - np.exp(-period / plants.filter_s)
        self.observing = 1 - np.exp(-period / plants.observer_s)
        self.rise, self.fall = period / plants.rise_s, period / plants.fall_s
        self.trimming = self.capacity / plants.back_s * period / plants.trim_s
        self.felt = self.draw = self.trim = self.ramp = np.zeros(len(plants.rated))

    def begin(self, celsius: Floats) -> None:
        self.felt = celsius.copy()

    def decide(self, aim: Floats, read: Floats) -> Floats:
        """A share of full power, from the setting and one reading in °C."""
        plants = self.plants
        felt = self.felt + self.filtering * (read - self.felt)
        rate = (felt - self.felt) / (EVERY * STEP_S)
        self.felt = felt
        draw = self.ramp - self.capacity * rate - self.holding * (felt - 25.0) - self.trim
        self.draw = self.draw + self.observing * (draw - self.draw)
        off = aim - felt
        off = np.sign(off) * np.maximum(np.abs(off) - plants.dead_c, 0.0)
        self.trim = np.clip(
            self.trim + np.where(np.abs(off) < 8, self.trimming * off, 0.0), -0.1, 0.1
        )
        asked = (
            self.holding * (aim - 25.0)
            + self.capacity / plants.back_s * off
            + plants.share * np.maximum(self.draw, 0.0)
            + self.trim
        )
        asked = np.clip(np.where(aim > 0, asked, 0.0), 0.0, 1.0)
        self.ramp = self.ramp + np.clip(asked - self.ramp, -self.fall, self.rise)
        return np.round(self.ramp * 64) / 64


def _tick(seconds: float, first: int) -> int:
    """The decision nearest to a moment of the record: heat is summed from one to the next."""
    return round((round(seconds / STEP_S) + first) / EVERY)


def _step(seconds: float, first: int) -> int:
    """Contacts begin and end with decisions: the heat of each is a difference of two sums."""
    return EVERY * _tick(seconds, first)


def _events(
    scripts: Sequence[Script], first: int
) -> tuple[
    dict[int, list[tuple[int, float]]],
    dict[int, list[tuple[int, Load | None, bool]]],
    dict[int, list[tuple[int, float]]],
]:
    """By step and trial: what is aimed at, what is touched, how many W of wire melt."""
    aims: dict[int, list[tuple[int, float]]] = defaultdict(list)
    loads: dict[int, list[tuple[int, Load | None, bool]]] = defaultdict(list)
    wires: dict[int, list[tuple[int, float]]] = defaultdict(list)
    for n, script in enumerate(scripts):
        for start, celsius in script.settings:
            aims[first + round(start / STEP_S)].append((n, celsius))
        for start, end in script.stands:
            now = [celsius for begins, celsius in script.settings if begins <= start][-1]
            aims[first + round(start / STEP_S)].append((n, AIM_IN_STAND_C))
            aims[first + round(end / STEP_S)].append((n, now))
        ended = -1
        for load in script.touches:
            assert isinstance(load, Load)
            begins, ends = _step(load.start, first), _step(load.end, first)
            loads[begins].append((n, load, begins == ended))
            loads[ends].append((n, None, False))
            ended = ends
            if load.wire_s > 0:
                wires[min(max(_step(load.wire_from, first), begins), ends)].append((n, load.wire_w))
                wires[min(max(_step(load.wire_from + load.wire_s, first), begins), ends)].append(
                    (n, 0.0)
                )
    return aims, loads, wires


def _disturbed(
    seeds: Sequence[int], plants: Plants, ticks: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """By decision and trial: noise in K; the line's power and the air's loss over the usual; the
    hand's grip less one.
    """
    noise, line, draught, hand = (np.empty((ticks, len(seeds))) for _ in range(4))
    # of any trial: what is drawn must not depend on the company
    longest = round(450.0 / STEP_S / EVERY)
    for n, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 53])
        noise[:, n] = plants.noise_c[n] * rng.standard_normal(longest)[:ticks]
        volts = (
            1
            + _wander(rng, longest, 40.0, 0.015)
            - _spells(rng, longest, 45.0, (0.5, 10.0), (0.01, 0.05))
        )
        line[:, n] = np.clip(volts, *LINE_BOUNDS)[:ticks] ** 2
        air = (
            1
            + _wander(rng, longest, 4.0, 0.06)
            + _spells(rng, longest, 60.0, (2.0, 12.0), (0.2, 0.6))
        )
        draught[:, n] = np.maximum(air, 0.5)[:ticks]
        hand[:, n] = np.clip(_wander(rng, longest, 0.3, 0.10), -0.5, 0.5)[:ticks]
    return noise, line, draught, hand


def _wander(rng: np.random.Generator, ticks: int, memory_s: float, spread: float) -> Floats:
    """First-order autoregressive, stationary."""
    kept = float(np.exp(-EVERY * STEP_S / memory_s))
    pushes = rng.standard_normal(ticks) * spread
    pushes[1:] *= np.sqrt(1 - kept**2)
    wandered: Floats = filtered(1.0, [1.0, -kept], pushes)
    return wandered


def _spells(
    rng: np.random.Generator, ticks: int, every_s: float, lasts_s: Range, high: Range
) -> Floats:
    """Zero but for spells that come at random."""
    values = np.zeros(ticks)
    for _ in range(int(rng.poisson(ticks * EVERY * STEP_S / every_s))):
        start = int(rng.integers(ticks))
        values[start : start + round(float(rng.uniform(*lasts_s)) / STEP_S / EVERY)] = float(
            rng.uniform(*high)
        )
    return values


# -- what is read ----------------------------------------------------------------------------------


def trials(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """The same trials as recorded at each of `rates` in Hz."""
    return recorded(simulate(scripts, seeds), scripts, seeds, rates)


def recorded(
    lived: Lived, scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    shown = [_published(lived, n) for n in range(len(scripts))]
    return {
        hz: [_read(script, *shown[n], seeds[n], hz) for n, script in enumerate(scripts)]
        for hz in rates
    }


def _published(lived: Lived, n: int) -> tuple[Floats, Floats]:
    """Of one trial, by decision, from the start of the record on: °C in whole degrees, and ‰; each
    until the next is published.
    """
    period, first, plants = EVERY * STEP_S, round(BEFORE_S / STEP_S / EVERY), lived.plants
    kept = float(np.exp(-period / plants.shown_s[n]))
    felt = lived.felt_c[n]
    shown: Floats = filtered(1 - kept, [1.0, -kept], felt, kept * felt[0])
    window = max(round(float(plants.mean_s[n]) / period), 1)
    totals = np.concatenate([np.zeros(window), np.cumsum(lived.power[n])])
    mean = (totals[window:] - totals[:-window]) / window
    ticks, phase = np.arange(len(felt)), float(plants.phase_s[n]) / period

    def held(values: Floats, every_s: float) -> Floats:
        every = every_s / period
        at = np.floor(np.floor((ticks + phase) / every) * every - phase).astype(np.int64)
        told: Floats = np.round(values[np.clip(at, 0, None)])[first:]
        return told

    return held(shown, float(plants.shown_every_s[n])), held(
        1000 * mean, float(plants.power_every_s[n])
    )


def _read(script: Script, celsius: Floats, permille: Floats, seed: int, hz: float) -> Trial:
    """One trial at one rate: each tick is answered 2 to 25 ms late, one reading in two hundred is
    lost.
    """
    rng = np.random.default_rng([seed, 54, round(hz)])
    ticks = np.arange(int(script.seconds * hz)) / hz
    moments = ticks + rng.uniform(0.002, 0.025, len(ticks))
    at = np.minimum((moments / STEP_S / EVERY).astype(np.int64), len(permille) - 1)
    lost = rng.random(len(ticks)) < LOST
    told_c, told_power = (np.where(lost, np.nan, values[at]) for values in (celsius, permille))
    in_stand = np.zeros(len(ticks), dtype=np.bool_)
    for start, end in script.stands:
        in_stand |= (ticks >= start) & (ticks < end)
    begins, settings = (np.array(column) for column in zip(*script.settings, strict=True))
    setting = settings[np.searchsorted(begins, ticks, side="right") - 1]
    runs = np.zeros(len(ticks))
    for start, end in script.feeds:
        runs[(moments >= start) & (moments < end)] = 1.0
    starts = np.sort([start for start, _ in script.feeds])
    begun = np.searchsorted(starts, moments, side="right").astype(np.float64)
    not_set, not_fed = (
        lost | ~_is_due(len(ticks), hz, every_s) for every_s in (SETTING_EVERY_S, FEEDER_EVERY_S)
    )
    setting[not_set] = np.nan
    runs[not_fed] = begun[not_fed] = np.nan
    return Trial(ticks, told_c, told_power, setting, ~lost & ~in_stand, runs, begun, script)


def _is_due(rows: int, hz: float, every_s: float) -> NDArray[np.bool_]:
    due: NDArray[np.bool_] = np.arange(rows) % max(round(every_s * hz), 1) == 0
    return due
