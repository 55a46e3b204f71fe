"""A recorder dies while its stations hear and cannot be heard: what the guard orders without an
answer, and that no tool gets warmer by it.

Real recorders and guards, on stations and physics that somebody else wrote from the manuals
(`outside_bench`). Each failure names station and port; times are seconds after the death.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from support.campaigns.unanswered import (
    EXTRACTOR,
    OLD,
    STAND,
    Bench,
    Outcome,
    Tool,
    family_of,
    watched,
)
from support.command import jbclog, started, until
from support.faults.guarded import guard_that_is_there, only_run
from support.oracles.outside_bench import HotAir, Served
from support.product import GUARD_PROCESS, MAIN, open_run

pytestmark = [pytest.mark.usefixtures("own_state"), pytest.mark.timeout(300)]

WITHIN_S = 5.0
PROVEN_S = 30.0  # after the last answer identity counts as proven
MOST = 3  # orders to a tool
SLACK_S = 0.5
SUCKING = "00110"
STOP, FEEDING = "STP00000", "still feeding"
UNSURE = re.compile("not confirm|not known|may be hot")

TWO, FOUR = ("ucr", "nae"), ("ucr", "ale", "nae", "dme")
EIGHT = (*FOUR, "dde", "hde", OLD, "omega")


# -- what is done to tools and stations ------------------------------------------------------------


def at_rest(bench: Bench) -> None:
    """The first port of each station stands, sleeps, hibernates or lies in the extractor; somebody
    put it there, and the second goes on working.
    """
    ways = [(1, 0), (2, 0), (3, 0), (0, 1)]
    for number, tool in enumerate(tool for tool in bench.tools() if tool.port == 1):
        rest(tool, *ways[number % len(ways)])


def rest(tool: Tool, units: int, extractor: int) -> None:
    tool.heater.order(time.monotonic(), units, extractor, 0)  # type: ignore[union-attr]
    tool.heater.temperature = 350.0 if (units, extractor) == (1, 0) else 150.0


def all_at_rest(bench: Bench) -> None:
    for number, tool in enumerate(bench.tools()):
        rest(tool, *[(1, 0), (2, 0), (3, 0), (0, 1)][number % 4])


def extractor_heats(bench: Bench, *, asleep: bool = False) -> None:
    """The extractor state of the soldering stations does not cool; second tools sleep."""
    for tool in bench.tools():
        if isinstance(tool.heater, HotAir):
            continue
        tool.heater._extractor_cools = False
        if asleep and tool.port == 2:
            rest(tool, 2, 0)


def swapped(bench: Bench) -> None:
    bench.swap(bench.names[0], bench.names[1])


def unplugged(bench: Bench) -> None:
    bench.change_device("ucr")


def unplugged_for_its_like(bench: Bench) -> None:
    """The other has the same model and software, and other hours."""
    bench.change_device("ucr", software="01.07")


def renumbered(bench: Bench) -> None:
    bench.change_device("ucr", same_number=True)


def refused(bench: Bench) -> None:
    """The server of each station accepts nobody for two seconds."""
    assert bench.served is not None
    for name in bench.links:
        bench.served.refuse(name, 2.0)


def air_off(bench: Bench) -> None:
    bench.stations["jtse"].station.write("PS1", "00000", time.monotonic())


@dataclass(frozen=True)
class Row:
    """One death. `order` is what working tools get: the family's own, that of a mixed line, or
    none. `between` happens after the death and before the guard acts, which is stopped meanwhile.
    """

    stations: tuple[str, ...]
    harm: str = "dead"
    harmed: tuple[str, ...] = ()  # all, if none is named
    lead_s: float = 0.0
    blow: signal.Signals = signal.SIGKILL
    is_tcp: bool = False
    order: str = "own"
    prepare: Callable[[Bench], None] = lambda _bench: None
    between: Callable[[Bench], None] | None = None
    after_s: float = 0.0  # so long after the death, and the guard is not stopped
    latest_s: float = 10.0  # no order comes later after the death
    suction: bool = False  # of hot air
    asleep_s: float = 0.0  # as the guard's boot-time clock sees it, between death and order
    recorded: tuple[str, ...] = ()  # all, if none is named
    safe_state: str = ""
    beside: tuple[str, ...] = ()  # stations of another run, of another line
    known: tuple[str, ...] = ()  # an order may stay away, or come, because cables are swapped
    gone: tuple[str, ...] = ()  # stations that nobody reaches any more
    at_once: bool = False  # no status was read since the tool was put to work

    def wanted(self, tool: Tool) -> str:
        """The status that a tool that works gets; nothing is no order."""
        family = family_of(tool.station)
        if self.order == "none" or tool.station in self.gone:
            return ""
        if self.recorded and tool.station not in self.recorded:
            return ""
        if family == "jtse":
            return EXTRACTOR
        if self.order == "mixed":
            return "" if family == OLD else EXTRACTOR
        return STAND


ROWS = {
    "every family": Row(EIGHT),
    "every family over TCP": Row(EIGHT, is_tcp=True),
    "no answer for 20 s": Row(EIGHT, lead_s=20.0),
    "no answer for 20 s over TCP": Row(TWO, lead_s=20.0, is_tcp=True),
    "no answer for 60 s": Row(EIGHT, lead_s=60.0, order="none"),
    "no answer for 60 s over TCP": Row(TWO, lead_s=60.0, is_tcp=True, order="none"),
    "no answer for 26 s": Row(TWO, lead_s=26.0),
    "nine of ten bytes lost": Row(EIGHT, harm="thin"),
    "nine of ten bytes lost over TCP": Row(TWO, harm="thin", is_tcp=True),
    "garbled": Row(EIGHT, harm="garbled"),
    "garbled over TCP": Row(TWO, harm="garbled", is_tcp=True),
    "garbled for 20 s": Row(TWO, harm="garbled", lead_s=20.0),
    "one port of two": Row(TWO, harmed=("ucr",)),
    "the other port of two over TCP": Row(TWO, harmed=("nae",), is_tcp=True),
    "all answer": Row(EIGHT, harm=""),
    "stopped": Row(EIGHT, blow=signal.SIGSTOP),
    "stopped, garbled over TCP": Row(TWO, blow=signal.SIGSTOP, harm="garbled", is_tcp=True),
    "status never read": Row(FOUR, at_once=True),
    "guard replaced before": Row(TWO, prepare=lambda bench: end(bench.guard)),
    "hot air": Row(("jtse",)),
    "hot air with suction": Row(("jtse",), suction=True),
    "hot air over TCP": Row(("jtse",), is_tcp=True),
    "hot air, stopped, thin": Row(("jtse",), harm="thin", blow=signal.SIGSTOP),
    # who rests
    "some rest": Row(FOUR, prepare=at_rest),
    "some rest, garbled": Row(FOUR, prepare=at_rest, harm="garbled"),
    "all rest": Row(FOUR, prepare=all_at_rest),
    "some rest, and all answer": Row(FOUR, prepare=at_rest, harm=""),
    "all rest, stopped": Row(FOUR, prepare=all_at_rest, blow=signal.SIGSTOP),
    "hot air is off": Row(("jtse",), prepare=air_off),
    # an extractor state that heats
    "the extractor heats": Row(FOUR, prepare=extractor_heats),
    "the extractor heats, and is the recipe's": Row(
        FOUR, prepare=extractor_heats, safe_state="extractor"
    ),
    "the extractor heats on a mixed line": Row(
        (*FOUR, "jtse"), prepare=extractor_heats, order="mixed"
    ),
    "the extractor heats and others sleep, on a mixed line": Row(
        ("nae", "dme", "jtse"),
        prepare=lambda bench: extractor_heats(bench, asleep=True),
        order="mixed",
    ),
    # mixed lines
    "mixed": Row((*FOUR, OLD, "jtse"), order="mixed"),
    "mixed, with suction": Row(("ucr", "jtse"), order="mixed", suction=True),
    "mixed over TCP": Row((*FOUR, OLD, "jtse"), order="mixed", is_tcp=True),
    "mixed, only soldering recorded": Row(("ucr", "jtse"), order="mixed", recorded=("ucr",)),
    "cables swapped": Row(("ucr", "jtse"), order="mixed", between=swapped),
    "cables swapped, hot air is off": Row(
        ("ucr", "jtse"), order="mixed", between=swapped, prepare=air_off, known=("ucr", "jtse")
    ),
    "cables swapped, one direction dead": Row(
        ("nae", "jtse"), order="mixed", between=swapped, harmed=("nae",), known=("nae",)
    ),
    "cables swapped, the other direction dead": Row(
        ("nae", "jtse"), order="mixed", between=swapped, harmed=("jtse",), known=("nae", "jtse")
    ),
    "cables swapped, only soldering recorded": Row(
        ("ucr", "jtse"),
        order="mixed",
        between=swapped,
        recorded=("ucr",),
        prepare=air_off,
        known=("ucr", "jtse"),
    ),
    "cables of two soldering stations swapped": Row(("dde", "nae"), between=swapped),
    "another run has hot air": Row(TWO, order="mixed", beside=("jtse",)),
    "another run has soldering stations": Row(TWO, beside=("dme",)),
    # devices
    "another device by the same name": Row(TWO, between=unplugged, gone=("ucr",)),
    "another device with the same number": Row(TWO, between=renumbered, gone=("ucr",)),
    "another device that answers": Row(TWO, harm="", between=unplugged, gone=("ucr",)),
    "another device of the same model": Row(TWO, between=unplugged_for_its_like, gone=("ucr",)),
    "another device of the same model that answers": Row(
        TWO, harm="", between=unplugged_for_its_like, gone=("ucr",)
    ),
    "another device after the first order": Row(
        TWO, between=renumbered, after_s=1.0, known=("ucr",)
    ),
    "a server that refuses for 2 s": Row(TWO, is_tcp=True, between=refused),
    # sleep
    "suspended for 5 s": Row(TWO, between=lambda _bench: None, asleep_s=5.0),
    "suspended after the first order": Row(
        TWO, between=lambda _bench: None, asleep_s=40.0, after_s=1.0, latest_s=1.0
    ),
    "suspended for 40 s": Row(TWO, between=lambda _bench: None, asleep_s=40.0, order="none"),
}
SLICE = ("every family", "suspended for 40 s", "some rest", "cables swapped, hot air is off")
"""Run by default."""


# -- one death -------------------------------------------------------------------------------------

SITE = """
import time

