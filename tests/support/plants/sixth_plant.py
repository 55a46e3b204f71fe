"""A sixth plant for finding joints: written without reading how joints are found or how the other
plants work, and fixed before a joint was found on it.

The tool: three masses. A **core** (winding, ceramics, thermocouple), the **copper** of the tip,
and a **shaft** which warms in one to three minutes and makes the power at rest drift. Three sizes,
after what is known of cartridges of 40 W, 130 W and 250 W: 350 °C from cold after about 2, 3 and 8
s; at rest they take about a tenth of their power, by convection (in draughts), radiation and the
shaft.

The station fires or leaves out half-waves of the mains (10 ms; the line sags now and then). Of
each six one is left out, and the thermocouple is read in it. The law is an **attack** at full
power while the temperature that is to be expected is far below the setting, else proportional and
integral, with the derivative of the measurement; the integral is held while power is at its end.
Power is shown as the mean over some tenths of a second, temperature filtered and in whole degrees.

The work: two masses, and a contact which is **dry first** and wets once solder has come. Hand and
contact differ from joint to joint; in some the tip slips. Wire takes its heat from both sides of
the contact. Pushes of the feeder begin 0.1 to 0.4 s after the contact (earlier where the joint is
shorter than that allows), sometimes in two parts; a few joints have none, and a few pushes meet
nothing.

Scripts keep the rules at the top of `joint_matrix`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from support.plants.third_plant import Floats, Script, Touch, Trial, Truth

STEP_S, HALF_WAVE_S = 0.005, 0.01
HALF_WAVES = 6  # a tick of the station; the last one is never fired
TICK_S = HALF_WAVES * HALF_WAVE_S
STEPS = round(TICK_S / STEP_S)  # of a tick
BEFORE_S = 6.0  # goes by before the record begins
BOARD_C, STAND_C, SEE_C = 30.0, 150.0, 273.15
SIZE = {"small": 0.4, "medium": 1.0, "large": 2.4}  # of contacts
NO_PUSH, TWO_PUSHES, STRAY_PUSH, PUSH_IN_PAUSE = 0.03, 0.12, 0.01, 0.5
LOST = 0.006  # of the rows

# of joints, by kind: W/K of the wetted contact of the medium tip, J/K of the pad, W/K from there
# into the board, J/K of the board around, W of wire
KINDS = {
    "pad": ((0.12, 0.35), (0.010, 0.04), (0.015, 0.05), (0.10, 0.4), (1.0, 3.0)),
    "pin": ((0.18, 0.50), (0.040, 0.12), (0.025, 0.07), (0.20, 0.8), (1.5, 4.5)),
    "plane": ((0.25, 0.60), (0.080, 0.25), (0.060, 0.16), (0.80, 3.0), (2.0, 6.0)),
    "lug": ((0.30, 0.80), (0.250, 0.90), (0.050, 0.14), (1.00, 4.0), (3.0, 7.0)),
}
KINDS_OF = {
    "small": (("pad", 0.65), ("pin", 0.35)),
    "medium": (("pad", 0.2), ("pin", 0.5), ("plane", 0.3)),
    "large": (("pin", 0.25), ("plane", 0.45), ("lug", 0.3)),
}
WORK_SIZE = {"small": 0.6, "medium": 1.0, "large": 1.8}  # of pads and boards


# -- what happens ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Load(Touch):
    """`conductance` is that of the wetted contact; until `wets_at` it is dry and less."""

    dry_share: float = 0.2
    wets_at: float = 0.0  # s of the script
    wets_s: float = 0.1
    around: float = 1.0  # J/K of the board around
    around_leak: float = 0.02  # W/K from there
    wire_on_tip: float = 0.4  # of its heat
    slips: tuple[float, float] = (0.0, 0.0)


def script_of(tip: str, length: float, gap: float, seed: int) -> Script:
    rng = np.random.default_rng([seed, 61])
    begins_hot, rests = (bool(flag) for flag in rng.random(2) < 0.5)
    seconds = max(90.0, 20 * (length + gap) * 1.1 + 45.0)
    script = Script(tip, seconds, begins_hot, [(0.0, float(rng.integers(62, 81) * 5))])
    now = float(rng.uniform(0.5, 6.0) if begins_hot else rng.uniform(11.0, 14.0))
    pauses = [now + share * (seconds - now) for share in (0.25, 0.5, 0.75)] if rests else []
    while now + length * 1.1 < seconds - 1.5:
        now = _joint(script, now, length * float(rng.uniform(1.0, 1.1)), rng)
        before, now = now, now + gap * float(rng.uniform(1.0, 1.2))
        if gap >= 2.0 and rng.random() < STRAY_PUSH:
            _dry_push(script, before + 0.4 * gap, rng)
        if pauses and now > pauses[0]:
            pauses.pop(0)
            now = _pause(script, now + 1.0, rng)
    return script


def _joint(script: Script, start: float, length: float, rng: np.random.Generator) -> float:
    end = start + length
    pushes = _pushes(start, length, rng) if rng.random() >= NO_PUSH else []
    script.feeds.extend(pushes)
    if length >= 3.0 and rng.random() < 0.4:
        script.truths.append(Truth(start, end, "drag"))
        at = start
        while at < end:  # from pad to pad, the wire in all of them alike
            until = at + float(rng.uniform(0.35, 0.8))
            until = end if until > end - 0.3 else until
            script.touches.append(_load(script.tip, "pad", at, until, pushes, length, rng))
            at = until
        return end
    names, shares = zip(*KINDS_OF[script.tip], strict=True)
    kind = str(rng.choice(names, p=shares))
    script.truths.append(Truth(start, end, kind))
    script.touches.append(_load(script.tip, kind, start, end, pushes, length, rng))
    return end


def _pushes(start: float, length: float, rng: np.random.Generator) -> list[tuple[float, float]]:
    begin = start + min(float(rng.uniform(0.1, 0.4)), length * float(rng.uniform(0.25, 0.5)))
    end = min(begin + float(rng.uniform(0.3, 0.65)) * length, start + length - 0.03)
    if length >= 0.8 and rng.random() < TWO_PUSHES:
        part, pause = (end - begin) * float(rng.uniform(0.3, 0.5)), float(rng.uniform(0.08, 0.2))
        return [(begin, begin + part), (begin + part + pause, max(end, begin + part + pause + 0.1))]
    return [(begin, end)]


def _load(
    tip: str,
    kind: str,
    start: float,
    end: float,
    pushes: Sequence[tuple[float, float]],
    length: float,
    rng: np.random.Generator,
) -> Load:
    wetted, pad, leak, around, wire = (float(rng.uniform(*one)) for one in KINDS[kind])
    size = WORK_SIZE[tip]
    wet = float(np.exp(rng.normal(0.0, 0.2))) * (1.0 if pushes else 0.6)
    after = float(rng.uniform(0.03, 0.2))
    # without a push what is left on the tip wets by and by
    wets_at = max(start, pushes[0][0]) + after if pushes else start + 2 * after
    slips = (0.0, 0.0)
    if length >= 1.0 and rng.random() < 0.06:
        at = start + float(rng.uniform(0.3, 0.8)) * (end - start)
        slips = (at, at + float(rng.uniform(0.08, 0.2)))
    return Load(
        start,
        end,
        wetted * SIZE[tip] * wet,
        pad * size,
        leak * size,
        BOARD_C + float(rng.exponential(8.0)),
        wire_w=wire * size if pushes else 0.0,
        dry_share=float(rng.uniform(0.12, 0.4)),
        wets_at=wets_at,
        wets_s=float(rng.uniform(0.03, 0.2)),
        around=around * size,
        around_leak=float(rng.uniform(0.01, 0.04)) * size,
        wire_on_tip=float(rng.uniform(0.2, 0.6)),
        slips=slips,
    )


def _dry_push(script: Script, start: float, rng: np.random.Generator) -> None:
    script.feeds.append((start, start + float(rng.uniform(0.2, 0.6))))
    script.dry_feeds.append(script.feeds[-1])


def _pause(script: Script, now: float, rng: np.random.Generator) -> float:
    match str(rng.choice(["wool", "sponge", "touch", "setting", "stand"])):
        case "wool":
            now = _wool(script, now, rng)
        case "sponge":
            now = _sponge(script, now, rng)
        case "touch":
            start, now = now, now + float(rng.uniform(0.4, 1.2))
            script.truths.append(Truth(start, now, "touch"))
            script.touches.append(
                _metal(script.tip, start, now, float(rng.uniform(0.04, 0.12)), 26.0, rng)
            )
        case "setting":
            more = float(rng.choice([-30, -20, -10, 10, 20, 30]))
            script.settings.append((now, script.settings[-1][1] + more))
            now += 6.0
        case _:
            script.stands.append((now, now + float(rng.uniform(8, 15))))
            now = script.stands[-1][1] + 6.0
    if rng.random() < PUSH_IN_PAUSE:
        _dry_push(script, now + 0.6, rng)
    return now + float(rng.uniform(2.0, 4.0))


def _wool(script: Script, start: float, rng: np.random.Generator) -> float:
    at = end = start
    for _ in range(int(rng.integers(2, 5))):
        end = at + float(rng.uniform(0.12, 0.3))
        script.touches.append(_metal(script.tip, at, end, float(rng.uniform(0.06, 0.2)), 25.0, rng))
        at = end + float(rng.uniform(0.1, 0.2))
    script.truths.append(Truth(start, end, "wipe"))
    return end


def _sponge(script: Script, start: float, rng: np.random.Generator) -> float:
    end = start + float(rng.uniform(0.3, 0.9))
    script.truths.append(Truth(start, end, "wipe"))
    script.touches.append(_metal(script.tip, start, end, float(rng.uniform(0.2, 0.5)), 80.0, rng))
    return end


def _metal(
    tip: str, start: float, end: float, conductance: float, celsius: float, rng: np.random.Generator
) -> Load:
    """What is not soldered: large, and as it is from the first moment."""
    return Load(
        start,
        end,
        conductance * SIZE[tip],
        float(rng.uniform(0.3, 2.0)) * WORK_SIZE[tip],
        0.05,
        celsius,
        dry_share=1.0,
        wets_at=start,
        around=5.0,
    )


# -- the plants ------------------------------------------------------------------------------------


@dataclass
class Plants:
    """Of each trial a number: watts, J/K, W/K, s, °C."""

    rated: Floats  # W at 1000 ‰
    core: Floats
    copper: Floats
    shaft: Floats
    between: Floats  # core to copper
    end: Floats  # the narrow end of the tip
    convection: Floats  # W/K at 300 K above the air
    radiation: Floats  # W/K⁴
    to_shaft: Floats
    from_shaft: Floats
    shaft_warm: Floats  # share of its rise when the record begins hot
    air_c: Floats
    of_copper: Floats  # share that the thermocouple feels
    lag: Floats  # of the thermocouple
    noise: Floats  # °C of each reading of the station
    gain: Floats  # of full power, per °C
    integral_s: Floats
    derivative_s: Floats
    attack_c: Floats
    ahead_s: Floats  # of the temperature that is to be expected
    filter_s: Floats  # of the temperature that is shown
    bias_c: Floats  # of the temperature that is shown
    mean_s: Floats  # of the power that is shown
    late_s: Floats  # of the power that is shown


# W, core, copper and shaft in J/K, between, end, convection + radiation at 350 °C, to the shaft
TIPS = {
    "small": (40.0, 0.06, 0.15, 1.5, 0.9, 0.25, 0.009, 0.006),
    "medium": (130.0, 0.25, 0.75, 6.0, 3.0, 0.9, 0.022, 0.016),
    "large": (250.0, 1.20, 4.20, 20.0, 9.0, 2.5, 0.055, 0.045),
}


def plants_of(tips: Sequence[str], seeds: Sequence[int]) -> Plants:
    rows = [_constants(tip, seed) for tip, seed in zip(tips, seeds, strict=True)]
    return Plants(**{one.name: np.array([row[one.name] for row in rows]) for one in fields(Plants)})


def _constants(tip: str, seed: int) -> dict[str, float]:
    rng = np.random.default_rng([seed, 62])

    def about(value: float, spread: float) -> float:
        return value * float(rng.uniform(1 - spread, 1 + spread))

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    watts, core, copper, shaft, link, end, loss, to_shaft = TIPS[tip]
    loss, to_shaft = about(loss, 0.2), about(to_shaft, 0.25)
    radiant = between(0.15, 0.4)
    made = {
        "rated": about(watts, 0.06),
        "core": about(core, 0.15),
        "copper": about(copper, 0.25),
        "shaft": about(shaft, 0.3),
        "between": about(link, 0.2),
        "end": about(end, 0.3),
        "convection": loss * (1 - radiant),
        "radiation": loss * radiant * 325 / ((350 + SEE_C) ** 4 - (25 + SEE_C) ** 4),
        "to_shaft": to_shaft,
        "from_shaft": to_shaft * between(1.6, 3.0),
        "shaft_warm": between(0.4, 1.0),
        "air_c": between(19.0, 28.0),
        "of_copper": between(0.4, 0.8),
        "lag": between(0.06, 0.2),
        "noise": between(0.2, 0.6),
    }
    crossover = between(1.4, 2.4)  # rad/s, where the loop has a gain of one
    made["gain"] = crossover * (made["core"] + made["copper"]) / made["rated"]
    made |= {
        "integral_s": between(1.8, 4.0),
        "derivative_s": between(0.03, 0.12),
        "attack_c": between(10.0, 25.0),
        "ahead_s": made["lag"] + between(0.15, 0.3),
        "filter_s": between(0.03, 0.2),
        "bias_c": between(-1.2, 1.2),
        "mean_s": between(0.2, 0.5),
        "late_s": between(0.0, 0.12),
    }
    return made


# -- life ------------------------------------------------------------------------------------------


@dataclass
class Lived:
    """What the station knows after each tick, row by row from `BEFORE_S` before the record, and
    the heat that went.
    """

    plants: Plants
    shown_c: Floats  # before it is rounded
    power: Floats  # share of the half-waves that could be fired, of this tick
    supplied_j: Floats
    lost_j: Floats
    drawn_j: Floats
    stored_j: Floats


@dataclass
class _Course:
    """By step (first axis) and row."""

    number: NDArray[np.int32]  # of the load that is touched, -1: none
    conductance: NDArray[np.float32]
    wire_w: NDArray[np.float32]


def simulate(scripts: Sequence[Script], seeds: Sequence[int]) -> Lived:
    plants = plants_of([script.tip for script in scripts], seeds)
    count = len(scripts)
    ticks = int(np.ceil((BEFORE_S + max(one.seconds for one in scripts)) / TICK_S)) + 1
    course = _course(scripts, seeds, ticks * STEPS)
    aim = _aims(scripts, ticks)
    line, draught, air, drift, noise = _disturbed(plants, seeds, ticks)
    loads = _padded(scripts)
    rows = np.arange(count)

    hot = np.array([script.begins_hot for script in scripts])
    first = np.array([script.settings[0][1] for script in scripts])
    core = np.where(hot, first, plants.air_c)
    copper = core.copy()
    share = plants.to_shaft / (plants.to_shaft + plants.from_shaft)
    shaft = plants.air_c + plants.shaft_warm * share * (copper - plants.air_c)
    felt = core.copy()
    measured = shown = core.copy()
    slope = np.zeros(count)
    held = np.where(hot, 0.035 * plants.gain * first, 0.0)
    left_over = np.zeros(count)
    pad, around = np.full(count, BOARD_C), np.full(count, BOARD_C)
    touched = np.full(count, -1, dtype=np.int32)
    work = np.ones((5, count))  # pad, leak, around, leak from there, wire on the tip
    stored = -(plants.core * core + plants.copper * copper + plants.shaft * shaft)
    supplied, lost, drawn = np.zeros(count), np.zeros(count), np.zeros(count)
    all_shown, all_power = np.empty((ticks, count)), np.empty((ticks, count))
    keeps_felt = np.exp(-STEP_S / plants.lag)
    keeps_shown = np.exp(-TICK_S / plants.filter_s)
    half_wave_w = plants.rated * HALF_WAVES / (HALF_WAVES - 1)

    for tick in range(ticks):
        # the law, by what was read in the last half-wave
        before, measured = measured, felt + drift[tick] + noise[tick]
        slope += 0.4 * ((measured - before) / TICK_S - slope)
        error = aim[tick] - measured
        attacks = error - plants.ahead_s * slope > plants.attack_c
        wanted = plants.gain * (error - plants.derivative_s * slope) + held
        wanted = np.where(attacks, 1.0, wanted)
        duty = np.clip(wanted, 0.0, 1.0)
        moves = plants.gain * error * TICK_S / plants.integral_s
        is_free = ~attacks & (((wanted < 1) | (moves < 0)) & ((wanted > 0) | (moves > 0)))
        held = np.clip(held + np.where(is_free, moves, 0.0), 0.0, 0.9)
        shown = measured + keeps_shown * (shown - measured)
        all_shown[tick] = shown + plants.bias_c
        fired_here = np.zeros(count)
        for wave in range(HALF_WAVES):
            if wave < HALF_WAVES - 1:
                left_over += duty
                fired = (left_over >= 0.5).astype(np.float64)
                left_over -= fired
                fired_here += fired
                watts = fired * half_wave_w * line[tick]
            else:
                watts = np.zeros(count)
            for part in range(2):
                step = tick * STEPS + 2 * wave + part
                now = course.number[step]
                if not np.array_equal(now, touched):
                    fresh = (now != touched) & (now >= 0)
                    of_row = loads[rows[fresh], now[fresh]]
                    pad[fresh] = around[fresh] = of_row[:, 5]
                    work[:, fresh] = of_row[:, :5].T
                    touched = now
                # the end of the tip and the contact, one after the other
                contact = course.conductance[step]
                through = contact * plants.end / (contact + plants.end)
                wire = course.wire_w[step]
                flow = through * (copper - pad)
                out = flow + work[4] * wire
                above = copper - air[tick]
                loss = (
                    plants.convection
                    * draught[tick]
                    * above
                    * np.maximum(above / 300, 0.01) ** 0.25
                )
                loss += plants.radiation * ((copper + SEE_C) ** 4 - (air[tick] + SEE_C) ** 4)
                down = plants.between * (core - copper)
                away = plants.to_shaft * (copper - shaft)
                gone = plants.from_shaft * (shaft - air[tick])
                leak = work[1] * (pad - around)
                core = core + STEP_S * (watts - down) / plants.core
                copper = copper + STEP_S * (down - loss - away - out) / plants.copper
                shaft = shaft + STEP_S * (away - gone) / plants.shaft
                pad += STEP_S * (flow - leak - (1 - work[4]) * wire) / work[0]
                around += STEP_S * (leak - work[3] * (around - BOARD_C)) / work[2]
                sensed = plants.of_copper * copper + (1 - plants.of_copper) * core
                felt = sensed + keeps_felt * (felt - sensed)
                supplied += STEP_S * watts
                lost += STEP_S * (loss + gone)
                drawn += STEP_S * out
        all_power[tick] = fired_here / (HALF_WAVES - 1)
    stored += plants.core * core + plants.copper * copper + plants.shaft * shaft
    return Lived(plants, all_shown.T, all_power.T, supplied, lost, drawn, stored)


def _step(seconds: float) -> int:
    return round((BEFORE_S + seconds) / STEP_S)


def _course(scripts: Sequence[Script], seeds: Sequence[int], steps: int) -> _Course:
    shape = (steps, len(scripts))
    course = _Course(
        np.full(shape, -1, np.int32), np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    )
    for row, (script, seed) in enumerate(zip(scripts, seeds, strict=True)):
        rng = np.random.default_rng([seed, 63])
        for number, load in enumerate(script.touches):
            first, last = _step(load.start), _step(load.end)
            course.number[first:last, row] = number
            course.conductance[first:last, row] = _contact(load, last - first, rng)
            for start, end in script.feeds:
                if start < load.end and end > load.start and load.wire_w:
                    melts = max(first, _step(start + 0.04)), min(last, _step(end + 0.04))
                    course.wire_w[melts[0] : melts[1], row] = load.wire_w
    return course


def _contact(load: Touch, steps: int, rng: np.random.Generator) -> Floats:
    """W/K of each step: the hand, wetting, and where the tip slips."""
    assert isinstance(load, Load)
    seconds = load.start + STEP_S * np.arange(steps)
    wet = 1 - np.exp(-np.maximum(seconds - load.wets_at, 0) / load.wets_s)
    slips = (seconds >= load.slips[0]) & (seconds < load.slips[1])
    share = load.dry_share + (1 - load.dry_share) * np.where(slips, 0.2 * wet, wet)
    hand = np.exp(_wander(rng, steps, STEP_S, 0.25, 0.15))
    conductance: Floats = load.conductance * share * hand
    return conductance


def _padded(scripts: Sequence[Script]) -> Floats:
    most = max(1, *(len(script.touches) for script in scripts))
    loads = np.ones((len(scripts), most, 6))
    for row, script in enumerate(scripts):
        for number, one in enumerate(script.touches):
            assert isinstance(one, Load)
            loads[row, number] = (
                one.capacity,
                one.leak,
                one.around,
                one.around_leak,
                one.wire_on_tip,
                one.begins_c,
            )
    return loads


def _aims(scripts: Sequence[Script], ticks: int) -> Floats:
    """°C by tick; far below any temperature where the heater is off."""
    seconds = np.arange(ticks) * TICK_S - BEFORE_S
    aim = np.empty((ticks, len(scripts)))
    for row, script in enumerate(scripts):
        aim[:, row] = script.settings[0][1] if script.begins_hot else -1000.0
        for start, celsius in script.settings:
            aim[seconds >= start, row] = celsius
        for start, end in script.stands:
            aim[(seconds >= start) & (seconds < end), row] = STAND_C
    return aim


def _disturbed(
    plants: Plants, seeds: Sequence[int], ticks: int
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """By tick and row: what the line gives, draughts, the air, drift and noise of the sensor."""
    line, draught, air, drift, noise = (np.empty((ticks, len(seeds))) for _ in range(5))
    for row, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 64])
        volts = 1 + _wander(rng, ticks, TICK_S, 20.0, 0.008) - 0.03 * _spells(rng, ticks, 50, 3)
        line[:, row] = volts**2
        draught[:, row] = np.maximum(
            1 + _wander(rng, ticks, TICK_S, 3.0, 0.08) + 0.25 * _spells(rng, ticks, 60, 4), 0.5
        )
        air[:, row] = plants.air_c[row] + _wander(rng, ticks, TICK_S, 60.0, 0.8)
        drift[:, row] = _wander(rng, ticks, TICK_S, 40.0, 0.4)
        noise[:, row] = plants.noise[row] * rng.normal(size=ticks)
    return line, draught, air, drift, noise


def _wander(
    rng: np.random.Generator, count: int, every_s: float, memory_s: float, spread: float
) -> Floats:
    keeps = float(np.exp(-every_s / memory_s))
    kicks = rng.normal(size=count) * spread * np.sqrt(1 - keeps**2)
    value, course = float(rng.normal()) * spread, np.empty(count)
    for n, kick in enumerate(kicks.tolist()):
        value = keeps * value + kick
        course[n] = value
    return course


def _spells(rng: np.random.Generator, ticks: int, every_s: float, length_s: float) -> Floats:
    """1 in spells of about so long, about so often; else 0."""
    spells, at = np.zeros(ticks), float(rng.exponential(every_s))
    while at < ticks * TICK_S:
        end = at + length_s * float(rng.uniform(0.5, 1.5))
        spells[round(at / TICK_S) : round(end / TICK_S)] = 1.0
        at = end + float(rng.exponential(every_s))
    return spells


# -- the record ------------------------------------------------------------------------------------


def trials(
    scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    return recorded(simulate(scripts, seeds), scripts, seeds, rates)


def recorded(
    lived: Lived, scripts: Sequence[Script], seeds: Sequence[int], rates: Sequence[float]
) -> dict[float, list[Trial]]:
    return {
        hz: [
            _read(lived, n, script, seed, hz)
            for n, (script, seed) in enumerate(zip(scripts, seeds, strict=True))
        ]
        for hz in rates
    }


def _read(lived: Lived, n: int, script: Script, seed: int, hz: float) -> Trial:
    rng = np.random.default_rng([seed, 65, round(10 * hz)])
    seconds = np.arange(round(script.seconds * hz)) / hz
    plants = lived.plants
    window = max(round(float(plants.mean_s[n]) / TICK_S), 1)
    total = np.concatenate([np.zeros(window), np.cumsum(lived.power[n])])
    mean = (total[window:] - total[:-window]) / window
    # the one is asked for, then the other
    asked = rng.uniform(0.002, 0.008, len(seconds))
    temperature = np.round(lived.shown_c[n][_tick(seconds + asked)])
    power = np.round(1000 * mean[_tick(seconds + asked + 0.006 - float(plants.late_s[n])) - 1])
    lost = rng.random(len(seconds)) < LOST
    temperature[lost] = power[lost] = np.nan
    setting, working = np.empty(len(seconds)), ~lost
    for start, celsius in script.settings:
        setting[seconds >= start] = celsius
    for start, end in script.stands:
        working &= (seconds < start) | (seconds >= end)
    begun = np.array([start for start, _ in script.feeds])
    cycles = np.searchsorted(begun, seconds, side="right").astype(np.float64)
    feeding = np.zeros(len(seconds))
    for start, end in script.feeds:
        feeding[(seconds >= start) & (seconds < end)] = 1.0
    for values, every_s in ((setting, 5.0), (feeding, 2.0), (cycles, 2.0)):
        values[np.arange(len(seconds)) % round(every_s * hz) != 0] = np.nan
    return Trial(seconds, temperature, power, setting, working, feeding, cycles, script)


def _tick(seconds: Floats) -> NDArray[np.int64]:
    """The last one before."""
    ticks: NDArray[np.int64] = np.floor((seconds + BEFORE_S) / TICK_S).astype(np.int64)
    return ticks
