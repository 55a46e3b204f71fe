"""A third plant for finding joints: nothing of the product is tuned on it, and who wrote it had not
read how joints are found.

The station. An induction-heated cartridge under a **predictive relay**: no proportional, no
integral part. Each half-cycle of the mains (10 ms) the station extrapolates what its sensor says by
a lead time and takes one of three positions, with
hysteresis: full power, a feed-forward power that roughly holds this setting, or nothing; what it
decides acts a dead time later. So the tip rests where feed-forward and relay meet, some °C beside
its setting, and ripples. The three tips differ in the law (`TIPS`): the small one has a good
feed-forward, the medium one has none (two positions, whole half-cycles at full power), the large
one has only two thirds of what holds it, and the longest dead time.

The tip is three masses: heater, copper tip, barrel. The barrel takes minutes to warm. Loss is
convection, which a draught changes slowly and at random and nearness to the work at once, and
radiation (fourth power). The mains voltage wanders and jumps; the station tells its duty, so that
power in ‰ is not exactly the heat. Power is told as an average over a window of the station's own
(0.1 to 0.3 s), 20 to 80 ms late. Temperature: the sensor sits between heater and tip, lags 0.08 to
0.35 s, has noise, and is told in whole degrees; power in whole ‰ (manual 002, "Application Layer").

Sizes of the tips (`TIPS`). Copper has 0.385 J/(g·K): 1, 3 and 8 g of tip. Powers are those of
handpieces of these sizes. Loss: natural convection of 15 to 25 W/(m²·K) on 5, 8 and 16 cm², and
εσA(T⁴ − T₀⁴) of oxidised iron plating (ε 0.3 to 0.6) on the third of that area that is hot: 4 to 15
W at 350 °C.

Sizes of the work (`WORK`): a lump (J/K) behind a wetted contact (W/K), which leaks into the board
(W/K). Wetting takes 0.03 to 0.12 s from a dry quarter of the conductance.
- contact: solder (60 W/(m·K)), 0.3 to 0.5 mm thick on 1 mm² (pad) to 5 mm² (lug): 0.12 to 1 W/K.
- pad: FR4 within the diffusion length of 1 s (0.8 mm; 2.1 J/(cm³·K)) under 3 × 3 mm, and the
  component's end: 0.02 to 0.06 J/K; spreading in FR4 (4·k·r) and two traces: 6 to 20 mW/K.
- pin: 10 mm of a 0.8 mm brass pin, plated hole, 40 mm³ of FR4: 0.06 to 0.15 J/K; along the pin (120
  W/(m·K), 5 mm) and traces: 20 to 50 mW/K.
- plane: the same on four layers with thermal relief, spokes (130 mW/K) in series with spreading in
  the planes (2π·k·t/ln(r₂/r₁) = 120 mW/K): 60 to 150 mW/K, and 0.15 to 0.4 J/K of copper near by.
- lug: 1 to 4 g of brass and the end of a 2.5 mm² conductor (effusivity · A/√(π·t) = 50 mW/K at 1
  s): 0.5 to 1.5 J/K, 50 to 120 mW/K.
- wire: from 20 to 80 % of the contact. SAC305 takes 115 J/g from 25 to 260 °C; 5 to 10 mm/s of 0.5
  to 1 mm wire are 1 to 6 W.
- drag: one contact that moves from pad to pad every 0.25 to 0.5 s, each pad preheated by the one
  before. One joint.
No joint: a wipe over a wet sponge (0.2 to 0.6 s, to 98 °C) or three pokes into brass wool, a dry
touch (0.3 to 1 s, 10 to 50 mW/K). They are draws, too, and scored apart.

How large a joint is in the record (`loudness`; the first 60 s of the 144 trials of `SEEDS`): its
mean heat flow in the last 0.2 s, divided by the standard deviation of the told power of this tip at
rest at 10 Hz, has the quantiles 5, 25, 50, 75, 95 %: 0.6, 1.3, 2.3, 3.9, 10. The mean flow of a
joint is 140 to 700 ‰ of the rated power (5 to 95 %; of the small tip up to more than all of it),
the sensor dips by 0.3 to 12 °C: power is the better witness here, and a noisy one, 35 to 180 ‰ at
rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Range = tuple[float, float]

SEEDS = tuple(range(93_001, 93_145))
STEP_S = 0.01  # a half-cycle of 50 Hz
BEFORE_S = 5.0  # goes by before the record begins, so that a tip that begins hot has its ripple
AMBIENT_C, BOARD_C, STAND_C = 23.0, 35.0, 150.0
STEFAN_BOLTZMANN = 5.67e-8
FEED_READ_S, SETTING_READ_S = 2.0, 5.0
JOINTS = frozenset(["pad", "pin", "plane", "lug", "drag"])
APART = frozenset(["wipe", "touch"])


# -- what happens ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """A heat draw, from contact to withdrawal."""

    start: float
    end: float
    kind: str

    @property
    def is_joint(self) -> bool:
        return self.kind in JOINTS


@dataclass(frozen=True)
class Touch:
    """One lump of work: W/K of the wetted contact, J/K, W/K into the board, °C at first, W taken by
    melting wire.
    """

    start: float
    end: float
    conductance: float
    capacity: float
    leak: float
    begins_c: float
    wire_w: float = 0.0


@dataclass
class Script:
    """All that happens in one trial, in order; `feeds` are the feeder's cycles."""

    tip: str
    seconds: float
    begins_hot: bool
    settings: list[tuple[float, float]]
    truths: list[Truth] = field(default_factory=list)
    touches: list[Touch] = field(default_factory=list)
    stands: list[tuple[float, float]] = field(default_factory=list)
    feeds: list[tuple[float, float]] = field(default_factory=list)
    # without a draw; also in `feeds`
    dry_feeds: list[tuple[float, float]] = field(default_factory=list)