def beside(real, unit):
    def read(clock):
        now = real(clock)
        try:
            ahead = float(open({path!r}).read() or 0)
        except OSError:
            ahead = 0.0
        return now + type(now)(ahead * unit) if clock == time.CLOCK_BOOTTIME else now
    return read

time.clock_gettime = beside(time.clock_gettime, 1)
time.clock_gettime_ns = beside(time.clock_gettime_ns, 10**9)
"""
"""Of the guard, whose boot-time clock a file sets ahead, as a suspended machine's would be."""


@contextmanager
def recorder(bench: Bench, row: Row, folder: Path) -> Iterator[subprocess.Popen[str]]:
    (folder / "ports").mkdir(parents=True)
    with Served(bench.peers, folder / "ports", tcp=row.is_tcp) as served:  # type: ignore[arg-type]  # what receives
        bench.served, bench.folder = served, folder / "ports"
        line = bench.line_file(served, folder, safe_state=row.safe_state, suction=row.suction)
        only = [word for name in row.recorded for word in ("-s", name)]
        run = started("run", "--line", line, "--out", folder / "runs", *only)
        try:
            yield run
        finally:
            end_guards(folder)
            run.kill()
            run.communicate(timeout=60)


@contextmanager
def beside(row: Row, folder: Path) -> Iterator[None]:
    """Another run of this user, whose stations answer."""
    if not row.beside:
        yield
        return
    other, whole = Bench(row.beside, seed=1), Row(row.beside)
    with recorder(other, whole, folder) as run:
        settled(other, whole, run)
        yield


