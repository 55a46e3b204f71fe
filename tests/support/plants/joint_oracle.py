"""Joints by one who knows the plant: what the record of the third and of the fifth plant holds.

A particle filter (`joint_oracle.c`) whose particles are the plant itself, with the trial's true
constants, the lags of sensor and display, the rounding, the noise, the sampling, the reporting of
power, the settings and the times in the stand. It does not know when anything was touched, nor
which load: it draws both from the scripts of other trials. Three observers:

- `RHYTHM` knows the lengths and gaps of the trial's own cell (from a hundred scripts of other
  seeds), and the law of the control unit, which lives in each particle.
- `LAW` knows the law as well; lengths and gaps are those of the whole matrix, blurred by a third.

Nobody does better than a filter with endless particles. This one has some thousand, so that its F1
is what can be reached at least: where it is low, particles may be too few. No bound is shown.

Nothing here is the product's, and nothing of the product is chosen by it.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from support.plants import fifth_plant, joint_matrix, third_plant
from support.plants.joint_matrix import Cell, Outcome, Said
from support.plants.third_plant import Floats, Script, Touch, Trial

COMPILER: Final = shutil.which("cc") or shutil.which("gcc")
STEP_S: Final = 0.01
SLOT_STEPS: Final = 4  # what is said has this resolution
BINS, BIN_S = 1500, 0.02  # of hazards
AGES: Final = 700  # steps of an event whose touches are told apart
OTHER_REPEAT, OTHERS, OTHERS_A_PLACE = 10, 100, 3  # scripts of other seeds than the matrix has
BLUR: Final = 0.3  # of the logarithm of lengths and gaps, where the rhythm is not known
UNLIKELY: Final = 0.0004  # a contact in two steps, whatever came before
SETTLING_S: Final = 6.0  # after a new setting or a stand nothing is soldered
# without and with the rhythm
PARTICLES: Final = {"third": (2000, 2000), "fifth": (6000, 2000)}
# standard deviation of a power as told from that of a particle: half-cycles of the third plant; ‰
# of the fifth, without and with the rhythm
OFF_CYCLES, OFF_PERMILLE = 1.2, (25.0, 15.0)
SHOWN_C: Final = 0.12  # °C: of the fifth plant's display
QUIET, QUIET_SLOTS = 0.1, 4  # below this probability for so long, one joint is over
KINDS: Final = {"wipe": 1, "touch": 2}
AFTER_JOINT, AFTER_OTHER, AFTER_KNOWN, AT_FIRST = range(4)

Reals = NDArray[np.float32]
Rows = NDArray[np.int32]


@dataclass(frozen=True)
class Observer:
    """What it knows besides the tip."""

    name: str
    rhythm: bool


RHYTHM: Final = Observer("plant and rhythm", rhythm=True)
LAW: Final = Observer("plant", rhythm=False)
OBSERVERS: Final = (RHYTHM, LAW)

INTS: Final = (
    "particles", "steps", "readings", "events", "ages", "bins", "pad_count", "plant", "seed",
    "slot",
)  # fmt: skip
FLOATS: Final = ("first_share", "celsius_sd", "permille_sd")
ARRAYS: Final = (
    "aim", "air", "blocked", "reset", "first", "second", "celsius", "permille",
    "celsius_at", "permille_at", "touch_of", "touches", "kind_of", "is_drag", "pads", "begins",
    "ends", "constants", "contact", "start", "end", "foretold_c", "foretold_p",
)  # fmt: skip


class Problem(ctypes.Structure):
    """As in `joint_oracle.c`."""

    _fields_ = [
        *((name, ctypes.c_int) for name in INTS),
        *((name, ctypes.c_float) for name in FLOATS),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    ]


def compiled(folder: Path) -> ctypes.CDLL:
    """The filter, made in this folder."""
    library = folder / "joint_oracle.so"
    assert COMPILER is not None
    # the parts of -ffast-math; the flag itself makes a library switch off subnormal numbers in the
    # whole process that loads it
    fast = ("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffinite-math-only")
    fast = (*fast, "-fassociative-math", "-freciprocal-math")
    flags = ("-O3", "-march=native", *fast, "-shared", "-fPIC", "-Wall", "-Werror")
    source = str(Path(__file__).with_suffix(".c"))
    subprocess.run([COMPILER, *flags, "-o", str(library), source, "-lm"], check=True)
    return ctypes.CDLL(str(library))


# -- what may be touched, and when -----------------------------------------------------------------


@dataclass(frozen=True)
class Habits:
    """Events of other scripts, and hazards by what was before and by kind."""

    touches: Reals
    touch_of: NDArray[np.int16]
    kind_of: NDArray[np.uint8]
    is_drag: NDArray[np.uint8]
    pads: Rows
    begins: Reals
    ends: Reals


@lru_cache(maxsize=8)
def habits(place: Cell, knows_rhythm: bool, begins_hot: bool) -> Habits:
    touches: list[tuple[float, ...]] = []
    rows: list[NDArray[np.int16]] = []
    kinds: list[int] = []
    drags: list[bool] = []
    pads: list[int] = []
    gaps: list[list[float]] = [[] for _ in range(4)]
    lengths: list[list[float]] = [[] for _ in range(3)]
    for script in _others(place, knows_rhythm):
        last, before = 0.0, AT_FIRST
        known = [start for start, _ in script.settings[1:]] + [end for _, end in script.stands]
        for truth in sorted(script.truths, key=lambda one: one.start):
            between = [moment for moment in known if last <= moment <= truth.start]
            if between:
                gaps[AFTER_KNOWN].append(truth.start - max(between))
            elif before != AT_FIRST or script.begins_hot == begins_hot:
                gaps[before].append(truth.start - last)
            kind = KINDS.get(truth.kind, 0)
            last, before = truth.end, AFTER_OTHER if kind else AFTER_JOINT
            lengths[kind].append(truth.end - truth.start)
            own = [
                one
                for one in script.touches
                if one.start > truth.start - 1e-6 and one.end < truth.end + 1e-6
            ]
            if own:
                row = np.full(AGES, -1, np.int16)
                for one in own:
                    begin, end = (round((at - truth.start) / STEP_S) for at in (one.start, one.end))
                    row[begin : AGES if one is own[-1] else end] = len(touches)
                    if truth.kind == "drag" and one is not own[0]:
                        pads.append(len(touches))
                    touches.append(_touch(one))
                rows.append(row)
                kinds.append(kind)
                drags.append(truth.kind == "drag" and len(own) > 1)
    if not knows_rhythm:
        rng = np.random.default_rng(7)
        gaps = [_blurred(some, rng) if n < AFTER_KNOWN else some for n, some in enumerate(gaps)]
        lengths = [_blurred(some, rng) for some in lengths]
    slots = 2.0 if knows_rhythm else 4.0
    return Habits(
        np.array(touches, np.float32),
        np.array(rows),
        np.array(kinds, np.uint8),
        np.array(drags, np.uint8),
        np.array(pads or [0], np.int32),
        np.array([np.maximum(_hazard(some, slots), UNLIKELY) for some in gaps], np.float32),
        np.array([_hazard(some, slots) for some in lengths], np.float32),
    )


def _others(place: Cell, knows_rhythm: bool) -> list[Script]:
    if knows_rhythm:
        cells = [
            Cell(place.plant, place.tip, place.length, place.gap, OTHER_REPEAT + n)
            for n in range(OTHERS)
        ]
    else:
        cells = [
            Cell(place.plant, place.tip, length, gap, OTHER_REPEAT + n)
            for length in joint_matrix.LENGTHS
            for gap in joint_matrix.GAPS
            for n in range(OTHERS_A_PLACE)
        ]
    return [joint_matrix.script_of(cell) for cell in cells]


def _touch(one: Touch) -> tuple[float, ...]:
    """W/K, J/K, W/K, °C, W of wire, from and to which step of the touch it melts, s of wetting."""
    if isinstance(one, fifth_plant.Load):
        wire_from, wets_s = (one.wire_from - one.start) / STEP_S, one.wets_s
        wire_to = wire_from + one.wire_s / STEP_S
    else:
        steps, wets_s = round((one.end - one.start) / STEP_S), 1.0
        wire_from, wire_to = 0.2 * steps, 0.8 * steps
    load = one.conductance, one.capacity, one.leak, one.begins_c, one.wire_w
    return (*load, wire_from, wire_to, wets_s)


def _blurred(some: list[float], rng: np.random.Generator) -> list[float]:
    blur = np.exp(rng.uniform(-BLUR, BLUR, 4 * len(some)))
    return list(np.repeat(some, 4) * blur)


def _hazard(some: Sequence[float], slots: float) -> Floats:
    """Of what lasts so long: the probability to end in each bin, if it has not before."""
    from scipy.ndimage import gaussian_filter1d

    if len(some) < 3:
        return np.full(BINS, 0.002)
    at = np.minimum((np.array(some) / BIN_S).astype(np.int64), BINS - 1)
    counts = gaussian_filter1d(
        np.bincount(at, minlength=BINS).astype(float), slots, mode="constant"
    )
    left = counts[::-1].cumsum()[::-1]
    return np.clip(np.where(left < 0.3, 0.05, counts / np.maximum(left, 1e-9)), 0.0, 0.95)


# -- the plants ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Known:
    """Of one trial's plant and station: constants in the order of `joint_oracle.c`, when the record
    begins, with what temperatures, and how readings come about.
    """

    is_fifth: bool
    constants: list[float]
    first: int
    cold_c: float
    to_shank: float  # how far the shank is warmed, of the tip
    stand_c: float
    reading_steps: int  # from the earlier step of a reading to the later one
    first_share: float  # how often it is the earlier one
    celsius_sd: float
    permille_sd: tuple[float, float]  # without and with the rhythm


def known_of(cell: Cell) -> Known:
    return (_of_fifth if cell.plant == "fifth" else _of_third)(cell.tip, cell.seed)


def _of_third(tip: str, seed: int) -> Known:
    plants = third_plant.plants_of([tip], [seed])
    constants = [float(getattr(plants, one.name)[0]) for one in fields(plants)]
    return Known(
        False,
        constants,
        round(third_plant.BEFORE_S / STEP_S),
        third_plant.AMBIENT_C,
        float(plants.to_barrel[0] / (plants.to_barrel[0] + plants.from_barrel[0])),
        third_plant.STAND_C,
        1,
        2 / 3,
        float(plants.noise_c[0]),
        (1000 / float(plants.window[0]) * OFF_CYCLES,) * 2,
    )


def _of_fifth(tip: str, seed: int) -> Known:
    plants = fifth_plant.plants_of([tip], [seed])
    unit = fifth_plant.ControlUnit(plants)
    constants = [float(getattr(plants, one.name)[0]) for one in fields(plants)]
    of_unit = (
        unit.capacity, unit.holding, unit.filtering, unit.observing, unit.rise, unit.fall,
        unit.trimming,
    )  # fmt: skip
    junction_step = 1 - np.exp(-STEP_S / float(plants.junction_s[0]))
    kept = np.exp(-2 * STEP_S / float(plants.shown_s[0]))
    window = max(round(float(plants.mean_s[0]) / (2 * STEP_S)), 1)
    return Known(
        True,
        [*constants, *(float(value[0]) for value in of_unit), junction_step, kept, window],
        round(fifth_plant.BEFORE_S / STEP_S),
        float(plants.room_c[0]),
        float(plants.to_shank[0] / (plants.to_shank[0] + plants.to_handle[0])),
        fifth_plant.AIM_IN_STAND_C,
        2,
        0.018 / 0.023,
        SHOWN_C,
        OFF_PERMILLE,
    )


def _shown_at(cell: Cell, ticks: int) -> tuple[Rows, Rows]:
    """Of the fifth plant: the tick whose temperature, and whose power, is shown at each tick."""
    plants = fifth_plant.plants_of([cell.tip], [cell.seed])
    phase = float(plants.phase_s[0]) / (2 * STEP_S)

    def held(every_s: float) -> Rows:
        every = every_s / (2 * STEP_S)
        at = np.floor(np.floor((np.arange(ticks) + phase) / every) * every - phase)
        return np.asarray(np.clip(at, 0, None), dtype=np.int32)

    return held(float(plants.shown_every_s[0])), held(float(plants.power_every_s[0]))


def _room(cell: Cell, steps: int) -> Reals:
    if cell.plant != "fifth":
        return np.full(steps, third_plant.AMBIENT_C, np.float32)
    plants = fifth_plant.plants_of([cell.tip], [cell.seed])
    seconds = np.arange(steps) // 2 * 2 * STEP_S
    wave = np.sin(2 * np.pi * seconds / 300 + 60 * plants.phase_s)
    return np.asarray(plants.room_c + plants.drift_c * wave, dtype=np.float32)


# -- joints ----------------------------------------------------------------------------------------


def outcome_of(
    library: ctypes.CDLL, cell: Cell, trial: Trial, hz: float, observer: Observer
) -> Outcome:
    """As `joint_matrix.outcome_of` judges the product."""
    told = tell(library, cell, trial, observer)
    said = joints(told.contact, told.start, told.end)
    return joint_matrix.judged(cell, trial.script, hz, False, said)


def joints(contact: Floats, start: Floats, end: Floats) -> list[Said]:
    """Of the probability of contact and of the expected starts and ends in each slot.

    As many joints as starts are expected from one quiet time to the next; each from the median of
    its start to that of its end.
    """
    said = []
    slot_s = SLOT_STEPS * STEP_S
    for begin, until in _busy(contact > QUIET):
        starts, ends = start[begin:until].cumsum(), end[begin:until].cumsum()
        number = round(float(starts[-1]))
        for one in range(number):
            share = (one + 0.5) * float(starts[-1]) / number
            first = begin + int(np.searchsorted(starts, share))
            last = begin + int(np.searchsorted(ends, share))
            if last > first:
                said.append(Said(first * slot_s, last * slot_s, "joint"))
    return said


def _busy(busy: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs, with what lies between them where that is short; two slots more on both sides."""
    turns = np.flatnonzero(np.diff(np.concatenate(([False], busy, [False])).astype(np.int8)))
    runs: list[list[int]] = []
    for begin, until in turns.reshape(-1, 2).tolist():
        if runs and begin - runs[-1][1] < QUIET_SLOTS:
            runs[-1][1] = until
        else:
            runs.append([begin, until])
    return [(max(begin - 2, 0), min(until + 2, len(busy))) for begin, until in runs]