WORK: dict[str, tuple[Range, Range, Range, Range]] = {  # W/K, J/K, W/K, W of wire
    "pad": ((0.12, 0.25), (0.02, 0.06), (0.006, 0.020), (1.0, 3.0)),
    "pin": ((0.20, 0.45), (0.06, 0.15), (0.020, 0.050), (2.0, 5.0)),
    "plane": ((0.30, 0.70), (0.15, 0.40), (0.060, 0.150), (3.0, 6.0)),
    "lug": ((0.50, 1.00), (0.50, 1.50), (0.050, 0.120), (4.0, 6.0)),
}
NO_WIRE, FEED_WITHOUT_DRAW = 0.04, 0.5  # of the joints; of the pauses


def work_for(tip: str, length: float, rng: np.random.Generator) -> str:
    """What such a tip solders in such a time: nobody stays on a pad for 5 s, or solders a lug with
    a small tip.
    """
    if length >= 3 and rng.random() < 0.3:
        return "drag"
    fitting = {
        "small": ("pad", "pin") if length < 2 else ("pin",),
        "medium": ("pad", "pin") if length < 0.8 else ("pin", "plane"),
        "large": ("pin", "plane") if length < 1.5 else ("plane", "lug"),
    }
    return str(rng.choice(fitting[tip]))


def joint(script: Script, start: float, length: float, rng: np.random.Generator) -> float:
    """Solder one joint; when it ends."""
    kind, end = work_for(script.tip, length, rng), start + length
    has_wire = rng.random() >= NO_WIRE
    script.truths.append(Truth(start, end, kind))
    if kind == "drag":
        _drag(script, start, end, has_wire, rng)
    else:
        script.touches.append(_touch("pin" if kind == "drag" else kind, start, end, has_wire, rng))
    if has_wire:
        begins = start + length * float(rng.uniform(0.1, 0.3))
        script.feeds.append((begins, begins + max(length * float(rng.uniform(0.3, 0.5)), 0.15)))
    return end


def _touch(
    kind: str,
    start: float,
    end: float,
    has_wire: bool,
    rng: np.random.Generator,
    begins_c: float = BOARD_C,
) -> Touch:
    conductance, capacity, leak, wire = (float(rng.uniform(*bounds)) for bounds in WORK[kind])
    return Touch(start, end, conductance, capacity, leak, begins_c, wire if has_wire else 0.0)