def guards_of(out: Path) -> list[int]:
    """Guards whose command names a run below `out`."""
    guards = []
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            command = (process / "cmdline").read_bytes()
        except OSError:
            continue
        if GUARD_PROCESS in command and bytes(out) in command:
            guards.append(int(process.name))
    return guards


def end_guards(folder: Path) -> None:
    for guard in guards_of(folder / "runs"):
        end(guard)


def end(process: int) -> None:
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        return
    until(lambda: not Path(f"/proc/{process}/cmdline").exists(), 10.0)


def settled(bench: Bench, row: Row, run: subprocess.Popen[str]) -> None:
    """Wait until each recorded tool works, hot, and its status was read a few times since."""
    mine = [tool for tool in bench.tools() if not row.recorded or tool.station in row.recorded]
    assert until(
        lambda: run.poll() is not None or all(tool.is_working for tool in mine), 90.0, 0.01
    )
    assert run.poll() is None, "".join(run.communicate(timeout=5))
    if row.at_once:
        return
    worked = time.monotonic()
    assert until(lambda: statuses_read(bench, row, worked) >= 4, 60.0)


def statuses_read(bench: Bench, row: Row, since: float) -> int:
    return bench.statuses_read(since, row.recorded or tuple(bench.stations))


@dataclass(frozen=True)
class Report:
    """What the record says after `recover`: its exit code and words, and the guard's events as
    (station, port, text).
    """

    code: int
    words: str
    events: list[tuple[str, int, str]]

    @classmethod
    def of(cls, folder: Path) -> Report:
        run = only_run(folder / "runs")
        done = jbclog("recover", run)
        events = open_run(run).events()
        events = events[events["kind"].str.startswith(("safety.", "guard.", "identity."))]
        ports = events["port"].fillna(0).astype(int)
        rows = list(zip(events["station"].fillna(""), ports, events["text"], strict=True))
        return cls(done.returncode, done.stdout + done.stderr, rows)

    def faults(self, row: Row, wanted: dict[str, str], outcome: Outcome) -> Iterator[str]:
        """What it does not say, although stations could not be heard."""
        if not wanted or not (row.harm or row.between):
            return
        if self.code != 5:
            yield f"recover ends with {self.code}, not 5"
        if not UNSURE.search(" ".join([self.words, *(text for _, _, text in self.events)])):
            yield "nobody says that tools may be hot"
        silent = set(row.harmed or row.stations) - set(row.known) if row.harm else set()
        for key, orders in outcome.orders.items():
            station, _, port = key.partition(":")
            texts = [text for *at, text in self.events if at == [station, int(port)]]
            count = f"ordered {len(orders)} time{'s' * (len(orders) > 1)}, not confirmed"
            if station in silent and orders and not any(count in text for text in texts):
                yield f"{key}: no event with {count!r}, but {texts}"


