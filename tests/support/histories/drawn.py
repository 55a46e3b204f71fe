"""What happens in each of three hundred histories. A number gives the same one on every machine.

Families, faults, rates and ends go through their lists at different steps, so that thirty
histories in a row have each of them; the rest is drawn.
"""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from dataclasses import dataclass, field

COUNT = 300
FEW = 30  # that `.ci/run` compares
FAMILIES = ("dde", "nae", "dme", "hde", "ucr", "ale", "soldering", "jtse", "omega")
TOOLS = {"dde": (2, 3), "nae": (1, 8), "dme": (2, 1, 4, 3)}  # else one port with tool 2
RATES: tuple[float | str | None, ...] = (6, "auto", 2, 4, "fit", None, 1, 3, "max", 0.5)
FAULTS = (
    "none",
    "lossy",
    "silence",
    "unplugged",
    "tool pulled",
    "setting changed",
    "garbage",
    "late",
    "model refused",
    "heat",
    "refusal",
    "contacts",
    "deaf",
    "status by hand",
    "station error",
    "tool changed",
    "exchanged",
    "robot mode off",
    "unasked bytes",
    "restart",
    "other address",
    "wrong family",
    "hot before",
    "slow",
    "stubborn extractor",
    "no tool",
    "auto",
    "limits changed",
    "stale",
)
OMEGA_FAULTS = (
    "lossy",
    "silence",
    "unplugged",
    "garbage",
    "late",
    "deaf",
    "station error",
    "unasked bytes",
)
"""Faults that an OMEGA can have, of which the manual prints one command."""
ENDS = ("duration", "SIGINT", "duration", "SIGTERM", "goal", "duration")
UNANSWERED = ("RPP1", "RTT1", "WPS1", "WLA1", "RSVR", "RQT1", "RSER", "RPS1")
LIVE_EVERY = 25
LIVE = (
    ("killed", "none"),
    ("SIGINT", "none"),
    ("units", "none"),
    ("killed", "refusal"),
    ("SIGTERM", "silence"),
    ("duration", "none"),
    ("killed", "stubborn extractor"),
    ("joints", "contacts"),
    ("SIGINT", "refusal"),
    ("killed", "none"),
    ("duration", "refusal"),
    ("SIGTERM", "none"),
)
"""How histories on real ports end, and the fault of their first station."""