def _drag(
    script: Script, start: float, end: float, has_wire: bool, rng: np.random.Generator
) -> None:
    now = start
    while now < end:
        until = now + float(rng.uniform(0.25, 0.5))
        until = end if end - until < 0.25 else until
        kind = "pad" if script.tip == "small" else "pin"
        script.touches.append(
            _touch(
                kind,
                now,
                until,
                has_wire,
                rng,
                BOARD_C if now == start else float(rng.uniform(60, 110)),
            )
        )
        now = until


def wipe(script: Script, start: float, rng: np.random.Generator) -> float:
    """Over a wet sponge once, or three times into brass wool."""
    if rng.random() < 0.5:
        end = start + float(rng.uniform(0.2, 0.6))
        script.touches.append(Touch(start, end, float(rng.uniform(0.10, 0.35)), 500.0, 0.0, 98.0))
    else:
        now = end = start
        for _ in range(3):
            end = now + float(rng.uniform(0.15, 0.3))
            script.touches.append(
                Touch(now, end, float(rng.uniform(0.03, 0.08)), 0.5, 0.05, BOARD_C)
            )
            now = end + float(rng.uniform(0.1, 0.25))
    script.truths.append(Truth(start, end, "wipe"))
    return end


def dry_touch(script: Script, start: float, rng: np.random.Generator) -> float:
    end = start + float(rng.uniform(0.3, 1.0))
    script.touches.append(Touch(start, end, float(rng.uniform(0.01, 0.05)), 0.3, 0.05, BOARD_C))
    script.truths.append(Truth(start, end, "touch"))
    return end


# -- the station and its tips ----------------------------------------------------------------------


@dataclass(frozen=True)
class Tip:
    """Bounds of one size of tip, from which each trial draws its own."""

    rated_w: Range
    heater: Range  # J/K
    copper: Range  # J/K
    between: Range  # W/K from heater to tip
    barrel: Range  # J/K
    area_cm2: float
    forward: Range  # feed-forward as a share of what holds the setting; none: two positions
    band_c: Range  # half of the relay's hysteresis
    lead_s: Range
    dead_s: Range


TIPS = {
    "small": Tip(
        (45, 65),
        (0.10, 0.20),
        (0.30, 0.50),
        (1.0, 1.6),
        (2.0, 4.0),
        5.0,
        (0.85, 0.98),
        (1.0, 2.0),
        (0.10, 0.25),
        (0.01, 0.03),
    ),
    "medium": Tip(
        (120, 145),
        (0.30, 0.50),
        (0.9, 1.4),
        (2.5, 4.0),
        (4.0, 8.0),
        8.0,
        (0.0, 0.0),
        (0.3, 0.8),
        (0.15, 0.35),
        (0.02, 0.04),
    ),
    "large": Tip(
        (160, 220),
        (0.7, 1.1),
        (2.4, 3.6),
        (5.0, 8.0),
        (8.0, 16.0),
        16.0,
        (0.55, 0.75),
        (1.0, 2.0),
        (0.20, 0.50),
        (0.02, 0.05),
    ),
}


@dataclass
class Plants:
    """The constants of each trial, a value a trial."""

    rated_w: Floats
    heater: Floats
    copper: Floats
    between: Floats
    barrel: Floats
    to_barrel: Floats  # W/K
    from_barrel: Floats  # W/K
    convection: Floats  # W/K
    radiating: Floats  # εσA in W/K⁴
    near: Floats  # the convection's factor while the tip is near the work
    forward: Floats
    band_c: Floats
    lead_s: Floats
    dead: NDArray[np.int64]  # steps
    lag_s: Floats
    sees_copper: Floats
    noise_c: Floats
    window: NDArray[np.int64]  # steps over which power is averaged
    late: NDArray[np.int64]  # steps by which it is told late
    wetting_s: Floats


def plants_of(tips: Sequence[str], seeds: Sequence[int]) -> Plants:
    rows = [
        _constants(TIPS[tip], np.random.default_rng([seed, 1]))
        for tip, seed in zip(tips, seeds, strict=True)
    ]
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Plants(*columns)