def meanwhile(row: Row, bench: Bench, ahead: Path) -> None:
    assert row.between is not None
    row.between(bench)
    if row.asleep_s:
        ahead.write_text(str(row.asleep_s))


def died(row: Row, folder: Path, for_s: float) -> tuple[dict[str, str], Outcome, Report]:
    """A death, and its record, which is recovered while nobody else can get the terminals."""
    bench, ahead = Bench(row.stations), folder / "ahead"
    with beside(row, folder / "beside"), recorder(bench, row, folder) as run:
        settled(bench, row, run)
        bench.guard = guard_that_is_there(run.pid)
        if "ale" in bench.stations:
            bench.stations["ale"].station.write("STR", "00000", time.monotonic())  # as a robot does
        row.prepare(bench)
        if not row.at_once:
            prepared = time.monotonic()
            assert until(lambda: statuses_read(bench, row, prepared) >= 3, 30.0), run.poll()
            time.sleep(0.6)  # two beats
        guard = guard_that_is_there(run.pid)
        if row.lead_s:
            bench.harm(row.harm, row.harmed)
            time.sleep(row.lead_s)
        is_stopped = row.between is not None and not row.after_s
        if is_stopped:
            os.kill(guard, signal.SIGSTOP)
        working = {tool.key: tool for tool in bench.tools() if tool.is_working}
        twins = {tool.key: tool.copied() for tool in bench.tools()}
        bench.harm(row.harm, row.harmed)
        at = time.monotonic()
        run.send_signal(row.blow)
        if is_stopped:
            meanwhile(row, bench, ahead)
            os.kill(guard, signal.SIGCONT)
        elif row.between is not None:
            threading.Timer(row.after_s, meanwhile, (row, bench, ahead)).start()
        wanted = {key: row.wanted(tool) for key, tool in working.items()}
        outcome = watched(bench, wanted, twins, at, for_s)
        feeding = [
            name
            for name, cable in bench.stations.items()
            if getattr(cable.station, "feeding", False)
        ]
        outcome.others += [(name, FEEDING) for name in feeding]
        for link in bench.strangers:
            print(f"another device heard {link.heard} bytes")
            outcome.others += [("another device", write.code) for write in link.cable.written]
        end_guards(folder)
        report = Report.of(folder)
    return wanted, outcome, report


