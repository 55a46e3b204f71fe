"""Events about the host or a link agree with the data of all stations of the run.

Some stations answer slowly, fall silent and come back, at random; at random the host stops. The
last station always answers at once, so it has a value for every tick at which the host ran. The
test knows what was done to which station; the record must say the same.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from random import Random

import pandas as pd
import pytest

from support.command import jbclog
from support.oracles.account import assert_account_holds
from support.oracles.printed_omega import PageOmega
from support.product import (
    COLUMN,
    SUSPENDED_S,
    Peer,
    StationFacts,
    StationTask,
    Steps,
    check_run,
    read_manifest,
)
from support.virtual.lines import line
from support.virtual.served_line import ServedLine
from support.virtual.virtual_run import VirtualRun, line_text, prepare

CAMPAIGN = 400
SLICE = 6
DURATION_S = 120.0
QUIET_S = 10.0  # at the start, when everything is read
SEED = 20261122
STATIONS = 3
MOST_DELAY_S = 1.9
# a station that was slow may still count as gone, or is not asked again yet
SETTLES_S = 15.0
BUSY_S = 4.0  # longest stop that does not count as a suspended host
Phase = tuple[float, float, float | None]
"""From when to when a station answers so many seconds late, or (None) not at all; seconds after the
beginning.
"""


@dataclass
class Slow:
    """A cable on which answers take as long as the phases say, and stay in order."""

    cable: Peer
    phases: Sequence[Phase]
    t0: float
    last: float = field(default=0.0)

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        delay = next(
            (delay for begin, end, delay in self.phases if begin <= now - self.t0 < end), 0.0
        )
        found = [(at, answer) for at, answer in self.cable.receive(data, now)]
        if delay is None:
            return []
        moved = [(max(at + delay, self.last), answer) for at, answer in found]
        self.last = max([self.last, *(at for at, _ in moved)])
        return moved

    def is_unplugged(self, now: float) -> bool:
        return self.cable.is_unplugged(now)


def history(rng: Random) -> list[Phase]:
    """Return phases in which a station answers late, for a while or once, or is silent."""
    phases, at = [], QUIET_S
    while at < DURATION_S:
        at += rng.expovariate(1 / 10)
        lasts = rng.choice([0.05, 0.5, 3.0, 9.0]) * (0.5 + rng.random())
        delay = (
            None
            if rng.random() < 0.4
            else rng.choice([0.02, 0.1, 0.5, MOST_DELAY_S]) * (0.5 + rng.random() / 2)
        )
        phases.append((at, at + lasts, delay))
        at += lasts
    return phases


def stops(rng: Random) -> list[Phase]:
    """Return when the host stops: long enough to be reported, or so short that it was only busy."""
    lengths = [
        rng.choice([rng.uniform(0.3, BUSY_S), rng.uniform(SUSPENDED_S + 3, 15.0)])
        for _ in range(rng.choice([0, 0, 1, 3]))
    ]
    begins = accumulate(rng.uniform(5, 40) for _ in lengths)
    return [
        (QUIET_S + begin, QUIET_S + begin + length, None)
        for begin, length in zip(begins, lengths, strict=True)
    ]


@dataclass
class Trial:
    """One run, with every fault and its target."""

    run: VirtualRun
    phases: dict[str, list[Phase]]
    stopped: list[tuple[float, float]]  # when the host really stopped, monotonic

    @classmethod
    def of(cls, seed: int) -> Trial:
        rng = Random(seed)
        phases = {f"dde-{number}": history(rng) for number in range(1, STATIONS)} | {
            f"dde-{STATIONS}": []
        }

        def slow(
            order: StationTask, session: Steps[StationFacts], cable: Peer
        ) -> tuple[Steps[StationFacts], Peer]:
            return session, Slow(cable, phases[order.name], order.t0)

        run = prepare(
            line(*STATIONS * [""]),
            duration_s=DURATION_S,
            rate=rng.choice([1.0, 4.0, 8.0]),
            pulled=slow,
        )
        trial = cls(run, phases, [])
        for begin, end, _ in stops(rng):
            run.at(begin, trial._stop(end - begin))
        run.go()
        return trial

    def _stop(self, seconds: float) -> Callable[[], None]:
        def stop() -> None:
            clock = self.run.driver.clock
            began = clock.monotonic()
            clock.advance_to(began + seconds)
            self.stopped.append((began, began + seconds))

        return stop

    def moment(self, micros: int | None) -> float:
        """Return an event's time on the monotonic clock."""
        assert micros is not None
        return micros / 1e6 - self.run.utc_s(0.0)

    def was_stopped(self, begin: float, end: float, least_s: float = 0.0) -> bool:
        """Whether the host really stopped for that long between these moments."""
        return any(
            min(end, stop) - max(begin, start) > least_s - 1e-3 for start, stop in self.stopped
        )

    def was_odd(self, station: str, moment: float) -> bool:
        """Whether the station had a fault shortly before."""
        return any(
            begin <= moment - self.run.t0 <= end + SETTLES_S
            for begin, end, _ in self.phases[station]
        )


