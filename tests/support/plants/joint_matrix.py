"""The matrix of joints: length × gap × rate × three tips × six plants, with and without a feeder;
and how joints are scored.

Plants: `sim` (the tip of `jbclog sim`, scaled), `second` (`second_plant`), `family`
(`plant_family`), `third` (`third_plant`) and `fifth` (`fifth_plant`); `late` is the second one
whose readings are shown late (`shown_late`). The third and the fifth are for reporting only:
nothing is chosen by them. So is `sixth` (`sixth_plant`), which has scripts of its own and a
campaign of its own (`test_sixth_plant`): it is in `REPORTED`, not in `PLANTS`. The others are for
tuning. The fifth has scripts of its own (`fifth_plant`); the others live through the same: who
solders what, when. Of these, every trial holds joints of one length (+0 to 10 %) with one gap
between them (+0 to 20 %), at least twenty of them or 90 s. Every other trial begins hot, with its
first joint after 0.5 to 6 s. Every other trial never rests; in the others there are three pauses of
2 to 4 s, in each of which the tip is wiped, or touches dry metal, or its setting changes by 10 to
30 °C (and six seconds more go by), or it goes to its stand for 8 to 15 s (and wakes for six).

The rule of scoring, fixed before anything was run:

- Truth is every joint of the script, at its first touch and its withdrawal. A drag is one.
- A found joint is a true one where they overlap for at least half of the shorter of the two; each
  counts once, the largest overlap first. What then is left of the found joints and overlaps a wipe
  or a dry touch (or comes within 0.3 s of it), or a feed without a draw (and says low confidence or
  "not known"), is apart: no hit, not false, and not in the number of joints. Every other found
  joint is false. Its `kind` does not matter for hits.
- Where the product says that joints are not known, or their number is not, all true joints are
  missed; there is nothing false. Its number is not wrong. Joints that it lists all the same are
  scored apart: "of the joints listed".
- F1 of a row: hits, missed and false of all its trials together. The worst tenth: the tenth of the
  row's trials with the lowest F1, together.
- Number wrong: |found − true| over the trials in which joints are known, added up, over the true
  joints of these trials. "Never more than" is asked of every plant and tip, so that the table gives
  the worst of these. Beside it: the share of these trials in which the number is wrong by more than
  `OFF_SHARE`, and the worst trial.
- Edges: of all hits, the share of starts and ends that are within 0.2 s of the truth.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from jbclog.analysis.joints.joints import find_joints
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.verdict.idle import Block
from jbclog.sim.tip import CAPACITY_J_PER_K, LOSS_W_PER_K, Tip
from support.plants import fifth_plant, plant_family, second_plant, sixth_plant, third_plant
from support.plants.third_plant import Floats, Script, Trial, Truth

PLANTS, TIPS = ("sim", "second", "family", "late", "third", "fifth"), ("small", "medium", "large")
REPORTED = (*PLANTS, "sixth")
LENGTHS, GAPS, RATES = (
    (0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0, 5.0),
    (0.5, 1.0, 1.2, 2.0, 5.0, 10.0),
    (10.0, 5.0, 2.0),
)
RECORDED = Path(__file__).parents[2] / "data" / "joints"
MATRIX = RECORDED / "matrix.csv"
"""F1 of the joints listed in each cell, 27 November 2026. Those with a feeder are older than the
rule of when feeds cut a draw, by which they rose.
"""
OBSERVER = RECORDED / "observer.csv"
"""What `apart_at_best` gives."""
EDGE_S, BESIDE_S = 0.2, 0.3
OFF_SHARE = 0.03
STEP_S = third_plant.STEP_S
BEFORE_S = 25.0  # of the second plant, before its record begins
WIRE_K = 215.0  # by which wire is heated
FIRST_SEED = {
    "sim": 91_001,
    "second": 92_001,
    "family": 94_001,
    "third": 93_001,
    "fifth": 95_001,
    "late": 96_001,
    "sixth": 97_001,
}


# -- the trials ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Cell:
    plant: str
    tip: str
    length: float
    gap: float
    repeat: int = 0

    @property
    def seed(self) -> int:
        inner = list(product(TIPS, LENGTHS, GAPS))
        return (
            FIRST_SEED[self.plant]
            + self.repeat * len(inner)
            + inner.index((self.tip, self.length, self.gap))
        )


def cells_of(plant: str, repeats: int = 1) -> list[Cell]:
    return [
        Cell(plant, tip, length, gap, n)
        for n, tip, length, gap in product(range(repeats), TIPS, LENGTHS, GAPS)
    ]


def script_of(cell: Cell) -> Script:
    if cell.plant == "fifth":
        return fifth_plant.script_of(cell.tip, cell.length, cell.gap, cell.seed)
    if cell.plant == "sixth":
        return sixth_plant.script_of(cell.tip, cell.length, cell.gap, cell.seed)
    rng = np.random.default_rng([cell.seed, 2])
    begins_hot, rests = (bool(flag) for flag in rng.random(2) < 0.5)
    aim = float(rng.integers(64, 81) * 5)
    seconds = max(90.0, 20 * (cell.length + cell.gap) * 1.1 + 45.0)
    script = Script(cell.tip, seconds, begins_hot, [(0.0, aim)])
    now = float(rng.uniform(0.5, 6.0) if begins_hot else rng.uniform(11.0, 14.0))
    pauses = [now + share * (seconds - now) for share in (0.25, 0.5, 0.75)] if rests else []
    while now + cell.length * 1.1 < seconds - 1.5:
        now = third_plant.joint(script, now, cell.length * float(rng.uniform(1.0, 1.1)), rng)
        now += cell.gap * float(rng.uniform(1.0, 1.2))
        if pauses and now > pauses[0]:
            pauses.pop(0)
            now = _pause(script, now + 1.0, rng)
    return script


def _pause(script: Script, now: float, rng: np.random.Generator) -> float:
    match str(rng.choice(["wipe", "wipe", "touch", "setting", "stand"])):
        case "wipe":
            now = third_plant.wipe(script, now, rng)
        case "touch":
            now = third_plant.dry_touch(script, now, rng)
        case "setting":
            script.settings.append(
                (now, script.settings[-1][1] + float(rng.choice([-30, -20, -10, 10, 20, 30])))
            )
            now += 6.0
        case _:
            script.stands.append((now, now + float(rng.uniform(8, 15))))
            now = script.stands[-1][1] + 6.0
    if rng.random() < third_plant.FEED_WITHOUT_DRAW:
        script.feeds.append((now + 0.5, now + 1.0))
        script.dry_feeds.append(script.feeds[-1])
    return now + float(rng.uniform(2.0, 4.0))


def records(cells: Sequence[Cell], rates: Sequence[float] = RATES) -> dict[float, list[Trial]]:
    """The trials of these cells, all of one plant, at each rate; of like length together, for they
    are simulated side by side.
    """
    scripts = [script_of(cell) for cell in cells]
    order = sorted(range(len(cells)), key=lambda n: scripts[n].seconds)
    done: dict[float, list[Trial | None]] = {hz: [None] * len(cells) for hz in rates}
    half = (
        [n for n in order if scripts[n].seconds < 150],
        [n for n in order if scripts[n].seconds >= 150],
    )
    for group in (group for group in half if group):
        lived = SIMULATED[cells[0].plant](
            [scripts[n] for n in group], [cells[n].seed for n in group], rates
        )
        for hz in rates:
            for n, trial in zip(group, lived[hz], strict=True):
                done[hz][n] = trial
    return {hz: [trial for trial in row if trial is not None] for hz, row in done.items()}


def in_second_plant(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """The second plant's regulator and masses, scaled to three sizes of tip; wire is heat that the
    work takes up with its own.
    """
    seen, noise = _of_second_plant(scripts, seeds)
    return _recorded(scripts, seen, noise, seeds, rates)


def in_late(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """The second plant, whose station shows its readings late; by another time in each trial."""
    seen, noise = _of_second_plant(scripts, seeds)
    for row, seed in enumerate(seeds):
        seen.temperature[row], seen.power[row] = shown_late(
            seen.temperature[row], seen.power[row], seed
        )
    return _recorded(scripts, seen, noise, seeds, rates)


def shown_late(temperature: Floats, power: Floats, seed: int) -> tuple[Floats, Floats]:
    """Both as three of four stations show them: the temperature filtered, late and published now
    and then, the power late.
    """
    rng = np.random.default_rng([seed, 5])
    is_late = rng.random() < 0.75
    filter_s, late_s, every_s, power_late_s = (
        rng.uniform(*one) for one in ((0.02, 0.15), (0.0, 0.35), (0.02, 0.12), (0.0, 0.15))
    )
    if not is_late:
        return temperature, power
    keeps = float(np.exp(-STEP_S / filter_s))
    felt = temperature.copy()
    for step in range(1, len(felt)):
        felt[step] = keeps * felt[step - 1] + (1 - keeps) * temperature[step]
    published = np.floor(
        np.floor(np.arange(len(felt)) * STEP_S / every_s) * every_s / STEP_S
    ).astype(np.int64)
    return _later(felt[published], late_s), _later(power, power_late_s)


def _later(values: Floats, seconds: float) -> Floats:
    steps = round(seconds / STEP_S)
    return np.concatenate([np.full(steps, values[0]), values[: len(values) - steps]])


def _of_second_plant(
    scripts: Sequence[Script], seeds: Sequence[int]
) -> tuple[second_plant.Recorded, Floats]:
    """What could be seen, and the noise of the temperature in °C."""
    plants = second_plant.plants_of(seeds)
    size = np.array([{"small": 0.5, "medium": 1.0, "large": 2.0}[script.tip] for script in scripts])
    for name in ("rated_w", "heater", "tip", "between", "loss"):
        setattr(plants, name, getattr(plants, name) * size)
    seen = second_plant.simulate(
        plants, [_for_second(script) for script in scripts], _steps(scripts)
    )
    seen.power = np.round(seen.power * 100) / 100
    return seen, plants.noise_c


def in_family(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """Another plant in each trial; wire is heat that the work takes up with its own."""
    sizes = np.array(
        [{"small": 0.5, "medium": 1.0, "large": 2.0}[script.tip] for script in scripts]
    )
    plants = plant_family.plants_of(seeds, sizes)
    seen = plant_family.simulate(
        plants, [_for_second(script) for script in scripts], _steps(scripts)
    )
    return _recorded(scripts, seen, plants.noise_c, seeds, rates)


def _steps(scripts: Sequence[Script]) -> int:
    return round((BEFORE_S + max(one.seconds for one in scripts)) / STEP_S)


def _recorded(
    scripts: Sequence[Script],
    seen: second_plant.Recorded,
    noise: Floats,
    seeds: Sequence[int],
    rates: Sequence[float],
) -> dict[float, list[Trial]]:
    first = round(BEFORE_S / STEP_S)
    temperature, power = seen.temperature[:, first:], 1000 * seen.power[:, first:]
    return {
        hz: [
            third_plant.recorded(script, temperature[n], power[n], float(noise[n]), seed, hz)
            for n, (script, seed) in enumerate(zip(scripts, seeds, strict=True))
        ]
        for hz in rates
    }


def _for_second(script: Script) -> second_plant.Script:
    """The same, `BEFORE_S` later: till then a tip that begins cold is aimed at its surroundings."""

    def later(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        return [(start + BEFORE_S, end + BEFORE_S) for start, end in spans]

    contacts = [
        second_plant.Contact(
            one.start + BEFORE_S,
            one.end + BEFORE_S,
            one.conductance,
            one.capacity + one.wire_w * 0.6 * (one.end - one.start) / WIRE_K,
            one.leak,
            one.begins_c,
        )
        for one in script.touches
    ]
    aims = [(start + BEFORE_S, celsius) for start, celsius in script.settings]
    aims.insert(0, (0.0, script.settings[0][1] if script.begins_hot else second_plant.AMBIENT_C))
    return second_plant.Script([], contacts, aims, later(script.stands), [])


def in_sim(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    """The tip of `jbclog sim`. A tip of another size is the same tip under loads and watts divided
    by its size.
    """
    lived = [_sim_tip(script, seed) for script, seed in zip(scripts, seeds, strict=True)]
    return {
        hz: [
            third_plant.recorded(script, *seen, 0.3, seed, hz)
            for script, seen, seed in zip(scripts, lived, seeds, strict=True)
        ]
        for hz in rates
    }


def _sim_tip(script: Script, seed: int) -> tuple[Floats, Floats]:
    step_s, every = 0.02, 2
    steps = round(script.seconds / step_s)
    size = {"small": 0.45, "medium": 1.3, "large": 3.5}[script.tip] / CAPACITY_J_PER_K
    rated = {"small": 75.0, "medium": 130.0, "large": 250.0}[script.tip]
    tip = Tip(23.0, rated / size)
    rng = np.random.default_rng([seed, 1])
    lag_s = float(rng.uniform(0.01, 0.15))
    aim = np.empty(steps)
    for start, celsius in script.settings:
        aim[round(start / step_s) :] = celsius
    for start, end in script.stands:
        aim[round(start / step_s) : round(end / step_s)] = third_plant.STAND_C
    if script.begins_hot:
        tip.temperature_c = aim[0]
        tip.integral_w = tip.power_w = LOSS_W_PER_K * (aim[0] - 23.0)
    touching = np.full(steps, -1)
    for number, one in enumerate(script.touches):
        touching[round(one.start / step_s) : round(one.end / step_s)] = number
    temperature, power = np.empty(steps), np.empty(steps)
    felt, work, before = tip.temperature_c, 0.0, -1
    for step, (now, target) in enumerate(zip(touching.tolist(), aim.tolist(), strict=True)):
        if now >= 0:
            load = script.touches[now]
            work = load.begins_c if now != before else work
            tip.step(step_s, target, load.conductance / size, work)
            melting = load.wire_w * 0.6
            flow = load.conductance * (tip.temperature_c - work)
            tip.temperature_c -= melting * step_s / size / CAPACITY_J_PER_K
            work += step_s * (flow - load.leak * (work - third_plant.BOARD_C)) / load.capacity
        else:
            tip.step(step_s, target, 0.0, 0.0)
        before = now
        felt += (tip.temperature_c - felt) * (1 - np.exp(-step_s / lag_s))
        temperature[step], power[step] = felt, 1000 * tip.power_w / tip.rated_w
    return np.repeat(temperature, every), np.repeat(power, every)


SIMULATED = {
    "sim": in_sim,
    "second": in_second_plant,
    "family": in_family,
    "late": in_late,
    "third": third_plant.trials,
    "fifth": fifth_plant.trials,
    "sixth": sixth_plant.trials,
}


# -- the score -------------------------------------------------------------------------------------


@dataclass
class Outcome:
    """One trial at one rate, with or without a feeder."""

    cell: Cell
    hz: float
    fed: bool
    is_known: bool
    truths: int
    hits: int = 0
    false: int = 0
    starts: list[float] = field(default_factory=list)  # found minus true, s
    ends: list[float] = field(default_factory=list)
    # of wipe, touch, feed: how many, found, found as a joint
    called: dict[str, tuple[int, int, int]] = field(default_factory=dict)
    why: str | None = None
    # the same as if its number were known, where joints are listed and their number is not known
    listed: Outcome | None = None

    @property
    def missed(self) -> int:
        return self.truths - self.hits

    @property
    def f1(self) -> float:
        return f1_of([self])


def series_of(trial: Trial, hz: float, fed: bool) -> Series:
    rows = Block(trial.seconds, trial.temperature, trial.power, trial.setting, trial.working)
    series = Series(rows, ~np.isnan(trial.temperature), 1 / hz)
    read = ~np.isnan(trial.cycles)
    counted = Cycles(trial.seconds[read], trial.cycles[read])
    return replace(series, feeding=motor_of(trial), cycles=counted) if fed else series


def motor_of(trial: Trial) -> Floats:
    """Whether the motor pushes, as the status word tells it on every tick (R-PSx, manual 002); one
    reading in 200 is lost.
    """
    begun = np.searchsorted([start for start, _ in trial.script.feeds], trial.seconds, side="right")
    ends = np.array([-1.0, *(end for _, end in trial.script.feeds)])
    lost = np.random.default_rng(len(trial.seconds)).random(len(trial.seconds)) < 0.005
    return np.where(lost, np.nan, trial.seconds < ends[begun])


def outcome_of(cell: Cell, trial: Trial, hz: float, fed: bool) -> Outcome:
    found = find_joints(series_of(trial, hz, fed))
    joints = [Said(one.start_s, one.end_s, getattr(one, "kind", "joint")) for one in found.joints]
    return judged(cell, trial.script, hz, fed, joints, getattr(found, "why", None))


@dataclass(frozen=True)
class Said:
    start: float
    end: float
    kind: str


def judged(
    cell: Cell, script: Script, hz: float, fed: bool, joints: Sequence[Said], why: str | None = None
) -> Outcome:
    """By the rule at the top."""
    truths = [truth for truth in script.truths if truth.is_joint]
    outcome = Outcome(cell, hz, fed, why is None, len(truths), why=why)
    if why is not None:
        outcome.listed = judged(cell, script, hz, fed, joints) if joints else None
        return outcome
    left = list(joints)
    for truth, one in _pairs(truths, joints):
        left.remove(one)
        outcome.hits += 1
        outcome.starts.append(one.start - truth.start)
        outcome.ends.append(one.end - truth.end)
    apart = [truth for truth in script.truths if not truth.is_joint]
    apart += [Truth(start, end, "feed") for start, end in script.dry_feeds] if fed else []
    for kind in ("wipe", "touch", "feed"):
        places = [one for one in apart if one.kind == kind]
        beside = {one for one in left if any(_overlap(place, one) > -BESIDE_S for place in places)}
        beside = {one for one in beside if kind != "feed" or one.kind != "joint"}
        seen = sum(any(_overlap(place, one) > -BESIDE_S for one in beside) for place in places)
        outcome.called[kind] = len(places), seen, sum(one.kind == "joint" for one in beside)
        left = [one for one in left if one not in beside]
    outcome.false = len(left)
    return outcome


def _overlap(one: Truth | Said, other: Truth | Said) -> float:
    return min(one.end, other.end) - max(one.start, other.start)


def _pairs(truths: Sequence[Truth], found: Sequence[Said]) -> Iterable[tuple[Truth, Said]]:
    fitting = [
        (over, m, n)
        for m, truth in enumerate(truths)
        for n, one in enumerate(found)
        if (over := _overlap(truth, one)) > 0
        and over >= 0.5 * min(truth.end - truth.start, one.end - one.start)
    ]
    used_truths: set[int] = set()
    used_found: set[int] = set()
    for _, m, n in sorted(fitting, reverse=True):
        if m not in used_truths and n not in used_found:
            used_truths.add(m)
            used_found.add(n)
            yield truths[m], found[n]


def outcomes(
    cells: Sequence[Cell], rates: Sequence[float] = RATES, feeders: Sequence[bool] = (False, True)
) -> list[Outcome]:
    """All of these cells, of one plant, at all rates."""
    return found_in(cells, records(cells, rates), feeders)


def found_in(
    cells: Sequence[Cell], lived: dict[float, list[Trial]], feeders: Sequence[bool] = (False, True)
) -> list[Outcome]:
    return [
        outcome_of(cell, trial, hz, fed)
        for hz, trials in lived.items()
        for cell, trial in zip(cells, trials, strict=True)
        for fed in feeders
    ]


def f1_of(several: Sequence[Outcome]) -> float:
    hits = sum(one.hits for one in several)
    wrong = sum(one.missed + one.false for one in several)
    return 2 * hits / (2 * hits + wrong) if hits + wrong else 1.0


def worst_tenth(several: Sequence[Outcome]) -> float:
    return f1_of(sorted(several, key=lambda one: one.f1)[: max(len(several) // 10, 1)])


def number_wrong(several: Sequence[Outcome]) -> float:
    """Of the plant and tip with the largest: how far the number of joints is off, where known."""
    shares = [0.0]
    for plant, tip in product(REPORTED, TIPS):
        told = [
            one
            for one in several
            if one.is_known and (one.cell.plant, one.cell.tip) == (plant, tip)
        ]
        if told:
            shares.append(
                sum(abs(one.false - one.missed) for one in told) / sum(one.truths for one in told)
            )
    return max(shares)


def numbers_off(several: Sequence[Outcome]) -> float:
    """Of the trials with a known number: in how many it is wrong by more than `OFF_SHARE`."""
    shares = [share_off(one) for one in several if one.is_known]
    return sum(share > OFF_SHARE for share in shares) / max(len(shares), 1)


def most_off(several: Sequence[Outcome]) -> float:
    return max((share_off(one) for one in several if one.is_known), default=0.0)


def share_off(one: Outcome) -> float:
    return abs(one.false - one.missed) / one.truths


def f1_listed(several: Sequence[Outcome]) -> float:
    """Of the joints that are listed, whether their number is known or not."""
    return f1_of([one.listed or one for one in several])


def not_known(several: Sequence[Outcome]) -> float:
    return sum(not one.is_known for one in several) / max(len(several), 1)


def edges_near(several: Sequence[Outcome]) -> float:
    errors = np.abs([error for one in several for error in (*one.starts, *one.ends)])
    return float(np.mean(errors <= EDGE_S)) if len(errors) else 0.0


# -- what could be told at best --------------------------------------------------------------------


def told_apart(cell: Cell, trial: Trial) -> float:
    """Wrong calls per joint of one who knows the third plant's constants and every place, and only
    asks: joint or gap?

    He takes the heat that went (told power, shifted by the station's own delay, less what the tip's
    temperature took up) as a mean over each joint, and over as long a piece of each gap before the
    next contact, and knows the best threshold. What he cannot tell, the record does not say, or
    hardly. This is no bound in the strict sense: a full likelihood may know more.
    """
    plants = third_plant.plants_of([cell.tip], [cell.seed])
    capacity = 1000 * float(plants.heater[0] + plants.copper[0]) / float(plants.rated_w[0])
    delay = STEP_S * float(plants.window[0] / 2 + plants.late[0])
    known, fine = ~np.isnan(trial.power), np.arange(0, trial.script.seconds, 0.05)
    power, celsius = (
        np.interp(fine, trial.seconds[known], values[known])
        for values in (trial.power, trial.temperature)
    )
    heat, smooth = (
        np.concatenate([[0.0], np.cumsum(power) * 0.05]),
        np.convolve(celsius, np.ones(5) / 5, "same"),
    )
    ends = np.append(fine, fine[-1] + 0.05)

    def mean_flow(start: float, end: float) -> float:
        given = np.diff(np.interp([start + delay, end + delay], ends, heat))[0]
        taken = np.diff(np.interp([start + plants.lag_s[0], end + plants.lag_s[0]], fine, smooth))[
            0
        ]
        return float((given - capacity * taken) / (end - start))

    script = trial.script
    joints = [truth for truth in script.truths if truth.is_joint]
    busy = sorted(
        [(truth.start, truth.end) for truth in script.truths]
        + [(start, start + 6.0) for start, _ in script.settings[1:]]
        + [(start, end + 6.0) for start, end in script.stands]
    )
    gaps = [
        (max(end, begin - cell.length), begin)
        for (_, end), (begin, _) in pairwise(busy)
        if begin - end > 0.3
    ]
    of_joints = np.array([mean_flow(truth.start, truth.end) for truth in joints])
    of_gaps = np.array([mean_flow(*gap) for gap in gaps])
    wrong = [
        np.sum(of_joints < limit) + np.sum(of_gaps >= limit)
        for limit in np.concatenate([of_joints, of_gaps])
    ]
    return float(min(wrong)) / len(joints)


def apart_at_best(cells: Sequence[Cell], lived: dict[float, list[Trial]]) -> list[str]:
    """By rate, length and gap, all tips together: lines as in `OBSERVER`."""
    lines = []
    for hz, trials in lived.items():
        wrong: dict[tuple[float, float], list[float]] = {
            place: [] for place in product(LENGTHS, GAPS)
        }
        for cell, trial in zip(cells, trials, strict=True):
            wrong[cell.length, cell.gap].append(told_apart(cell, trial))
        for (length, gap), calls in wrong.items():
            lines.append(f"{hz:g},{length:g},{gap:g},{np.mean(calls):.2f}")
    return lines


# -- the tables ------------------------------------------------------------------------------------


def is_long_enough(one: Outcome) -> bool:
    return one.cell.length >= 0.5 and one.cell.gap >= 1.0


def is_dense(one: Outcome) -> bool:
    return one.cell.length >= 0.8


def is_busy(one: Outcome) -> bool:
    return (one.cell.length, one.cell.gap) in {(2.0, 1.2), (1.0, 0.5)}


def is_asked(one: Outcome) -> bool:
    return is_long_enough(one) or is_dense(one)


ROWS = (
    ("length ≥ 0.5 s, gap ≥ 1 s: F1", False, is_long_enough, f1_of),
    ("length ≥ 0.8 s, gap ≥ 0.5 s: F1", False, is_dense, f1_of),
    ("length 2 s every 3.2 s; 1 s every 1.5 s: F1", False, is_busy, f1_of),
    ("with a feeder, all of these: F1", True, is_asked, f1_of),
    ("worst tenth of the trials: F1", False, is_asked, worst_tenth),
    ("number of joints wrong, worst tip", False, is_asked, number_wrong),
    ("edges within 0.2 s", False, is_asked, edges_near),
    ("joints not known, of the trials", False, is_asked, not_known),
    (
        "length 0.3 s, gap ≥ 1 s: F1",
        False,
        lambda one: one.cell.length == 0.3 and one.cell.gap >= 1,
        f1_of,
    ),
    ("length ≥ 0.5 s, gap ≥ 1 s: F1 of the joints listed", False, is_long_enough, f1_listed),
    ("length ≥ 0.8 s, gap ≥ 0.5 s: F1 of the joints listed", False, is_dense, f1_listed),
    ("length 2 s every 3.2 s; 1 s every 1.5 s: F1 of the joints listed", False, is_busy, f1_listed),
    (
        "trials whose number is wrong by more than 3 %, of those with one",
        False,
        is_asked,
        numbers_off,
    ),
    ("the same, the largest error", False, is_asked, most_off),
)


def figures(several: Sequence[Outcome], hz: float) -> dict[str, float]:
    """What each row of the table says at this rate."""
    at = [one for one in several if one.hz == hz]
    of_row = {
        name: [one for one in at if one.fed == fed and which(one)] for name, fed, which, _ in ROWS
    }
    return {name: of(of_row[name]) for name, _, _, of in ROWS if of_row[name]}


def rows_told(several: Sequence[Outcome], rates: Sequence[float] = RATES) -> str:
    """Rows as required, a column a rate, for each plant and for the worst of them."""
    plants = [plant for plant in REPORTED if any(one.cell.plant == plant for one in several)]
    lines = []
    by = {
        (plant, hz): figures([one for one in several if one.cell.plant == plant], hz)
        for plant in plants
        for hz in rates
    }
    lines.append(
        "| | " + " | ".join(f"{plant}, {hz:g} Hz" for plant in plants for hz in rates) + " |"
    )
    lines.append("|---" * (1 + len(plants) * len(rates)) + "|")
    for name, _, _, of in ROWS:
        form = "{:.3f}" if of in (f1_of, worst_tenth, f1_listed) else "{:.1%}"
        lines.append(
            f"| {name} | "
            + " | ".join(
                form.format(by[plant, hz][name]) if name in by[plant, hz] else ""
                for plant in plants
                for hz in rates
            )
            + " |"
        )
    return "\n".join(lines)


def matrix_rows(several: Sequence[Outcome], plant: str, hz: float, fed: bool = False) -> list[str]:
    """F1 of the joints listed by length and gap, of the small, medium and large tip: lines as in
    `MATRIX`.
    """
    mine = [one for one in several if (one.cell.plant, one.hz, one.fed) == (plant, hz, fed)]
    lines = []
    for length, gap in product(LENGTHS, GAPS):
        here = [one for one in mine if (one.cell.length, one.cell.gap) == (length, gap)]
        if not here:
            continue
        tips = [f1_listed([one for one in here if one.cell.tip == tip]) for tip in TIPS]
        feeder = "yes" if fed else "no"
        figures_of_tips = ",".join(f"{tip:.2f}" for tip in tips)
        lines.append(f"{plant},{hz:g},{feeder},{length:g},{gap:g},{figures_of_tips}")
    return lines


def recorded_rows(plant: str, hz: float, fed: bool) -> list[str]:
    """The lines of `MATRIX` for this plant and rate, in the order of `matrix_rows`."""
    lines = MATRIX.read_text(encoding="utf-8").splitlines()
    feeder = "yes" if fed else "no"
    return [line for line in lines if line.startswith(f"{plant},{hz:g},{feeder},")]


def mean_f1(rows: Sequence[str]) -> float:
    """The mean over all lengths, gaps and tips."""
    return float(np.mean([[float(figure) for figure in row.split(",")[5:]] for row in rows]))


def apart_told(several: Sequence[Outcome]) -> str:
    """Wipes, dry touches and feeds without a draw: how many there were, were found, and were called
    joints.
    """
    lines = ["| | there were | found | called a joint |", "|---|---|---|---|"]
    for kind in ("wipe", "touch", "feed"):
        sums = np.sum([one.called.get(kind, (0, 0, 0)) for one in several], axis=0)
        lines.append(f"| {kind} | {sums[0]} | {sums[1]} | {sums[2]} |")
    return "\n".join(lines)