def tried(name: str, row: Row, folder: Path, for_s: float) -> dict[str, int]:
    """One death and its judgement; the figures of the campaign."""
    wanted, outcome, report = died(row, folder, for_s)
    slowest = max(outcome.seconds.values(), default=0.0)
    print(f"{name}: ordered {outcome.orders}, other writes {outcome.others}")
    print(f"  {len(outcome.seconds)} of {len(wanted)} ordered, the last after {slowest:.2f} s")
    print(f"  hotter {outcome.hotter}, recover {report.code}\n{report.words}")
    print(*report.events, sep="\n")
    faults = [*faults_of(row, wanted, outcome), *report.faults(row, wanted, outcome)]
    assert not faults, "\n".join([name, *faults])
    figures = {"tools": len(wanted), "ordered_within_5_s": len(outcome.seconds)}
    return {"deaths": 1, **figures, "hotter": len(outcome.hotter)}


def faults_of(row: Row, wanted: dict[str, str], outcome: Outcome) -> list[str]:
    faults = []
    for key, status in wanted.items():
        after = outcome.seconds.get(key)
        is_due = bool(status) and key.partition(":")[0] not in row.known
        if is_due and (after is None or after > WITHIN_S):
            faults.append(f"{key}: not at {status} within {WITHIN_S:g} s (after {after} s)")
    faults += [f"{key}: hotter than before the order" for key in outcome.hotter]
    for key, orders in outcome.orders.items():
        allowed = {wanted.get(key, "")}
        if key.partition(":")[0] in row.known:
            allowed.add(EXTRACTOR if row.order == "mixed" else STAND)
        if STAND in allowed and row.safe_state:
            allowed.add(EXTRACTOR)
        if row.suction and row.order == "own":
            allowed.add(SUCKING)
        wrong = [order for order in orders if order[1] not in allowed]
        if wrong:
            faults.append(f"{key}: ordered {wrong}, where only {sorted(allowed)} may come")
        if len(orders) > MOST * (2 if row.safe_state else 1):
            faults.append(f"{key}: {len(orders)} orders, at most {MOST} are allowed")
        latest_s = min(row.latest_s, PROVEN_S - row.lead_s) + SLACK_S
        if orders and orders[-1][0] > latest_s:
            faults.append(f"{key}: the last order came after {orders[-1][0]} s")
    faults += [
        f"{station}: {what}"
        for station, what in outcome.others
        if what != STOP and not (what == FEEDING and wanted.get(f"{station}:1") != STAND)
    ]
    return faults


def slug(name: str) -> str:
    return re.sub(r"\W+", "-", name)


@pytest.fixture
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A guard whose boot-time clock can be set ahead."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(SITE.format(path=str(tmp_path / "death" / "ahead")))
    monkeypatch.setenv("PYTHONPATH", str(site))