def assert_all_agree(trial: Trial) -> int:
    """Compare each event with the injected faults and with the rows of all stations; return the
    number of events.
    """
    run, looked = trial.run, 0
    period = run.facts.period_s or 1.0
    read = sorted(
        row[COLUMN["time"]]
        for row in run.memory.samples
        if row[COLUMN["temperature_c"]] is not None
    )
    for event in run.memory.events:
        until = trial.moment(event.time)
        match event.kind:
            case "host.suspended":
                since, seconds = trial.moment(event.earliest), event.value or 0.0
                assert trial.was_stopped(since, since + seconds, seconds), event
                begin, end = (
                    round((run.utc_s(moment)) * 1e6)
                    for moment in (since + 0.001, since + seconds - 0.001)
                )
                assert bisect_right(read, begin) == bisect_right(read, end), (
                    f"a station was read meanwhile: {event}"
                )
            case "host.busy":
                assert trial.was_stopped(
                    trial.moment(event.earliest) - period - 2 * MOST_DELAY_S, until
                ), event
            case "link.lost":
                assert trial.was_odd(event.station or "", until), event
            case kind if kind.startswith(("clock.", "guard.", "host.")):
                pytest.fail(f"nothing of that kind was done: {event}")
            case _:
                continue
        looked += 1
    return looked


def assert_each_tick_is_where_it_belongs(trial: Trial) -> int:
    """Only rows of ticks at which the host stopped are missing; the quick station has no null
    otherwise.
    """
    run, seen = trial.run, 0
    for name, context in run.contexts.items():
        facts = context.facts
        rows = {
            row[COLUMN["tick"]]: row[COLUMN["quality"]]
            for row in run.memory.samples
            if row[COLUMN["station"]] == name
        }
        assert facts.first_tick is not None
        assert facts.last_tick is not None
        assert facts.period_s is not None
        missing = [
            tick for tick in range(facts.first_tick, facts.last_tick + 1) if tick not in rows
        ]
        assert len(missing) == facts.skipped
        for tick in missing:
            due = run.t0 + tick * facts.period_s
            assert any(begin <= due <= end for begin, end in trial.stopped), (
                f"{name}: tick {tick} has no row"
            )
        for tick, quality in rows.items() if not trial.phases[name] else ():
            due = run.t0 + tick * facts.period_s
            assert quality == "ok" or any(
                begin - 1 <= due <= end + 2 for begin, end in trial.stopped
            ), (name, tick, quality)
        seen += len(rows) + len(missing)
    return seen


def look_at(seed: int) -> tuple[int, int]:
    print(f"seed {seed}")
    trial = Trial.of(seed)
    return assert_all_agree(trial), assert_each_tick_is_where_it_belongs(trial)


@pytest.mark.parametrize("number", range(SLICE))
def test_random_histories_of_response_times(number: int) -> None:
    look_at(SEED + number)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_four_hundred_random_histories(counted: Callable[..., None]) -> None:
    found = [look_at(SEED + SLICE + number) for number in range(CAMPAIGN)]
    events, ticks = (sum(column) for column in zip(*found, strict=True))
    counted(
        runs=CAMPAIGN,
        events_of_host_and_link=events,
        ticks=ticks,
        false_events=0,
        ticks_without_account=0,
    )


# -- single cases ----------------------------------------------------------------------------------