@dataclass(frozen=True)
class Told:
    """By slot: the probability of contact, expected starts and ends. By reading of both: how far
    what was foretold is off, in °C and ‰.
    """

    contact: Floats
    start: Floats
    end: Floats
    off_c: Floats
    off_permille: Floats


def tell(library: ctypes.CDLL, cell: Cell, trial: Trial, observer: Observer) -> Told:
    script, known = trial.script, known_of(cell)
    first = known.first
    steps = first + 2 * round(script.seconds / STEP_S / 2)
    slots = (steps - first) // SLOT_STEPS
    habit = habits(replace(cell, repeat=0), observer.rhythm, script.begins_hot)
    read = ~np.isnan(trial.power)
    # 2 ms: a reading comes after its tick; without it rounding would take the step before
    units = (trial.seconds + 0.002) / (known.reading_steps * STEP_S)
    at = first + known.reading_steps * units.astype(np.int32)
    read &= at + known.reading_steps < steps
    arrays: dict[str, NDArray[Any]] = {
        "aim": _aim(script, known, steps),
        "air": _room(cell, steps),
        **dict(zip(("blocked", "reset"), _pauses(script, known, steps), strict=True)),
        "first": at[read].astype(np.int32),
        "second": (at[read] + known.reading_steps).astype(np.int32),
        "celsius": trial.temperature[read].astype(np.float32),
        "permille": trial.power[read].astype(np.float32),
        **dict(zip(("celsius_at", "permille_at"), _shown_at(cell, steps), strict=True)),
        **{one.name: getattr(habit, one.name) for one in fields(habit)},
        "constants": np.array(known.constants, np.float32),
        **{name: np.zeros(slots, np.float32) for name in ("contact", "start", "end")},
        **{name: np.zeros(read.sum(), np.float32) for name in ("foretold_c", "foretold_p")},
    }
    arrays = {name: np.ascontiguousarray(arrays[name]) for name in ARRAYS}
    problem = Problem(
        PARTICLES[cell.plant][observer.rhythm], steps, int(read.sum()), len(habit.kind_of), AGES,
        BINS, len(habit.pads),
        int(known.is_fifth), cell.seed, SLOT_STEPS,
        known.first_share, known.celsius_sd, known.permille_sd[observer.rhythm],
        *(arrays[name].ctypes.data for name in ARRAYS),
    )  # fmt: skip
    hot_c = script.settings[0][1] if script.begins_hot else known.cold_c
    shank_c = known.cold_c + (hot_c - known.cold_c) * known.to_shank
    failed = library.find(
        ctypes.byref(problem), first, ctypes.c_float(hot_c), ctypes.c_float(shank_c)
    )
    assert not failed, "no memory"
    contact, start, end = (arrays[name].astype(float) for name in ("contact", "start", "end"))
    off_c = arrays["foretold_c"] - trial.temperature[read]
    return Told(contact, start, end, off_c, arrays["foretold_p"] - trial.power[read])


def _aim(script: Script, known: Known, steps: int) -> Reals:
    """By step: what the station aims at; 0 is off."""
    aim = np.zeros(steps, np.float32)
    if script.begins_hot:
        aim[: known.first] = script.settings[0][1]
    for start, celsius in script.settings:
        aim[known.first + round(start / STEP_S) :] = celsius
    for start, end in script.stands:
        aim[known.first + round(start / STEP_S) : known.first + round(end / STEP_S)] = known.stand_c
    return aim


def _pauses(
    script: Script, known: Known, steps: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """By step: whether nothing can begin, and whether the station shows a new setting or a stand
    begin or end.
    """
    blocked, reset = np.zeros(steps, np.uint8), np.zeros(steps, np.uint8)
    blocked[: known.first] = 1
    spans = [(start, start) for start, _ in script.settings[1:]] + script.stands
    for start, end in spans:
        begin, until = (known.first + round(at / STEP_S) for at in (start, end))
        blocked[begin : until + round(SETTLING_S / STEP_S)] = 1
        for step in (begin, until):
            if step < steps:
                reset[step // 2 * 2] = 1
    return blocked, reset