@pytest.mark.usefixtures("clock")
@pytest.mark.parametrize("name", SLICE, ids=slug)
def test_a_recorder_dies_unheard(name: str, tmp_path: Path, counted: Callable[..., None]) -> None:
    counted(**tried(name, ROWS[name], tmp_path / "death", 7.0))


@pytest.mark.campaign
@pytest.mark.usefixtures("clock")
@pytest.mark.parametrize("name", ROWS, ids=slug)
def test_each_death_of_a_recorder_that_is_unheard(
    name: str, tmp_path: Path, counted: Callable[..., None]
) -> None:
    counted(**tried(name, ROWS[name], tmp_path / "death", 13.0))


# -- a person who does the right thing -------------------------------------------------------------


@pytest.mark.campaign
@pytest.mark.parametrize("after_s", [0.1, 0.5, 3.0, 8.0])
def test_safe_answers_where_our_own_guard_holds_the_port(tmp_path: Path, after_s: float) -> None:
    """At most 2 s later than on a free port, with the same answer, and never "python3"."""
    row, bench = Row(TWO), Bench(TWO)
    folder = tmp_path / "death"
    with recorder(bench, row, folder) as run:
        settled(bench, row, run)
        time.sleep(0.6)
        bench.harm("dead")
        at = time.monotonic()
        run.kill()
        time.sleep(after_s)
        beside_s, beside_guard = timed_safe(folder)
        orders = [write for name in TWO for write in bench.orders(name, at)]
        end_guards(folder)
        free_s, free = timed_safe(folder)
    print(f"beside the guard {beside_s:.1f} s, free {free_s:.1f} s")
    texts = beside_guard.stdout + beside_guard.stderr
    print(texts, free.stderr)
    assert (beside_guard.returncode, free.returncode) == (5, 5)
    assert not re.search("python|in use by process", texts)
    assert beside_s < free_s + 2.0 + SLACK_S
    assert {write.data for write in orders} == {STAND}
    assert len(orders) <= MOST * len(bench.tools())
    assert all(tool.status == STAND for tool in bench.tools())


def timed_safe(folder: Path) -> tuple[float, subprocess.CompletedProcess[str]]:
    began = time.monotonic()
    done = jbclog("safe", "--line", folder / "line.toml")
    return time.monotonic() - began, done


INSISTED = {
    "soldering": (TWO, "y\n", STAND),
    "hot air": (("jtse",), "y\n", EXTRACTOR),
    "a person who does not": (TWO, "n\n", ""),
    "nobody there": (TWO, "", ""),
    "mixed": (("ucr", "jtse"), "y\n", ""),
}


@pytest.mark.campaign
@pytest.mark.parametrize("name", INSISTED, ids=slug)
def test_a_person_who_insists_orders_once(name: str, tmp_path: Path) -> None:
    """No run and no proof: the question names each station and both risks."""
    stations, reply, order = INSISTED[name]
    bench = Bench(stations)
    (tmp_path / "ports").mkdir()
    for tool in bench.tools():
        if not isinstance(tool.heater, HotAir):
            tool.heater.order(time.monotonic(), 0, 0, 0)
    with Served(bench.peers, tmp_path / "ports") as served:  # type: ignore[arg-type]  # what receives
        line = bench.line_file(served, tmp_path)
        bench.harm("dead")
        words = ("safe", "--line", str(line), "--unanswered")
        done = subprocess.run(
            [sys.executable, "-c", MAIN, *words],
            input=reply,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    print(done.stdout, done.stderr)
    orders = {station: [write.data for write in bench.orders(station, 0.0)] for station in stations}
    ports = {
        station: [tool for tool in bench.tools() if tool.station == station] for station in stations
    }
    assert orders == {station: [order] * len(ports[station]) * bool(order) for station in stations}
    assert done.returncode == 5
    assert all(station in done.stdout + done.stderr for station in stations)
    if reply == "y\n" and order:
        assert re.search("another station", done.stderr)
        assert re.search("warm|heat", done.stderr)
    else:
        assert re.search("switch .* off", done.stderr)