@dataclass(frozen=True)
class Happening:
    """`what` happens `at` seconds after a station's first question, for some `seconds`."""

    what: str
    at: float = 0.0
    seconds: float = 1e9
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True)
class Bench:
    """A station and what happens to it. `stated` is its family in the line file; `keys` are the
    other keys there.
    """

    name: str
    family: str
    seed: int
    tools: tuple[int, ...]
    stated: str
    keys: str = ""
    address: int | None = 1
    happenings: tuple[Happening, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def recipe(self) -> str:
        """The name of its recipe."""
        return {"jtse": "air", "omega": "omega"}.get(self.family, "tip")


@dataclass(frozen=True)
class History:
    """`ends`: how it ends, and at which second. `live`: with real processes and ports."""

    number: int
    benches: tuple[Bench, ...]
    recipes: dict[str, str]
    duration_s: float | None
    rate: float | str | None
    ends: tuple[str, float]
    live: str = ""
    allow_missing: bool = False
    unasked: tuple[tuple[float, str, bytes], ...] = field(default=())

    @property
    def name(self) -> str:
        """Number, families, faults, rate and end, for people."""
        stations = "+".join(f"{bench.family}({','.join(bench.faults)})" for bench in self.benches)
        kind = "live " if self.live else ""
        return f"{self.number:03d} {kind}{stations} rate={self.rate} end={self.ends[0]}"


def history(number: int) -> History:
    """Draw history `number`."""
    if number % LIVE_EVERY == LIVE_EVERY // 2:
        return _live(number)
    place_in_list = number - (number + LIVE_EVERY // 2) // LIVE_EVERY  # without the live ones
    rng = random.Random(f"history {number}")
    length_s = rng.choice((8.0, 20.0, 40.0, 90.0))
    count = rng.choice((1, 1, 1, 1, 2, 2, 3))
    families = [rng.choice(FAMILIES) for _ in range(count)]
    faults = [rng.choice(FAULTS) for _ in range(count)]
    families[0] = FAMILIES[number % len(FAMILIES)]
    faults[0] = FAULTS[place_in_list % len(FAULTS)]
    if families[0] == "omega" and faults[0] not in OMEGA_FAULTS:  # another one has it
        families.append(FAMILIES[number % (len(FAMILIES) - 1)])
        faults.append(faults[0])
    benches = []
    for place, (family, fault) in enumerate(zip(families, faults, strict=True)):
        further = rng.choice(("none", "heat", "contacts", "lossy", rng.choice(FAULTS)))
        benches.append(_bench(rng, f"s{place + 1}-{family}", family, (fault, further), length_s))
    end = ENDS[(number + number // len(ENDS)) % len(ENDS)]
    at = rng.uniform(0.5, length_s + 3.0)
    states_duration = end == "duration" or rng.random() < 0.3
    unasked = tuple(
        (happening.at + 0.05 * burst, bench.name, _bytes(rng))
        for bench in benches
        for happening in bench.happenings
        if happening.what == "unasked bytes"
        for burst in range(int(happening.value))
    )
    return History(
        number,
        tuple(benches),
        {"tip": _tip(rng, benches), "air": _air(rng), "omega": OMEGA},
        length_s if states_duration else None,
        RATES[(number + number // len(RATES)) % len(RATES)],
        (end, at),
        allow_missing=rng.random() < 0.3,
        unasked=unasked,
    )


def _live(number: int) -> History:
    """Draw a history on real ports: few and plain faults, since no two have the same timing."""
    rng = random.Random(f"live history {number}")
    end, fault = LIVE[number // LIVE_EVERY % len(LIVE)]
    families = rng.sample(("dde", "nae", "hde", "ucr", "jtse", "dme"), 2)
    if end == "joints":
        families = ["nae", "hde"]
    happening = {
        "none": (),
        "refusal": (Happening("refusal", value=3, text="WPS100001"),),
        "silence": (),  # once it has been sampled
        "stubborn extractor": (Happening("stubborn"),),
        "contacts": (Happening("contacts", 4.0, value=2.0),),
    }[fault]
    benches = []
    for place, family in enumerate(families):
        has_fault = place == 0 or fault == "contacts"
        benches.append(
            Bench(
                f"s{place + 1}-{family}",
                family,
                number * 10 + place,
                TOOLS.get(family, (2,)),
                family,
                happenings=happening if has_fault else (),
                faults=(fault,) if has_fault else (),
            )
        )
    recipes = {"tip": _tip(rng, benches, plain=True), "air": _air(rng, plain=True)}
    duration_s = {"duration": 6.0, "units": 60.0, "joints": 60.0}.get(end)
    rate = 5 if end == "joints" else 2
    return History(number, tuple(benches), recipes, duration_s, rate, (end, 0.0), live=end)


# -- stations --------------------------------------------------------------------------------------


def _bench(
    rng: random.Random, name: str, family: str, faults: tuple[str, ...], length_s: float
) -> Bench:
    happenings: list[Happening] = []
    stated = family
    keys = ""
    address: int | None = 1
    tools = TOOLS.get(family, (2,))
    if family == "omega":
        faults = tuple(fault for fault in faults if fault in OMEGA_FAULTS)
    for fault in faults:
        if fault == "other address":
            address = rng.choice((5, None, 20))
            known = rng.random() < 0.7
            if known:
                keys += f"address = {'false' if address is None else address}\n"
        elif fault == "wrong family":
            others = [other for other in FAMILIES if other != family]
            stated = rng.choice(others)
        elif fault == "auto":
            stated = "auto"
        elif fault == "no tool":
            tools = (0, *tools[1:])
        elif fault == "model refused":
            text = rng.choice(("XYZ", "DIE", "DDE9", "?"))
            happenings.append(Happening("name", text=text))
            if rng.random() < 0.3:
                keys += f'model = "{text}"\n'
        else:
            happenings += _happenings(rng, fault, family, length_s)
    if rng.random() < 0.2 and len(tools) > 1 and stated != "auto":
        keys += "ports = [1]\n"
    if rng.random() < 0.2:
        keys += "rated_power_w = 130\n"
    given = tuple(fault for fault in faults if fault != "none")
    return Bench(
        name,
        family,
        rng.randrange(1 << 30),
        tools,
        stated,
        keys,
        address,
        tuple(sorted(happenings, key=lambda happening: happening.at)),
        given,
    )


def _happenings(rng: random.Random, fault: str, family: str, length_s: float) -> list[Happening]:
    """What happens to a station with that fault."""
    at = rng.uniform(0.0, length_s + 2.0)
    short_or_long_s = rng.choice((0.4, 1.0, 2.5, 8.0, 1e9))
    drawn = {
        "lossy": Happening("lossy", value=rng.choice((0.003, 0.01, 0.03, 0.08))),
        "silence": Happening("silence", at, short_or_long_s),
        "unplugged": rng.choice(
            (
                Happening("unplugged", at, short_or_long_s),
                Happening("unplugged", length_s + rng.uniform(0, 2.5), 6.0),
            )
        ),
        "garbage": Happening("garbage", at, rng.choice((0.5, 3.0))),
        "stale": Happening("stale", rng.choice((0.0, at)), rng.choice((1.0, 8.0))),
        "late": Happening("late", at, rng.choice((1.0, 4.0)), value=rng.uniform(0.05, 0.9)),
        "heat": Happening(
            "heat",
            rng.uniform(10.0, max(length_s, 14.0)),
            value=rng.choice((60.0, 110.0, -120.0, -250.0)),
        ),
        "refusal": Happening(
            "refusal",
            rng.choice((0.0, at)),
            rng.choice((0.05, 1.0, 1e9)),
            rng.choice((2, 3, 3, 4, 5, 255)),
            text=rng.choice(("WST1", "WPS1", "WHA1", "RPP1", "WD12", "RTT1", "W", "RSVR", "RPS1")),
        ),
        "contacts": Happening("contacts", 3.0, value=rng.uniform(2.0, 4.0)),
        "deaf": Happening(
            "deaf",
            rng.choice((0.0, at)),
            rng.choice((3.0, 1e9)),
            text="A" if family == "omega" else rng.choice(UNANSWERED),
        ),
        "status by hand": Happening("status", max(at, 3.0), value=rng.choice((0, 1, 2, 3, 10))),
        "station error": Happening("station error", at, value=rng.choice((1, 5, 8))),
        "tool changed": Happening("tool", max(at, 2.0), value=rng.choice((1, 3, 4, 8))),
        "setting changed": Happening("select", max(at, 2.5), value=rng.choice((250, 345, 410))),
        "limits changed": Happening("high", max(at, 2.5), value=rng.choice((200, 340, 450))),
        "robot mode off": Happening("robot off", rng.choice((0.0, at)), rng.choice((2.0, 1e9))),
        "unasked bytes": Happening("unasked bytes", at, value=rng.choice((1, 3, 40))),
        "restart": Happening("restart", max(at, 2.0), 1.5),
        "hot before": Happening("status", value=0),
        "slow": Happening("slow", value=rng.choice((0.02, 0.05, 0.15))),
        "stubborn extractor": Happening("stubborn"),
    }
    if fault in drawn:
        return [drawn[fault]]
    if fault == "tool pulled":
        back = Happening("tool", at + rng.choice((0.7, 3.0, 1e6)), value=2)
        return [Happening("tool", at, value=0), back]
    if fault == "exchanged":
        text = rng.choice(("", "DDE", "NAE", "XYZ"))
        return [
            Happening("unplugged", at, 1.5),
            Happening("exchange", at, value=rng.randrange(1000), text=text),
        ]
    return []


def _bytes(rng: random.Random) -> bytes:
    return bytes(rng.randrange(256) for _ in range(rng.choice((1, 9, 60))))


# -- recipes ---------------------------------------------------------------------------------------


OMEGA = '[recipe]\nname = "omega"\nrevision = 1\nfamilies = ["omega"]\n'


def _tip(rng: random.Random, benches: Sequence[Bench], *, plain: bool = False) -> str:
    working = plain or rng.random() < 0.8
    select_c = rng.choice((320, 350, 360, 385))
    has_extractor = all(bench.stated != "soldering" for bench in benches)
    others = ["dde", "nae", "dme", "hde", "ucr", "ale"]
    families = others if has_extractor else [*others, "soldering"]
    lines = [
        "[recipe]",
        'name = "tip"',
        "revision = 1",
        f"families = {json.dumps(families)}",
        "[temperature]",
        f"select_c = {select_c}",
    ]
    if rng.random() < 0.5:
        lines.append(f"adjust_c = {rng.choice((-4, 0, 3))}")
    lines += ["[sleep]", f"delay_min = {rng.choice((0, 3, 5))}"]
    if rng.random() < 0.5:
        lines.append(f"temperature_c = {rng.choice((150, 180))}")
    lines += ["[hibernation]", f"delay_min = {rng.choice((5, 20, 30))}"]
    if rng.random() < 0.7:
        lines += ["[alarm.high]", f"limit_c = {select_c + rng.choice((15, 40))}"]
        lines.append(f"delay_s = {rng.choice((0.5, 1.5, 3.0))}")
    if rng.random() < 0.6:
        lines += ["[alarm.low]", f"limit_c = {select_c - rng.choice((50, 200))}"]
        lines.append(f"delay_s = {rng.choice((0.5, 2.0))}")
    if rng.random() < 0.3:
        lines += ["[feeder]", "length_mm = 5.0", "speed_mm_s = 9.0"]
    lines += ["[sampling]", 'rate_hz = "auto"']
    if rng.random() < 0.4:
        lines += [f"alarms_every_s = {rng.choice((0.5, 1, 5))}"]
        lines += [f"counters_every_s = {rng.choice((3, 10))}"]
    lines.append("[run]")
    if working:
        lines.append('status = "working"')
    elif rng.random() < 0.5:
        lines.append(f'status = "{"extractor" if has_extractor else "stand"}"')
    if rng.random() < 0.3 and has_extractor:
        lines.append('safe_state = "extractor"')
    if rng.random() < 0.3:
        lines.append("require_tool = false")
    if not plain and rng.random() < 0.5:
        lines.append('on_difference = "continue"')
    if rng.random() < 0.2:
        lines.append("allow_no_cooldown = true")
    if rng.random() < 0.3:
        lines += ["[episodes]", f"dead_band_c = {rng.choice((1, 5))}", "stale_s = 3"]
    return "\n".join([*lines, *_acceptance(rng)]) + "\n"


def _air(rng: random.Random, *, plain: bool = False) -> str:
    lines = [
        "[recipe]",
        'name = "air"',
        "revision = 1",
        'families = ["jtse"]',
        "[air]",
        f"temperature_c = {rng.choice((150, 300, 420))}",
        f"flow_permille = {rng.choice((200, 500, 1000))}",
        f"external_set_c = {rng.choice((100, 200))}",
        'mode = "manual"',
    ]
    if not plain:
        lines.append(f'suction = "{rng.choice(("keep", "on", "off"))}"')
    lines += ["[sampling]", 'rate_hz = "auto"', "[run]", 'status = "on"']
    if rng.random() < 0.4:
        lines.append(f'safe_state = "{rng.choice(("cooling", "off"))}"')
    if rng.random() < 0.4:
        lines.append(f'safe_suction = "{rng.choice(("keep", "off"))}"')
    if not plain and rng.random() < 0.5:
        lines.append('on_difference = "continue"')
    return "\n".join([*lines, *_acceptance(rng)]) + "\n"


def _acceptance(rng: random.Random) -> list[str]:
    if rng.random() < 0.3:
        return []
    lines = ["[acceptance]", f"coverage_percent = {rng.choice((50, 95, 99.9))}"]
    lines.append(f"longest_gap_s = {rng.choice((0.5, 2, 30))}")
    if rng.random() < 0.6:
        lines.append(f"alarms_max = {rng.choice((0, 1))}")
    if rng.random() < 0.5:
        lines.append(f"idle_error_c = {rng.choice((2, 10))}")
    if rng.random() < 0.5:
        lines.append(f"at_work_percent = {rng.choice((50, 95))}")
    if rng.random() < 0.2:
        lines.append("verification_days = 30")
    return lines
