"""A soak: a line of virtual stations on which everything goes wrong that can, recorded for as long
as one likes.

The stations live in a process of their own (`jbclog sim`), with faults of every kind that they know
drawn from a seed; each has calm between two of them. Meanwhile cables come back as new terminals,
the recorder's wall clock is stepped, its guard is killed or stopped, another program reads the open
run, and what the recorder holds is looked at from outside. `Soak.wrong` says what of the record
does not fit what was done.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from statistics import median
from typing import get_args

import pandas as pd

from support import program
from support.command import recipe_text
from support.faults.guarded import guard_of
from support.links.flooders import Flooded, Flooders
from support.oracles.invariants import Ended, violations
from support.product import (
    OMEGA_FAULT_KINDS,
    OMEGA_FAULTS,
    FaultKind,
    Manifest,
    check_run,
    names_of_open_run,
    read_manifest,
)
from support.virtual.lines import fault
from support.virtual.tapped_sim import TappedSim, heard_in

FAMILIES = ("dde", "nae", "dme", "hde", "ucr", "ale", "jtse", "omega", "soldering")
QUIET_S = 6.0  # at the start and at the end nothing is done to anybody
EDGE_S = 0.1  # of the two processes' clocks, and of what a file of faults is written to
# in which something may still come of a fault that is over: a station that was slow may be gone for
# 5 s at most
SETTLES_S = 12.0
# that the stations' process waited for a processor within `LOOK_BACK_S`: by as much their answers
# were late
STARVED_S = 0.1
LOOK_BACK_S = 3.0
# in the whole soak, on a machine that is too busy for what is said of its guard
STARVED_ALL_S = 2.0
STEPS_S = (3600.0, -3600.0, 2.5, -1.5, 7200.0, -7200.0)
STEP_EVERY_S, GUARD_EVERY_S, LOOK_S = 60.0, 150.0, 2.0
GUARD_AGAIN_S = 6.0
MOST_GUARDS = 15
MOST_GROWTH = 0.10
MOST_GROWTH_MB = 12.0
# that may be open in one half more than in the other: parts that are sealed, ports that are opened
MOST_DESCRIPTORS = 12
FLOOD = "flood"  # no fault of a station: somebody else on its wire
# others could be taken for an answer until the flood is seen to be one
FLOODS = ("noise", "STX alone")
FLOOD_BYTES_PER_S = 200_000.0
OF_THEMSELVES = (
    "host.busy",
    "station.slow",
    "safety.not_available",
)  # nothing was done to the station, or it is told up to minutes later
WARNED = ("warning", "error", "critical")

RECIPES = {
    "tip": recipe_text(
        "soak",
        *("soldering", "dde", "nae", "dme", "hde", "ucr", "ale"),
        more="""on_difference = "continue"
[alarm.high]
limit_c = 400
delay_s = 0.5
[sampling]
rate_hz = 1
""",
    ),
    "air": (
        """
[recipe]
name = "soak-air"
revision = 1
families = ["jtse"]
[air]
temperature_c = 300
flow_permille = 500
[sampling]
rate_hz = 1
[run]
status = "on"
on_difference = "continue"
"""
    ),
    "omega": (
        """
[recipe]
name = "soak-omega"
revision = 1
families = ["omega"]
[sampling]
rate_hz = 1
"""
    ),
}
RECIPE_OF = {"jtse": "air", "omega": "omega"}

READER = """
import sys, time, warnings
from pathlib import Path
from jbclog import open_run

warnings.simplefilter("error")
folder, every_s, seen, looks = Path(sys.argv[1]), float(sys.argv[2]), {}, 0
while sys.stdin.readline():
    run = open_run(folder)
    rows = run.samples(columns=["station", "port", "tick"])
    places = rows.groupby(["station", "port"], observed=True)["tick"]
    now = {place: list(ticks) for place, ticks in places}
    for place, ticks in seen.items():
        if now.get(place, [])[: len(ticks)] != ticks:
            sys.exit(f"look {looks}: rows of {place} that had been read are not there as they were")
    seen, looks = now, looks + 1
    len(run.events())