def test_a_station_that_was_slow_once_and_falls_silent_is_away_and_no_host_stood_still() -> None:
    """The slow answer lengthened its time-out, so three tries last six seconds."""
    phases: list[Phase] = [
        (20.0, 21.0, 0.09),
        (21.0, 22.0, 0.3),
        (22.0, 24.0, 1.0),
        (24.0, 26.0, 1.6),
        (35.0, 65.0, None),
    ]

    def slow(
        order: StationTask, session: Steps[StationFacts], cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        return session, Slow(cable, phases if order.name == "dde-1" else [], order.t0)

    run = prepare(line("", ""), duration_s=80, pulled=slow, rate=4.0).go()
    assert [event for event in run.memory.events if event.kind.startswith("host.")] == []
    assert {context.facts.skipped for context in run.contexts.values()} == {0}
    away = [
        row[COLUMN["quality"]]
        for row in run.memory.samples
        if row[COLUMN["station"]] == "dde-1" and 170 <= row[COLUMN["tick"]] < 255
    ]
    assert set(away) == {"disconnected"}
    assert len(away) == 2 * 85


def test_a_station_that_answers_ever_later_makes_no_computer_busy() -> None:
    run = prepare(
        line_text(),
        duration_s=60,
        rate=8.0,
        pulled=lambda order, session, cable: (session, Slow(cable, [(20, 50, 0.09)], order.t0)),
    )
    run.go()
    assert run.facts.outcome == "completed"
    assert sum(row[COLUMN["quality"]] == "skipped" for row in run.memory.samples) > 50
    assert run.facts.skipped_by_host == 0
    assert [event for event in run.memory.events if event.kind.startswith("host.")] == []
    assert_account_holds(run)


def test_an_omega_that_knows_a_alone_loses_answers_and_the_computer_is_not_busy() -> None:
    """Nothing can be asked in between, so a lost answer costs two seconds: those ticks belong to
    the link.
    """
    text = (
        '[line]\nname = "test"\n[[station]]\nname = "omega-1"\nurl = "omega-1"\nfamily = "omega"\n'
    )
    recipe = '[recipe]\nname = "test"\nrevision = 1\nfamilies = ["omega"]\n'
    phases: list[Phase] = [(second, second + 0.5, None) for second in (20.0, 30.0, 40.0)]
    run = prepare(
        text,
        recipe,
        60,
        1.0,
        pulled=lambda order, session, _cable: (session, Slow(PageOmega("a"), phases, order.t0)),
    )
    run.go()
    assert run.facts.outcome == "completed", run.facts.reason
    assert sum(row[COLUMN["quality"]] == "skipped" for row in run.memory.samples) >= 3
    assert (run.facts.skipped_by_host, run.facts.skipped) == (0, 0)
    assert [
        event.kind for event in run.memory.events if event.kind.startswith(("host.", "link."))
    ] == []
    assert_account_holds(run)


# -- real terminals --------------------------------------------------------------------------------


REAL = """
[line]
name = "witness"

[[station]]
name = "dde-1"
url = "dde-1"
family = "dde"
[station.sim]
[[station.sim.fault]]
kind = "late"
at_s = 10.0
for_s = 0.3
by_s = 0.5
[[station.sim.fault]]
kind = "silence"
at_s = 11.0
for_s = 9.0

[[station]]
name = "dde-2"
url = "dde-2"
family = "dde"
[station.sim]
"""
READ_ONLY = '[recipe]\nname = "read"\nrevision = 1\nfamilies = ["dde"]\n[sampling]\nrate_hz = 4\n'


def test_on_real_terminals_a_neighbour_bears_out_that_only_one_station_was_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # tools left hot by other tests would be reported
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "line").mkdir()
    with ServedLine(tmp_path / "line", REAL, READ_ONLY) as served:
        ended = jbclog(
            "run", served.recipe, "--line", served.path, "--out", tmp_path / "runs", "-d", "18s"
        )
    folder = Path(ended.stdout.splitlines()[-1])
    events = pd.read_parquet(folder / "events")
    assert list(events["kind"][events["kind"].str.match(r"(host|guard|clock)\.(?!busy)")]) == []
    samples = pd.read_parquet(folder / "samples")
    quality = samples.groupby("station")["quality"].value_counts()
    assert quality["dde-1"]["disconnected"] >= 2 * 4 * 5  # ports, ticks a second, seconds
    assert quality["dde-2"].get("disconnected", 0) == 0
    facts = {one.name: one for one in read_manifest(folder).stations}
    assert {name: one.skipped for name, one in facts.items()} == {"dde-1": 0, "dde-2": 0}
    assert check_run(folder) == []