def _constants(tip: Tip, rng: np.random.Generator) -> tuple[float, ...]:
    def some(bounds: Range) -> float:
        return float(rng.uniform(*bounds))

    area = tip.area_cm2 * 1e-4
    return (
        some(tip.rated_w),
        some(tip.heater),
        some(tip.copper),
        some(tip.between),
        some(tip.barrel),
        some((0.015, 0.03)) * tip.area_cm2 / 8,
        some((0.03, 0.06)) * tip.area_cm2 / 8,
        some((15, 25)) * area,
        some((0.3, 0.6)) * STEFAN_BOLTZMANN * area / 3,
        some((0.85, 1.25)),
        some(tip.forward),
        some(tip.band_c),
        some(tip.lead_s),
        round(some(tip.dead_s) / STEP_S),
        some((0.08, 0.35)),
        some((0.3, 0.7)),
        some((0.3, 0.9)),
        round(some((0.1, 0.3)) / STEP_S),
        round(some((0.02, 0.08)) / STEP_S),
        some((0.03, 0.12)),
    )


# -- the physics, of all trials at once ------------------------------------------------------------


@dataclass
class Seen:
    """A row a trial, a column a step of the record: what the sensor feels, power as told in ‰, the
    true flow in W.
    """

    temperature: Floats
    power: Floats
    flow: Floats
    plants: Plants


def simulate(scripts: Sequence[Script], seeds: Sequence[int]) -> Seen:
    """All trials in steps of `STEP_S`, as long as the longest."""
    plants = plants_of([script.tip for script in scripts], seeds)
    first = round(BEFORE_S / STEP_S)
    steps = first + round(max(script.seconds for script in scripts) / STEP_S)
    aim, near, contact, table = _plan(scripts, steps, first)
    rngs = [np.random.default_rng([seed, 4]) for seed in seeds]
    draught = np.array([_wander(rng, steps, 0.12, 15.0) for rng in rngs])
    mains = np.array([_wander(rng, steps, 0.015, 30.0) + _jumps(rng, steps) for rng in rngs])
    # what the regulator's own filter leaves of the noise
    whispers = np.array([rng.normal(0, 0.05, steps) for rng in rngs])
    rows = np.arange(len(scripts))
    hot = np.array([script.begins_hot for script in scripts])
    start_c = np.where(hot, aim[:, 0], AMBIENT_C)
    heater, copper, felt = start_c.copy(), start_c.copy(), start_c.copy()
    barrel = AMBIENT_C + (start_c - AMBIENT_C) * plants.to_barrel / (
        plants.to_barrel + plants.from_barrel
    )
    work, wet, before = (
        np.full(len(scripts), BOARD_C),
        np.zeros(len(scripts)),
        np.full(len(scripts), -1),
    )
    slope, position, owed = np.zeros(len(scripts)), np.zeros(len(scripts)), np.zeros(len(scripts))
    deepest = int(plants.dead.max()) + 1
    decided = np.zeros((deepest, len(scripts)))
    fired, temperature, flows = (np.empty((len(scripts), steps)) for _ in range(3))
    kelvin = 273.15
    for step in range(steps):
        # the station: predict, take a position, fire whole half-cycles
        error = aim[:, step] - (felt + whispers[:, step] + plants.lead_s * slope)
        position = np.where(
            error > plants.band_c, 1.0, np.where(error < -plants.band_c, -1.0, position)
        )
        # it is left again when the prediction is back at the setting
        position = np.where(position * error < 0, 0.0, position)
        holding = plants.forward * _held_w(plants, aim[:, step]) / plants.rated_w
        wanted = np.where(position > 0, 1.0, np.where(position < 0, 0.0, holding)) * (
            aim[:, step] > AMBIENT_C
        )
        decided[step % deepest] = wanted
        owed = owed + decided[(step - plants.dead) % deepest, rows]
        fires = np.where(owed >= 1, 1.0, 0.0)
        owed = owed - fires
        # the work
        touching = contact[:, step]
        conductance, capacity, leak, begins, wire_w, wire_from, wire_to = table[
            rows, touching + 1
        ].T
        work, before = np.where(touching != before, begins, work), touching
        wet = np.where(touching < 0, 0.0, wet + STEP_S * (1 - wet) / plants.wetting_s)
        across_work = conductance * (0.25 + 0.75 * wet) * (copper - work)
        melting = np.where((step >= wire_from) & (step < wire_to), wire_w, 0.0)
        # three masses
        across = plants.between * (heater - copper)
        to_barrel = plants.to_barrel * (heater - barrel)
        convection = (
            plants.convection * (1 + draught[:, step]) * np.where(near[:, step], plants.near, 1.0)
        )
        lost = convection * (copper - AMBIENT_C) + plants.radiating * (
            (copper + kelvin) ** 4 - (AMBIENT_C + kelvin) ** 4
        )
        heat_w = plants.rated_w * fires * (1 + mains[:, step]) ** 2
        heater = heater + STEP_S * (heat_w - across - to_barrel) / plants.heater
        copper = copper + STEP_S * (across - across_work - melting - lost) / plants.copper
        barrel = (
            barrel
            + STEP_S * (to_barrel - plants.from_barrel * (barrel - AMBIENT_C)) / plants.barrel
        )
        work = work + STEP_S * (across_work - leak * (work - BOARD_C)) / capacity
        rate = (
            plants.sees_copper * copper + (1 - plants.sees_copper) * heater - felt
        ) / plants.lag_s
        felt, slope = felt + STEP_S * rate, slope + STEP_S * (rate - slope) / 0.04
        fired[:, step], temperature[:, step], flows[:, step] = fires, felt, across_work + melting
    return Seen(temperature[:, first:], _told(fired, plants)[:, first:], flows[:, first:], plants)