print(looks, sum(map(len, seen.values())))
"""


def waited_s(pid: int) -> float:
    """For how long a process has wanted to run while others did."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9


# -- what is done ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Odd:
    """A fault of one station: seconds after its first question."""

    kind: str
    begin: float
    end: float
    keys: dict[str, object]

    @property
    def text(self) -> str:
        return fault(
            self.kind, at_s=round(self.begin, 2), for_s=round(self.end - self.begin, 2), **self.keys
        )


def kinds_of(family: str) -> list[str]:
    """Every kind of fault that its virtual station knows."""
    known = get_args(FaultKind)
    return [
        kind
        for kind in known
        if (kind in OMEGA_FAULT_KINDS if family == "omega" else kind not in OMEGA_FAULTS)
    ]


def drawn(rng: Random, kind: str) -> tuple[float, dict[str, object]]:
    """How long a fault of this kind lasts, and its own keys."""
    match kind:
        case "silence":
            return rng.choice([0.3, 2.0, 8.0]), {}
        case "noise":
            return rng.uniform(0.5, 4), {
                "bytes_count": rng.randint(1, 256),
                "every": rng.randint(1, 3),
            }
        case "flip":
            return rng.uniform(0.5, 4), {"bits": rng.randint(1, 8), "every": rng.randint(1, 4)}
        case "late":
            return rng.uniform(0.3, 4), {
                "by_s": round(rng.uniform(0.05, 1.9), 2),
                "every": rng.randint(1, 3),
            }
        case "nak":
            return rng.uniform(0.5, 3), {"code": rng.choice([1, 2, 3, 5, 99999]), "only": "read"}
        case "dropout":
            return rng.choice([0.4, 2.0, 7.0]), {}
        case "restart":
            return rng.uniform(1, 4), {}
        case "overheat":
            return rng.uniform(2, 6), {"by_c": 40.0}
        case "tool":
            return rng.uniform(3, 6), {"code": 0}
        case _:
            return rng.uniform(1, 5), {}


def history(rng: Random, family: str, seconds: float, calm_s: float) -> list[Odd]:
    """Faults of one station, each kind as often as any other, with calm between them."""
    found: list[Odd] = []
    kinds: list[str] = []
    at = QUIET_S + rng.uniform(0, calm_s)
    while True:
        kinds = kinds or rng.sample(kinds_of(family), len(kinds_of(family)))
        kind = kinds.pop()
        lasts, keys = drawn(rng, kind)
        if at + lasts > seconds - QUIET_S - SETTLES_S:
            return found
        if family == "omega":
            keys.pop("only", None)
        found.append(Odd(kind, at, at + lasts, keys))
        at += lasts + SETTLES_S + rng.uniform(0.5, 1.5) * calm_s


def with_a_flood(rng: Random, odd: list[Odd], seconds: float) -> list[Odd]:
    """A history without what takes the cable out, which a flooder is in, and with one flood in the
    place of one of its faults.
    """
    found = [one for one in odd if one.kind != "dropout"]
    number = rng.randrange(len(found)) if found else 0
    begin = found[number].begin if found else QUIET_S + rng.uniform(0, seconds / 4)
    flood = Odd(
        FLOOD,
        begin,
        begin + rng.uniform(1.5, 4.0),
        {"shape": rng.choice(FLOODS), "tcp": rng.random() < 0.5},
    )
    return [*found[:number], flood, *found[number + 1 :]]


def line_text(families: dict[str, str], histories: dict[str, list[Odd]]) -> str:
    """The line of these stations, each with the faults of its history where it has one."""
    tables = ['[line]\nname = "soak"\n']
    for name, family in families.items():
        ports = "" if family in ("jtse", "omega") else "ports = [1]\n"
        recipe = RECIPE_OF.get(family, "tip")
        tables.append(
            f'[[station]]\nname = "{name}"\nurl = "{name}"\nfamily = "{family}"\n{ports}recipe ='
            f' "{recipe}.toml"\n'
        )
        faults = "".join(one.text for one in histories.get(name, ()) if one.kind != FLOOD)
        tables.append(
            f"[station.sim]\nseed = {name.rpartition('-')[2]}\nturnaround_ms = 1.0\n{faults}"
        )
    return "\n".join(tables)


