"""An adapter or a station that repeats an old answer to a question beside the true one, on stations
that somebody else wrote from the manuals (`outside_bench`).

An old answer has a sound check byte and the right code, and its value was true a second ago. A
reading is wrong where its row holds a value that its station did not say to this row's question.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from support.campaigns.each_row import each_row
from support.command import jbclog
from support.oracles import outside_bench as bench
from support.oracles.account import assert_account_holds, reasons_in
from support.oracles.outside_bench import OWN_HABITS, Cable, Habits, Served, station
from support.oracles.outside_runs import AIR, TIP, Outcome, virtual, wrong_values
from support.product import COLUMN, VirtualClock, open_run
from support.virtual.virtual_run import Memory, VirtualRun

READINGS = 4400  # of each row of the campaign
RATES = (0.0, 0.01, 0.05, 0.20)
FAMILIES = bench.FAMILIES
PORTS = 13  # of all families
SIGNALS = ("temperature_c", "power_permille", "status")
RATE = 'rate_hz = "auto"'
# a second between two readings of a signal: an old value is never taken for that of this row
ONCE_A_SECOND = "rate_hz = 1"
RESTLESS_C = 9.0
JUST_BEFORE_S = 0.06
FRAME_S = 15 * 10 / 19200

Pieces = list[tuple[float, bytes]]


@dataclass
class Repeating(Cable):
    """A cable with an adapter that repeats the last answer of the same code, once a tool works."""

    way: str = "before"
    share: float = 0.0
    from_start: bool = False
    repeated: int = 0
    differing: int = 0
    _last: dict[str, bytes] = field(default_factory=dict)
    _free: float = 0.0

    def receive(self, data: bytes, now: float) -> Pieces:
        pieces: Pieces = []
        for at, answer in super().receive(data, now):
            pieces += self._sent(at, answer)
        return pieces

    @property
    def _is_active(self) -> bool:
        working = "00001" if self.station.family == "jtse" else "00000"
        return self.from_start or any(
            write.code.startswith("PS") and write.data == working for write in self.written
        )

    def _sent(self, at: float, answer: bytes) -> Pieces:
        """What the adapter makes of an answer, after what it sent before."""
        start = 5 if self.station.habits.address is not None else 1
        code = answer[start : start + 4].decode("latin-1")
        old = self._last.get(code)
        self._last[code] = answer
        at = max(at, self._free)
        is_value = len(answer) == start + 11 and code.startswith("A")
        if old is None or not is_value or not self._is_active:
            return self._queued([(at, answer)])
        if self.rng.random() >= self.share:
            return self._queued([(at, answer)])
        self.repeated += 1
        self.differing += old != answer
        return self._queued(WAYS[self.way](at, old, answer, self.rng))

    def _queued(self, pieces: Pieces) -> Pieces:
        if self.way not in OVERTAKEN:
            self._free = max(at for at, _ in pieces)
        return pieces


def split(at: float, old: bytes, answer: bytes, rng: random.Random) -> Pieces:
    """Both frames, cut somewhere into two or three reads."""
    both = old + answer
    cuts = sorted({0, *(rng.randrange(1, len(both)) for _ in range(2)), len(both)})
    return [
        (at + FRAME_S * number, both[begin:end])
        for number, (begin, end) in enumerate(pairwise(cuts))
    ]


WAYS: dict[str, Callable[[float, bytes, bytes, random.Random], Pieces]] = {
    "before, in one read": lambda at, old, true, _: [(at, old + true)],
    "before": lambda at, old, true, _: [(at, old), (at + FRAME_S, true)],
    "before, 50 ms earlier": lambda at, old, true, _: [(at, old), (at + 0.05, true)],
    "before, 200 ms earlier": lambda at, old, true, _: [(at, old), (at + 0.2, true)],
    "after, in one read": lambda at, old, true, _: [(at, true + old)],
    "after": lambda at, old, true, _: [(at, true), (at + FRAME_S, old)],
    "after, 50 ms later": lambda at, old, true, _: [(at, true), (at + 0.05, old)],
    "split over reads": split,
    "twice before": lambda at, old, true, _: [(at, old), (at + FRAME_S, old + true)],
    # no old answer: the true one is late, the question is repeated, and both are answered
    "late and asked again": lambda at, _, true, rng: [(at + rng.uniform(0.2, 0.8), true)],
    # the old one is believed, the true one comes when its row has gone
    "true one later than its row": lambda at, old, true, rng: [
        (at, old),
        (at + rng.uniform(0.4, 0.6), true),
    ],
}
OVERTAKEN = ("true one later than its row",)
"""Here later answers do not wait for the late one."""
TRUE_ONLY = ("late and asked again",)


def repeating(way: str, share: float, *, from_start: bool = False) -> dict[str, Cable]:
    cables: dict[str, Cable] = {}
    for number, family in enumerate(FAMILIES):
        rng = random.Random(number)
        habits = Habits(**{**vars(OWN_HABITS[family]), "restless_c": RESTLESS_C})
        cables[family] = Repeating(
            station(family, rng, habits), rng, way=way, share=share, from_start=from_start
        )
    return cables


def readings(outcome: Outcome) -> Counter[str]:
    """The readings due of the three signals: obtained (``ok``), or the reason."""
    counts: Counter[str] = Counter()
    for row in outcome.memory.samples:
        reasons = reasons_in(row)
        for signal in SIGNALS:
            value = row[COLUMN[signal]]
            counts[reasons.get(signal, "?") if value is None else "ok"] += 1
    return counts


def recorded(
    way: str, share: float, count: int, *, rate: str = ONCE_A_SECOND, from_start: bool = False
) -> Outcome:
    """A run of all families with `count` readings of the three signals, at least."""
    duration = count / (PORTS * len(SIGNALS)) + 3
    cables = repeating(way, share, from_start=from_start)
    tip, air = (text.replace(RATE, rate) for text in (TIP, AIR))
    return virtual(cables, duration_s=duration, recipe=tip, air=air)


def wrong_temperatures(outcome: Outcome) -> list[str]:
    """Temperatures that their station did not say just before the time of their row, which is that
    of the answer. A jump is asked about again, and has two answers.
    """
    shift = VirtualClock().utc() - VirtualClock().monotonic()
    wrong = []
    for row in outcome.memory.samples:
        value, name = row[COLUMN["temperature_c"]], str(row[COLUMN["station"]])
        if value is None:
            continue
        code = "AT1" if name == "jtse" else f"TT{row[COLUMN['port']]}"
        at = int(str(row[COLUMN["time"]])) / 1e6 - shift
        values = [
            int(raw)
            for moment, raw in outcome.cables[name].said[code]
            if at - JUST_BEFORE_S < moment <= at
        ]
        if value not in values:
            wrong.append(f"{name}: {code} at {at:.3f}: {value} is recorded, and {values} was said")
    return wrong


def tally(outcome: Outcome) -> dict[str, int]:
    counts = readings(outcome)
    cables = [cable for cable in outcome.cables.values() if isinstance(cable, Repeating)]
    return {
        "readings": sum(counts.values()),
        "repeated": sum(cable.repeated for cable in cables),
        "with another value": sum(cable.differing for cable in cables),
        "wrong": len(list(wrong_values(outcome))),
        "contradicted": counts["contradicted"],
        "lost otherwise": sum(counts.values()) - counts["ok"] - counts["contradicted"],
    }


def assert_each_account_holds(outcome: Outcome) -> None:
    """Due readings are values or reasons, at each station."""
    for name, context in outcome.contexts.items():
        memory = Memory(
            samples=[row for row in outcome.memory.samples if row[COLUMN["station"]] == name],
            counters=[row for row in outcome.memory.counters if row.station == name],
        )
        run = SimpleNamespace(facts=context.facts, memory=memory, contexts={name: context})
        assert_account_holds(cast("VirtualRun", run))


def assert_contradictions_are_reported(outcome: Outcome) -> None:
    """An event at the first of a station, and their number at its end."""
    for name in outcome.cables:
        rows = [reasons_in(row) for row in outcome.memory.samples if row[COLUMN["station"]] == name]
        counters = [row.raw for row in outcome.memory.counters if row.station == name]
        count = sum(list(reasons.values()).count("contradicted") for reasons in rows)
        count += counters.count("<contradicted>")
        events = [
            event
            for event in outcome.memory.events
            if event.kind == "read.contradicted" and event.station == name
        ]
        assert len(events) == (2 if count else 0), name
        assert not count or events[-1].value == count, name


def judged(way: str, share: float, count: int, *, from_start: bool = False) -> dict[str, int]:
    outcome = recorded(way, share, count, from_start=from_start)
    figures = tally(outcome)
    assert_each_account_holds(outcome)
    assert_contradictions_are_reported(outcome)
    print(f"{way}, {share:.0%}: {figures}")
    assert outcome.not_started == {}
    assert figures["readings"] >= count
    if share:
        assert figures["repeated"] > 0
    if way in OVERTAKEN:
        assert figures["wrong"] <= figures["with another value"]
        return figures
    assert figures["wrong"] == 0, list(wrong_values(outcome))[:5]
    if way in TRUE_ONLY or share == 0:
        assert figures["contradicted"] == 0
    if share == 0:
        assert figures["lost otherwise"] == 0
    return figures


def rows() -> Iterator[tuple[str, tuple[object, ...]]]:
    for way in WAYS:
        for share in RATES:
            yield f"{way}, {share:.0%}", (way, share)


@each_row((name, row) for name, row in rows() if row[1] == RATES[2])
def test_no_repeated_answer_is_recorded(way: str, share: float) -> None:
    judged(way, share, 600)


@each_row((f"{share:.0%}", (share,)) for share in RATES)
def test_no_setting_is_wrong_where_answers_are_repeated_from_the_start(share: float) -> None:
    """A decisive value is read twice: a start comes through, and holds what its station holds."""
    outcome = recorded("before", share, 200, from_start=True)
    assert outcome.not_started == {}
    settings = {row.setting for row in outcome.memory.settings}
    assert [
        text for text in wrong_values(outcome) if text.split(": ")[1].split(" of ")[0] in settings
    ] == []


@each_row((way, (way,)) for way in ("before", "before, in one read", "after", "split over reads"))
def test_no_repeated_temperature_is_recorded_at_ten_a_second(way: str) -> None:
    """As fast as the link allows, where an old answer is a tenth of a second old."""
    outcome = recorded(way, RATES[2], 200, rate=RATE)
    assert wrong_temperatures(recorded(way, 0.0, 200, rate=RATE)) == []
    assert wrong_temperatures(outcome) == []
    assert_each_account_holds(outcome)


def test_no_repeated_temperature_is_recorded_on_real_ports(tmp_path: Path) -> None:
    """Through pseudo-terminals and the shipped command, one answer in five, in one read or two."""
    for name, text in {"tip": TIP, "air": AIR}.items():
        (tmp_path / f"{name}.toml").write_text(text.replace(RATE, "rate_hz = 2"))
    cables = {
        **{name: repeating("before", RATES[3])[name] for name in ("dme", "ucr")},
        **{name: repeating("before, in one read", RATES[3])[name] for name in ("nae", "jtse")},
    }
    with Served(cables, tmp_path) as served:
        keys = {name: f'recipe = "{"air" if name == "jtse" else "tip"}.toml"' for name in cables}
        line = tmp_path / "line.toml"
        line.write_text(bench.line_file(served.urls, {name: name for name in cables}, more=keys))
        run = jbclog("run", "--line", line, "--out", tmp_path / "runs", "--duration", "6s")
        shift = time.time() - time.monotonic()
    rows = open_run(run.stdout.split()[-1]).samples()
    wrong = []
    for row in rows[rows["temperature_c"].notna()].itertuples():
        code = "AT1" if row.station == "jtse" else f"TT{row.port}"
        at = row.time.timestamp() - shift
        values = [
            int(raw) for moment, raw in cables[row.station].said[code] if abs(at - moment) < 0.25
        ]
        if row.temperature_c not in values:
            wrong.append((row.station, code, row.temperature_c, values))
    assert sum(cable.differing for cable in cables.values()) > 0
    assert len(rows) > 60
    assert wrong == []


@pytest.mark.campaign
@pytest.mark.parametrize("share", RATES)
@pytest.mark.parametrize("way", WAYS)
def test_no_repeated_answer_is_recorded_in_4400_readings(
    way: str, share: float, counted: Callable[..., None]
) -> None:
    figures = judged(way, share, READINGS)
    kind = "not claimed, " if way in OVERTAKEN else ""
    counted(**{f"{kind}{name} at {share:.0%}": number for name, number in figures.items()})
