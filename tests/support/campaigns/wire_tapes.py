"""Random tapes of all link faults, by number: a whole run of one station of any family on a wire
that does everything.

``python tests/support campaigns.wire_tapes 4711`` plays tape 4711 again and says what it found; ``0
--hours 1000`` plays from tape 0 on until 1000 hours have passed on the virtual clock. A number
decides everything.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from random import Random

from support.links.noisy_wire import ALL_KINDS, OF_ANY_PROTOCOL, NoisyWire, Tape
from support.oracles.account import assert_account_holds, counted
from support.oracles.believed import judge_rows
from support.oracles.invariants import violations_of
from support.oracles.listed_writes import strange_writes
from support.product import FAMILIES, Family, Peer, StationFacts, StationTask, Steps, text_of
from support.product import sim_questions as questions
from support.virtual.lines import AIR
from support.virtual.virtual_run import RECIPE, Heard, VirtualRun, prepare

OMEGA = '[recipe]\nname = "omega"\nrevision = 1\nfamilies = ["omega"]\n'
LINE = (
    '[line]\nname = "tape"\n[[station]]\nname = "s-1"\nurl = "s-1"\nfamily ='
    ' "{family}"\n{keys}[station.sim]\n{sim}'
)
PACES = {  # rate in Hz, alarms_every_s, counters_every_s, hours
    "brisk": (2.0, 2, 60, 0.2),
    "usual": (0.2, 5, 120, 2.0),
    "sparse": (1 / 15, 30, 600, 24.0),
}
SETTLED_S = 10.0  # until the answer to a question is there, or known to be lost
EACH = 10  # tapes between two lines of progress
MOST_S = 3600.0  # from the end of its time to the end of a run
PHYSICS = ("restart", "stuck", "overheat", "tool", "dropout", "nak", "silence")
OF_OMEGA = (
    "restart",
    "dropout",
    "silence",
    "nak",
    "solder_shortage",
    "clog",
    "not_ready",
    "out_of_range",
)
NOT_UNDERSTOOD = ("00001", "00002")


@dataclass
class Tally:
    """What many tapes came to."""

    tapes: int = 0
    hours: float = 0.0
    questions: int = 0
    readings: int = 0
    due: Counter[str] = field(default_factory=Counter)  # by reason, and "ok"
    did: Counter[str] = field(default_factory=Counter)
    injected: int = 0  # whole answers that nobody can tell from the station's
    recorded: int = 0  # of which stand in the record as values
    misled: int = 0  # questions that became other whole questions
    outcomes: Counter[str] = field(default_factory=Counter)
    unsafe: int = 0  # tools that may be hot and are told of
    broken: list[str] = field(default_factory=list)

    def text(self) -> str:
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.due.most_common())
        return (
            f"{self.tapes} tapes, {self.hours:.0f} virtual hours, {self.questions} questions,"
            f" {self.did.total()} disturbed ({len(self.did)} kinds), {self.misled} turned into"
            f" others\n{self.due.total()} readings due = {reasons}\n{self.injected} forged answers"
            f" injected, {self.recorded} wrong values recorded, each of them one of those\nruns:"
            f" {dict(self.outcomes)}; {self.unsafe} tools that may be hot, each told;"
            f" {len(self.broken)} violations"
        )


@dataclass
class Played:
    """One tape, played."""

    run: VirtualRun
    wire: NoisyWire
    recipe: str


def play(number: int) -> Played:
    """The run of this number, from its beginning to its end."""
    random = Random(number)
    family, wires = random.choice(list(FAMILIES)), []
    pace = random.choice(list(PACES))
    rate, alarms_s, counters_s, hours = PACES[pace]
    recipe = _recipe(random, family, alarms_s, counters_s)
    seconds = 3600 * hours * random.uniform(0.3, 1.0)
    sim = _sim(random, family, seconds, number)
    kinds = OF_ANY_PROTOCOL if family == "omega" else ALL_KINDS
    tape = Tape(
        random,
        random.sample(kinds, random.randint(1, len(kinds))),
        random.choice([0, 60, 400, 400, 400]),
    )

    def pulled(
        _order: StationTask, session: Steps[StationFacts], _cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        wires.append(NoisyWire(_cable, tape, random, is_omega=family == "omega"))  # type: ignore[arg-type]  # it is a tap
        return wires[0].kept(session), wires[0]

    line = LINE.format(
        family=family, keys=_keys(random, family, 1 if pace == "sparse" else 4), sim=sim
    )
    run = prepare(
        line, recipe, duration_s=seconds, rate=None if family == "omega" else rate, pulled=pulled
    )
    if random.random() < 0.2:
        run.at(random.uniform(0, seconds), lambda: run.driver.end("SIGTERM"))
    run.at(seconds + MOST_S, lambda: _never_ended(number))
    return Played(run.go(), wires[0], recipe)


def _never_ended(number: int) -> None:
    raise AssertionError(f"the run of tape {number} has not ended")


def _keys(random: Random, family: str, most: int) -> str:
    keys = "address = false\n" if random.random() < 0.2 and family != "omega" else ""
    several = {"dde": 2, "nae": 2, "dme": 4}.get(family, 1)
    return (
        keys + "ports ="
        f" {sorted(random.sample(range(1, several + 1), random.randint(1, min(several, most))))}\n"
    )


def _recipe(random: Random, family: str, alarms_s: int, counters_s: int) -> str:
    base = {"jtse": AIR, "omega": OMEGA}.get(family, RECIPE)
    if family != "omega":
        base = (
            base.rstrip()
            + f'\non_difference = "{random.choice(["stop", "continue", "continue", "continue"])}"\n'
        )
    rate = "rate_hz = 0.5\n" if family == "omega" else ""
    return (
        f"{base}\n[sampling]\nalarms_every_s = {alarms_s}\ncounters_every_s = {counters_s}\n{rate}"
    )


def _sim(random: Random, family: str, seconds: float, number: int) -> str:
    sim = f"seed = {number}\njoints_per_minute = {random.choice([0, 3, 12])}\n"
    if family != "omega":
        sim += (
            f"turnaround_ms = {random.choice([0.5, 1.0, 5.0, 20.0])}\nnoise_c ="
            f" {random.choice([0.0, 2.0])}\n"
        )
        sim += "tool = 1\n" if family == "jtse" else ""
    return sim + "".join(
        _fault(random, family, seconds) for _ in range(random.choice([0, 1, 3, 8]))
    )


def _fault(random: Random, family: str, seconds: float) -> str:
    kind = random.choice(OF_OMEGA if family == "omega" else PHYSICS)
    keys: dict[str, object] = {"kind": kind, "at_s": round(random.uniform(0, seconds), 2)}
    keys["for_s"] = round(random.choice([random.uniform(0.1, 9), random.uniform(1, 300)]), 2)
    if kind == "nak":
        keys |= {
            "code": random.choice([1, 2, 3, 4, 5, 6, 99999]),
            "every": random.choice([1, 2, 7]),
        }
    elif kind == "tool":
        keys["code"] = random.choice([0, 1, 2])
    return "\n[[station.sim.fault]]\n" + "".join(
        f"{key} = {value!r}\n" for key, value in keys.items()
    )


# -- what must hold of it --------------------------------------------------------------------------


def judge(number: int, played: Played, tally: Tally) -> None:
    """Put what this tape came to into the tally, and all that does not hold of it into
    `tally.broken`.
    """
    run, wire = played.run, played.wire
    verdict = judge_rows(run, wire)
    broken = [
        *verdict.lies,
        *_not_equal(verdict.recorded, verdict.due_to_be),
        *_account(run),
        *_strange_writes(played),
    ]
    broken += [
        text for text in violations_of(run, as_sent=True) if not text.startswith(("I4", "I7"))
    ]
    broken += [*_settings(played), *_counters(played), *_unsafe(run), *_forgotten_flags(run, wire)]
    tally.tapes += 1
    tally.hours += (run.driver.clock.monotonic() - run.t0) / 3600
    tally.questions += len(wire.books)
    tally.readings += verdict.readings
    tally.did += wire.did
    tally.injected += len(wire.forgeries)
    tally.recorded += len(verdict.recorded)
    tally.misled += len(wire.misled)
    tally.outcomes[run.facts.outcome] += 1
    tally.unsafe += len(run.facts.unsafe)
    for signals in counted(run).values():
        tally.due += signals
    tally.broken += [f"tape {number}: {text}" for text in broken]


def _not_equal(
    recorded: set[tuple[int, int, str]], due: set[tuple[int, int, str]]
) -> Iterator[str]:
    if recorded != due:
        yield f"recorded wrong {sorted(recorded)}, by the wire's own count {sorted(due)}"


def _account(run: VirtualRun) -> Iterator[str]:
    try:
        assert_account_holds(run)
    except AssertionError as error:
        yield f"the account does not hold: {error}"
    if run.facts.outcome not in ("completed", "stopped", "refused", "gone"):
        yield f"it ended as {run.facts.outcome}: {run.facts.reason}"


def _strange_writes(played: Played) -> Iterator[str]:
    """What left the session is on the fixed list, and each setting once; what the station took
    beyond that, the wire made.
    """
    family = played.run.facts.family
    asked = [Heard(one.at, one.text, one.truth, one.truth) for one in played.wire.books]
    yield from (f"I7: {text} was written" for text in strange_writes(asked, family, played.recipe))
    writes = [one for one in played.wire.books if one.text.startswith("W") and family != "omega"]
    done = Counter(one.text for one in writes if not _is_not_understood(one.truth, one.given))
    yield from (
        f"I7: {text} was written {n} times"
        for text, n in done.items()
        if n > 1 and not text.startswith(("WPS", "WSTP"))
    )


def _is_not_understood(truth: str | None, given: list[tuple[float, bytes]]) -> bool:
    """Whether the session was told, in a whole answer or a forged one, that the station did not
    understand.
    """
    return any(
        b"N" in data and data[-7:-2].decode("ascii", "replace") in NOT_UNDERSTOOD
        for _, data in given
    )


def _settings(played: Played) -> Iterator[str]:
    """A setting that stands as read was said by the station itself."""
    run = played.run
    if run.facts.family == "omega":
        return
    said = _said(played)
    for row in run.memory.settings:
        if row.readback is not None and (row.setting, row.port or 0, row.readback) not in said:
            yield (
                f"setting {row.setting} of port {row.port} is recorded as {row.readback}; the"
                " station never said so"
            )


def _counters(played: Played) -> Iterator[str]:
    said = _said(played)
    commands = {counter.name: counter.command for counter in _family(played.run).counters}
    for row in played.run.memory.counters:
        if (
            row.value is not None
            and (commands[row.counter], row.port or 0, _plain(row.value)) not in said
        ):
            yield (
                f"counter {row.counter} of port {row.port} is recorded as {row.value}; the station"
                " never said so"
            )


def _plain(value: object) -> str:
    return f"{float(str(value)):g}" if str(value).replace(".", "", 1).isdigit() else str(value)


def _family(run: VirtualRun) -> Family:
    return FAMILIES[run.facts.family]


def _said(played: Played) -> set[tuple[str, int, str]]:
    """All that the station said, by command, port and value, as text and as a plain number."""
    family, found = _family(played.run), set()
    known = questions(family.name, tuple(family.ports or (1, 2, 3, 4)))
    for question, truth in {
        (one.text.rstrip(), one.truth) for one in played.wire.books if one.truth
    }:
        asked = known.get(question)
        if asked is None or not truth.startswith(f"A{asked.code}"):
            continue
        try:
            value = asked.command.quantity.decode(truth[1 + len(asked.code) :])
        except ValueError:
            continue
        found |= {
            (asked.command.name, asked.port, text_of(value)),
            (asked.command.name, asked.port, _plain(value)),
        }
    return found


def _unsafe(run: VirtualRun) -> Iterator[str]:
    """What the run touched rests in the end, by the station's own physics, or the facts say that it
    may not.
    """
    if run.facts.family in ("omega", "jtse"):
        return
    for number in run.facts.touched:
        port = run.station.plant.ports[number]
        if (
            port.tool
            and port.doing.state == 0
            and not any(f"port {number}:" in text for text in run.facts.unsafe)
        ):
            yield f"unsafe: port {number} is at work, and nothing says so: {run.facts.safe_state}"


def _forgotten_flags(run: VirtualRun, wire: NoisyWire) -> Iterator[str]:
    """A flag that the station told, and by that forgot, is known by then, or an event says that
    flags are not known.
    """
    for one in wire.books:
        if one.truth and one.truth.startswith("ATA") and "1" in one.truth[4:]:
            for side, place in (("high", 8), ("low", 7)):
                if one.truth[place] == "1" and not _is_told(run, int(one.truth[3]), side, one.at):
                    yield (
                        f"the flag of port {one.truth[3]}, {side}, of {one.at - run.t0:.1f} s is in"
                        " no event"
                    )


def _is_told(run: VirtualRun, port: int, side: str, at: float) -> bool:
    """Whether it was known to be set before, or a little later an event says so, or that nobody
    knows.
    """
    begin, end = run.utc_s(at) * 1e6, (run.utc_s(at) + SETTLED_S) * 1e6
    told = [
        event
        for event in run.memory.events
        if event.port == port and (event.raw == side or event.kind == "alarm.unknown")
    ]
    before = [event.kind for event in told if event.time < begin]
    after = [event.kind for event in told if begin <= event.time <= end]
    return any(not kind.endswith("ended") for kind in (*before[-1:], *after))


def campaign(
    numbers: Iterable[int],
    hours: float = float("inf"),
    say: Callable[[Tally], object] = lambda tally: None,
) -> Tally:
    """Play tapes in turn until `hours` are over on the virtual clock; `say` is told after each."""
    tally = Tally()
    for number in numbers:
        judge(number, play(number), tally)
        say(tally)
        if tally.hours >= hours:
            break
    return tally


def _progress(tally: Tally) -> None:
    if tally.tapes % EACH == 0 or tally.broken:
        print(tally.text(), *tally.broken, sep="\n", file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("number", type=int, help="of the first tape")
    parser.add_argument(
        "--hours", type=float, default=0.0, help="virtual hours to play; 0: this tape alone"
    )
    told = parser.parse_args()
    began = time.monotonic()
    tally = campaign(range(told.number, told.number + 10**6), told.hours, _progress)
    print(f"tapes {told.number} to {told.number + tally.tapes - 1}: {tally.text()}")
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
    print("\n".join(tally.broken))
    return bool(tally.broken)


if __name__ == "__main__":
    sys.exit(main())