@dataclass
class Look:
    """What the recorder held, seen from outside."""

    at: float
    memory_mb: float
    descriptors: int
    waited_s: float  # that it wanted to run, and others did


@dataclass
class Soak:
    """One soak of `seconds` on `count` stations, below `home`."""

    home: Path
    seconds: float
    count: int
    seed: int
    calm_s: float = 20.0
    looks: list[Look] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)  # of the clock, as they were done
    waits: list[tuple[float, float]] = field(
        default_factory=list
    )  # monotonic seconds, that the stations' process has waited until then
    # UTC (of a clock that nobody steps) and signal
    guards: list[tuple[float, str]] = field(default_factory=list)
    new_terminals: int = 0
    replugged: int = 0
    said: str = ""
    code: int | None = None
    read: tuple[int, int] = (0, 0)  # looks of the reader, rows in its last

    def __post_init__(self) -> None:
        rng = Random(self.seed)
        self.families = {
            f"{FAMILIES[n % len(FAMILIES)]}-{n + 1}": FAMILIES[n % len(FAMILIES)]
            for n in range(self.count)
        }
        self.histories = {
            name: history(rng, family, self.seconds, self.calm_s)
            for name, family in self.families.items()
        }
        able = [
            name for name, family in self.families.items() if family in ("dde", "nae", "dme", "hde")
        ]
        self.flooded = rng.sample(able, max(1, self.count // 5))
        for name in self.flooded:
            self.histories[name] = with_a_flood(rng, self.histories[name], self.seconds)
        self.rng = rng
        self._terminals: dict[str, str] = {}
        self._taken: list[tuple[int, int]] = []

    @property
    def out(self) -> Path:
        return self.home / "runs"

    @property
    def log(self) -> Path:
        return self.home / "heard.jsonl"

    @property
    def folder(self) -> Path:
        (folder,) = (path for path in self.out.iterdir() if path.is_dir())
        return folder

    # -- doing it ----------------------------------------------------------------------------------

    def write_line(self) -> list[Path]:
        """The line file; returns those that hold its stations with their faults."""
        (self.home / "line.toml").write_text(line_text(self.families, {}))
        parts = [self.home / f"{name}.line.toml" for name in self.families]
        for part, (name, family) in zip(parts, self.families.items(), strict=True):
            part.write_text(line_text({name: family}, self.histories))
        return parts

    def go(self) -> None:
        parts = self.write_line()
        for name, text in RECIPES.items():
            (self.home / f"{name}.toml").write_text(text)
        with TappedSim(self.home / "line.toml", self.home / "served", self.log, parts) as sim:
            line = sim.line_path
            for name in RECIPES:
                (line.parent / f"{name}.toml").write_text(RECIPES[name])
            with self._flooded_links(line):
                words = ["run", "--line", line, "--out", self.out, "-d", f"{self.seconds:g}s"]
                steps = ",".join(f"step={STEPS_S[n % len(STEPS_S)]:g}" for n in range(1000))
                command = program("faults.odd_host", steps, *words)
                # what others left hot is none of its business
                own = {**os.environ, "XDG_STATE_HOME": str(self.home / "state")}
                recorder = subprocess.Popen(
                    command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=own
                )
                try:
                    assert sim.pid is not None
                    self._accompany(recorder, line.parent, sim.pid)
                    self.said = recorder.communicate(timeout=120)[1]
                finally:
                    recorder.kill()
                    recorder.communicate()
        self.code = recorder.returncode

    @contextmanager
    def _flooded_links(self, line: Path) -> Iterator[None]:
        """Flooders between the run and these stations; the line file leads to them."""
        floods = {
            name: one for name in self.flooded for one in self.histories[name] if one.kind == FLOOD
        }
        links = [
            Flooded(
                "" if one.keys["tcp"] else str(self.home / f"near-{name}"),
                str(line.parent / name),
                str(one.keys["shape"]),
                FLOOD_BYTES_PER_S,
                one.begin,
                one.end,
            )
            for name, one in floods.items()
        ]
        with Flooders(self.home / "flooders.json", links) as served:
            text = line.read_text()
            for name, url in zip(floods, served.urls, strict=True):
                text = text.replace(f'"{line.parent / name}"', f'"{url}"')
            line.write_text(text)
            yield

    def _accompany(self, recorder: subprocess.Popen[str], links: Path, stations: int) -> None:
        """Do to the recorder what is to be done, until it has ended, and look at it."""
        while recorder.poll() is None and not self._has_begun():
            time.sleep(0.05)
        began = time.monotonic()
        step_at, guard_at, look_at = began + QUIET_S, began + QUIET_S + 3, began
        reader = subprocess.Popen(
            [sys.executable, "-c", READER, str(self.folder), "0"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        end = began + self.seconds
        while recorder.poll() is None and time.monotonic() < end - QUIET_S:
            now = time.monotonic()
            self.waits.append((now, waited_s(stations)))
            self._look_at_links(links)
            if now >= step_at:
                step_at = now + min(STEP_EVERY_S, self.seconds / 5)
                self._step(recorder)
            if now >= guard_at and len(self.guards) < MOST_GUARDS:
                guard_at = now + max(
                    min(GUARD_EVERY_S, self.seconds / 3), GUARD_AGAIN_S, self.seconds / MOST_GUARDS
                )
                self._strike_guard(recorder)
            if now >= look_at:
                look_at = now + max(LOOK_S, self.seconds / 500)
                self._look(recorder.pid)
                with suppress(BrokenPipeError):
                    assert reader.stdin is not None
                    reader.stdin.write("look\n")
                    reader.stdin.flush()
            time.sleep(0.05)
        said, _ = reader.communicate(timeout=120)
        assert reader.returncode == 0, "the other program could not read the open run"
        self.read = tuple(map(int, said.split()))  # type: ignore[assignment]  # two of them
        self._release()

    def _has_begun(self) -> bool:
        return self.out.is_dir() and any(map(names_of_open_run, self.out.glob("*/")))

    def _step(self, recorder: subprocess.Popen[str]) -> None:
        recorder.send_signal(signal.SIGUSR1)
        self.steps.append(STEPS_S[len(self.steps) % len(STEPS_S)])

    def _strike_guard(self, recorder: subprocess.Popen[str]) -> None:
        guard = guard_of(recorder.pid)
        if guard is not None:
            number = self.rng.choice([signal.SIGKILL, signal.SIGSTOP])
            self.guards.append((time.monotonic(), number.name))
            with suppress(ProcessLookupError):
                os.kill(guard, number)

    def _look_at_links(self, links: Path) -> None:
        """Whose cable is out gets another terminal when it is back: its number is taken by somebody
        else meanwhile.
        """
        for name in self.families:
            link = links / name
            device = str(link.readlink()) if link.is_symlink() else ""
            before = self._terminals.get(name, device)
            if not device and before:
                self._taken.append(os.openpty())
            if device and not before:
                self.replugged += 1
            if device and device != self._terminals.get(f"{name} was", device):
                self.new_terminals += 1
            self._terminals[name] = device
            if device:
                self._terminals[f"{name} was"] = device
        while len(self._taken) > self.count:
            self._let_go(self._taken.pop(0))

    def _release(self) -> None:
        while self._taken:
            self._let_go(self._taken.pop())

    @staticmethod
    def _let_go(pair: tuple[int, int]) -> None:
        for descriptor in pair:
            os.close(descriptor)

    def _look(self, pid: int) -> None:
        with suppress(OSError):
            place = Path(f"/proc/{pid}")
            memory = (
                int((place / "statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
            )
            self.looks.append(
                Look(
                    time.monotonic(),
                    memory,
                    sum(1 for _ in (place / "fd").iterdir()),
                    waited_s(pid),
                )
            )

    # -- what came of it ---------------------------------------------------------------------------

    def manifest(self) -> Manifest:
        return read_manifest(self.folder)

    def wrong(self) -> list[str]:
        """What does not hold: of the record (I1 to I9), of its events, of what the recorder held,
        of tools.
        """
        wires = heard_in(self.log)
        zero = {name: heard[0].at for name, heard in wires.items()}
        found = violations(self.folder, wires, ended=Ended(self.code or 0, self.said), as_sent=True)
        found += [f"exit code {self.code}: {self.said[-1000:]}"] if self.code not in (0, 1) else []
        found += check_run(self.folder) and ["`check` finds something"]
        return [*found, *self.hot(), *self._false_events(zero), *self._not_flat()]

    def hot(self) -> Iterator[str]:
        for facts in self.manifest().stations:
            if facts.outcome != "completed":
                yield f"{facts.name}: {facts.outcome}: {facts.reason}"
            if facts.unsafe or set(facts.safe_state.values()) - {"verified"}:
                yield f"{facts.name}: {facts.safe_state}, {facts.unsafe}"

    def _false_events(self, zero: dict[str, float]) -> Iterator[str]:
        events = pd.read_parquet(self.folder / "events")
        steps = [float(value) for value in events["value"][events["kind"] == "clock.step"]]
        if len(steps) != len(self.steps) or any(
            abs(one - other) > 1 for one, other in zip(steps, self.steps, strict=True)
        ):
            yield f"the clock was stepped by {self.steps}, and the record has {steps}"
        told = set(events["station"][events["kind"] == "link.flooded"])
        if not told >= set(self.flooded):  # the noise of a fault may be one, too
            yield f"the links of {self.flooded} were flooded, and the record has {told}"
        kinds = Counter(events["kind"])
        # on a busy machine a guard may seem to stand still
        starved = self.waits[-1][1] - self.waits[0][1] if self.waits else 0.0
        if kinds["guard.lost"] != len(self.guards) and not (
            kinds["guard.lost"] > len(self.guards) and starved > STARVED_ALL_S
        ):
            yield (
                f"the guard was struck {len(self.guards)} times: {self.guards}; the record has"
                f" {kinds['guard.lost']} times"
            )
        for kind in kinds:
            if (
                kind.startswith(("guard.", "host.suspended", "identity.", "record."))
                and kind != "guard.lost"
            ):
                yield (
                    f"nothing of that kind was done: {kind},"
                    f" {list(events['text'][events['kind'] == kind])}"
                )
        yield from self._untrue(events, zero)

    def _untrue(self, events: pd.DataFrame, zero: dict[str, float]) -> Iterator[str]:
        """Warnings about stations to which nothing was done."""
        manifest = self.manifest()
        offset = (manifest.t0_utc or 0.0) - (manifest.t0_mono or 0.0)
        for row in events.to_dict("records"):
            name = row["station"]
            if (
                isinstance(name, str)
                and row["severity"] in WARNED
                and row["kind"] not in OF_THEMSELVES
            ):
                after = row["time"].timestamp() - offset - zero[name]
                if not self._was_odd(name, after) and not self._were_starved(zero[name] + after):
                    yield (
                        f"nothing was done to {name} at {after:.1f} s: {row['kind']}: {row['text']}"
                    )

    def _was_odd(self, name: str, second: float) -> bool:
        return any(
            odd.begin - EDGE_S <= second <= odd.end + SETTLES_S for odd in self.histories[name]
        )

    def _were_starved(self, at: float) -> bool:
        """Whether the stations' process wanted to run and others did: then what was said of a
        station may be true.
        """
        waits = [waited for when, waited in self.waits if at - LOOK_BACK_S <= when <= at + EDGE_S]
        return bool(waits) and waits[-1] - waits[0] > STARVED_S

    def _not_flat(self) -> Iterator[str]:
        """Against the second quarter: in the first one everything is met for the first time."""
        quarter = len(self.looks) // 4
        if quarter < 10:
            return
        early, late = self.looks[quarter : 2 * quarter], self.looks[-quarter:]
        before, after = (median(look.memory_mb for look in some) for some in (early, late))
        if after - before > max(MOST_GROWTH * before, MOST_GROWTH_MB):
            yield f"memory rose from {before:.1f} to {after:.1f} MB"
        before, after = (max(look.descriptors for look in some) for some in (early, late))
        if after - before > MOST_DESCRIPTORS:
            yield f"open descriptors rose from {before} to {after}"