def _held_w(plants: Plants, aim: Floats) -> Floats:
    """What the maker's table says that holds a setting: of the mean tip in still air."""
    by_barrel = plants.to_barrel * plants.from_barrel / (plants.to_barrel + plants.from_barrel)
    radiated = plants.radiating * ((aim + 273.15) ** 4 - (AMBIENT_C + 273.15) ** 4)
    return (plants.convection + by_barrel) * (aim - AMBIENT_C) + radiated


def _told(fired: Floats, plants: Plants) -> Floats:
    """The station's own average of what it fired, in ‰, late."""
    sums = np.cumsum(fired, axis=1)
    told = np.zeros_like(fired)
    for row, (window, late) in enumerate(zip(plants.window, plants.late, strict=True)):
        averages = sums[row].copy()
        averages[window:] -= sums[row, :-window]
        told[row, late:] = 1000 * averages[: len(averages) - late] / window
    return told


def _wander(rng: np.random.Generator, steps: int, spread: float, tau_s: float) -> Floats:
    """A slow random walk that comes back (Ornstein-Uhlenbeck), drawn each 0.5 s."""
    coarse = round(0.5 / STEP_S)
    keeps = np.exp(-0.5 / tau_s)
    values = [float(rng.normal(0, spread))]
    for _ in range(steps // coarse + 1):
        values.append(values[-1] * keeps + float(rng.normal(0, spread * np.sqrt(1 - keeps**2))))
    return np.interp(np.arange(steps), np.arange(len(values)) * coarse, values)


def _jumps(rng: np.random.Generator, steps: int) -> Floats:
    """Neighbours on the same mains: up to 1.5 % for some seconds, each half-minute or so."""
    dip = np.zeros(steps)
    for _ in range(max(round(steps * STEP_S / 30), 1)):
        at = int(rng.integers(0, steps))
        dip[at : at + int(rng.uniform(2, 15) / STEP_S)] = float(rng.uniform(-0.015, 0.005))
    return dip


def _plan(
    scripts: Sequence[Script], steps: int, first: int
) -> tuple[Floats, Flags, NDArray[np.int64], Floats]:
    """At each step: the aim (0: off), whether the tip is near work, which touch there is (-1:
    none); and all touches.
    """
    most = max(len(script.touches) for script in scripts)
    aim, near = np.zeros((len(scripts), steps)), np.zeros((len(scripts), steps), dtype=np.bool_)
    contact = np.full((len(scripts), steps), -1)
    table = np.tile(np.array([0.0, 1.0, 0.0, BOARD_C, 0.0, 0.0, 0.0]), (len(scripts), most + 1, 1))

    def at(seconds: float) -> int:
        return first + round(seconds / STEP_S)

    for row, script in enumerate(scripts):
        for start, celsius in script.settings:
            aim[row, at(start) :] = celsius
        if script.begins_hot:
            aim[row, :first] = script.settings[0][1]
        for start, end in script.stands:
            aim[row, at(start) : at(end)] = STAND_C
        for number, one in enumerate(script.touches):
            begin, end_step = at(one.start), at(one.end)
            wire = begin + 0.2 * (end_step - begin), begin + 0.8 * (end_step - begin)
            contact[row, begin:end_step] = number
            near[row, max(begin - 30, 0) : end_step + 30] = True
            table[row, number + 1] = (
                one.conductance,
                one.capacity,
                one.leak,
                one.begins_c,
                one.wire_w,
                *wire,
            )
    return aim, near, contact, table


# -- the record ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """A record of one tool: rows as the samples have them, NaN where nothing was read."""

    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats  # read each 5 s
    working: Flags
    feeding: Floats  # 1 or 0, read each 2 s
    cycles: Floats  # the feeder's counted cycles, read each 2 s
    script: Script


def recorded(
    script: Script, temperature: Floats, power: Floats, noise_c: float, seed: int, hz: float
) -> Trial:
    """One trial at one rate: each tick is read up to 15 ms late, one reading of 200 is lost."""
    rng = np.random.default_rng([seed, 3, round(hz)])
    ticks = np.arange(int(script.seconds * hz)) / hz
    moments = ticks + rng.uniform(0, 0.015, len(ticks))
    at = np.minimum((moments / STEP_S).astype(np.int64), len(power) - 1)
    told_c, told_power = (
        np.round(temperature[at] + rng.normal(0, noise_c, len(at))),
        np.round(power[at]),
    )
    lost = rng.random(len(at)) < 0.005
    told_c[lost] = told_power[lost] = np.nan
    working = ~lost
    for start, end in script.stands:
        working[(ticks >= start) & (ticks < end)] = False
    setting = np.full(len(at), np.nan)
    for start, celsius in script.settings:
        setting[ticks >= start] = celsius
    setting[~_due(len(at), hz, SETTING_READ_S) | lost] = np.nan
    begun = np.searchsorted(
        np.array([start for start, _ in script.feeds]), moments, side="right"
    ).astype(np.float64)
    runs = np.zeros(len(at))
    for start, end in script.feeds:
        runs[(moments >= start) & (moments < end)] = 1.0
    not_read = ~_due(len(at), hz, FEED_READ_S) | lost
    runs[not_read] = begun[not_read] = np.nan
    return Trial(ticks, told_c, told_power, setting, working, runs, begun, script)


def _due(rows: int, hz: float, every_s: float) -> Flags:
    due: Flags = np.arange(rows) % max(round(every_s * hz), 1) == 0
    return due


def trials(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """The same trials as recorded at each of `rates` in Hz."""
    seen = simulate(scripts, seeds)
    return {
        hz: [
            recorded(
                script, seen.temperature[n], seen.power[n], float(seen.plants.noise_c[n]), seed, hz
            )
            for n, (script, seed) in enumerate(zip(scripts, seeds, strict=True))
        ]
        for hz in rates
    }


def loudness(scripts: Sequence[Script], seeds: Sequence[int]) -> Floats:
    """Of each joint of the first minute: mean flow in its last 0.2 s, in standard deviations of its
    resting tip's told power.
    """
    begun = [_first_minute(script) for script in scripts]
    seen = simulate(begun, seeds)
    resting = simulate(
        [Script(one.tip, 40.0, True, one.settings[:1], touches=[NO_TOUCH]) for one in scripts],
        seeds,
    )
    noise = resting.power[:, round(5 / STEP_S) :: round(0.1 / STEP_S)].std(axis=1)
    ratios = []
    for row, script in enumerate(begun):
        for truth in (one for one in script.truths if one.is_joint):
            until = round(truth.end / STEP_S)
            flow = float(seen.flow[row, until - 20 : until].mean())
            ratios.append(1000 * flow / float(seen.plants.rated_w[row]) / float(noise[row]))
    return np.array(ratios)


NO_TOUCH = Touch(39.0, 39.1, 0.0, 1.0, 0.0, BOARD_C)


def _first_minute(script: Script) -> Script:
    return Script(
        script.tip,
        60.0,
        script.begins_hot,
        [one for one in script.settings if one[0] < 59],
        [one for one in script.truths if one.end < 59],
        [one for one in script.touches if one.end < 59],
        [one for one in script.stands if one[1] < 59],
    )
