"""What a host does to a recorder: clocks, sleep, signals, terminals, locales, a second recorder.
Real processes and terminals.

Assertions use the stations' own logs of what they received. The long form (marker ``campaign``)
prints how often each case was tried.
"""

from __future__ import annotations

import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import pytest

from support import program
from support.campaigns.awaited import CLOCK_STEPPED, INTERNAL_ERROR
from support.command import is_sampling, jbclog, until
from support.faults.guarded import full_pipe
from support.invoked import invoked
from support.oracles.invariants import Ended, violations
from support.product import (
    LOOKS_AT_PORTS_OFTEN,
    MAIN,
    SETTLES_SLOWLY,
    SHOWING_FAILS,
    SIM_WORKING,
    Manifest,
    check_run,
    open_run,
    patch,
    read_manifest,
)
from support.records import few_rows
from support.records.small_run import make_run
from support.virtual.served_line import RECIPE, Order, ServedLine
from support.virtual.station_log import heard_in

PROGRAM = [sys.executable, "-c", MAIN]
ODD = program("faults.odd_host")
RATE_HZ = 2  # fits, however late answers are on this machine
SOON_S = 60.0  # other tests share the processors
ENDS_S = 30.0
HOUR = 3600.0
NIGHT = 7200.0
# 2026-10-25 00:59:59 UTC; in Madrid the clock goes from 3 back to 2 o'clock at 01:00 UTC
FALL_BACK = 1792889999.0
SEED = random.randrange(1 << 32)
# of the slices that run by default: the same signals at the same moments every time
SLICE_SEED = 28
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedLine]:
    """Four stations, the feeder of one of them running whenever its tool works; they live through
    all tests here.
    """
    slow = RECIPE.replace("rate_hz = 5", f"rate_hz = {RATE_HZ}")
    with ServedLine(tmp_path_factory.mktemp("line"), recipe=slow, logs=True) as served:
        yield served


@dataclass
class Run:
    """One run of one or more stations of the line, in its own process."""

    line: ServedLine
    out: Path
    stations: tuple[str, ...]
    process: subprocess.Popen[str]
    heard_from: int
    began: float = field(default_factory=time.monotonic)
    said: str = ""

    @property
    def folder(self) -> Path:
        (folder,) = (path for path in self.out.iterdir() if path.is_dir())
        return folder

    @property
    def manifest(self) -> Manifest:
        return read_manifest(self.folder)

    def samples(self) -> bool:
        return is_sampling(self.out)

    def has(self, kind: str, times: int = 1) -> bool:
        """Whether its record has committed that many such events."""
        return list(open_run(self.folder).events()["kind"]).count(kind) >= times

    def events(self, kind: str) -> pd.DataFrame:
        events = pd.read_parquet(self.folder / "events")
        return events[events["kind"] == kind]

    def end(self, number: signal.Signals | None = signal.SIGTERM) -> int:
        """End it and wait for it."""
        if number is not None:
            self.process.send_signal(number)
        if self.process.stderr is not None:
            self.said = self.process.communicate(timeout=ENDS_S)[1] or ""
        return self.process.wait(ENDS_S)

    def wrong(self) -> list[str]:
        """Return violations of its record (I1 to I9) and of its stations."""
        heard = heard_in(self.line.log or Path(), self.heard_from)
        wires = {name: heard.get(name, []) for name in self.stations}
        ended = Ended(self.process.returncode, self.said) if self.said else None
        return [*violations(self.folder, wires, ended=ended), *self.hot()]

    def orders(self) -> list[Order]:
        """Return its writes."""
        return [order for order in self.line.orders(self.began) if order.station in self.stations]

    def has_asked(self) -> bool:
        return (self.line.log or Path()).stat().st_size > self.heard_from

    def is_at_its_end(self) -> bool:
        """Whether all of its tools have been ordered to rest, after work."""
        last = {
            (order.station, order.port): order.is_stand for order in self.orders() if order.port
        }
        return len({station for station, _ in last}) == len(self.stations) and all(last.values())

    def hot(self) -> list[str]:
        """Return tools and feeders that still work, and tools whose last order was not their safe
        state.
        """
        found = [
            f"{name}: the feeder runs"
            for name in self.stations
            if name == "ale-1" and self.line.motor(name)
        ]
        last = {(order.station, order.port): order for order in self.orders()}
        touched = {order.station for order in last.values()}
        for station, port in ((station, port) for station, port in last if port):
            if not last[station, port].is_safe:
                found.append(f"{station} port {port}: the last order was {last[station, port]}")
        return found + [f"{name}: hot" for name in touched if _is_at_work(self.line, name)]


def _is_at_work(line: ServedLine, name: str) -> bool:
    ports = line.stations[name].plant.ports.values()
    return any(
        port.tool and port.doing.state == SIM_WORKING and not port.doing.extractor for port in ports
    )


def _as_from_a_terminal() -> None:
    """However the tests themselves were started."""
    for number in ENDING:
        signal.signal(number, signal.SIG_DFL)


class Start:
    """Starts runs of the line, each below its own folder; ends all that are left."""

    def __init__(self, line: ServedLine, folder: Path) -> None:
        self._line = line
        self.folder = folder
        self.runs: list[Run] = []

    def __call__(
        self,
        *stations: str,
        program: list[str] = PROGRAM,
        more: tuple[str, ...] = (),
        duration: str = "3h",
        **popen: object,
    ) -> Run:
        out = self.folder / f"run-{len(self.runs)}"
        chosen = [word for name in stations for word in ("-s", name)]
        command = [
            *program,
            "run",
            self._line.recipe,
            "--line",
            self._line.path,
            "--out",
            out,
            "-d",
            duration,
            *chosen,
            *more,
        ]
        popen.setdefault("preexec_fn", _as_from_a_terminal)
        streams: dict[str, object] = {
            "stdout": subprocess.DEVNULL,
            "stderr": subprocess.PIPE,
            "stdin": subprocess.DEVNULL,
        }
        begin = self._line.log.stat().st_size if self._line.log else 0
        process = subprocess.Popen(list(map(str, command)), text=True, **(streams | popen))  # type: ignore[call-overload]  # of Popen
        self.runs.append(Run(self._line, out, stations, process, begin))
        return self.runs[-1]

    def end_all(self) -> None:
        for run in self.runs:
            run.process.kill()
            run.process.communicate()


@pytest.fixture
def start(line: ServedLine, tmp_path: Path) -> Iterator[Start]:
    starting = Start(line, tmp_path)
    yield starting
    starting.end_all()


# -- clocks (docs/reference/faults.md, F-20, F-21, F-22) -------------------------------------------


@dataclass
class Clocks:
    """Four runs at a time, each with a different trouble; all have ended."""

    stepped: Run
    slept: Run
    stopped: Run
    summer: Run


@pytest.fixture(scope="module")
def clocks(line: ServedLine, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Clocks]:
    starting = Start(line, tmp_path_factory.mktemp("clocks"))
    madrid = {"PATH": os.environ["PATH"], "PYTHONPATH": os.environ.get("PYTHONPATH", "")} | german(
        starting.folder
    )
    stepped = starting("dde-1", program=[*ODD, f"step={HOUR},step={-2 * HOUR}"])
    slept = starting("dde-2", program=[*ODD, f"sleep={NIGHT}"])
    stopped = starting("ucr-1", more=("--no-guard",))
    summer = starting("ale-1", program=[*ODD, f"at={FALL_BACK}"], env=madrid)
    try:
        assert until(lambda: all(run.samples() for run in starting.runs), SOON_S), [
            run.process.poll() for run in starting.runs
        ]
        stopped.process.send_signal(signal.SIGSTOP)
        at = time.monotonic()
        stepped.process.send_signal(signal.SIGUSR1)
        slept.process.send_signal(signal.SIGUSR1)
        assert until(lambda: stepped.has("clock.step"), SOON_S)
        stepped.process.send_signal(signal.SIGUSR1)
        assert until(lambda: stepped.has("clock.step", 2) and slept.has("host.suspended"), SOON_S)
        time.sleep(max(at + 5.6 - time.monotonic(), 0.0))
        stopped.process.send_signal(signal.SIGCONT)
        assert until(lambda: stopped.has("host.suspended"), SOON_S)
        for run in starting.runs:
            run.process.send_signal(signal.SIGTERM)
        for run in starting.runs:
            run.end(None)
        yield Clocks(stepped, slept, stopped, summer)
    finally:
        starting.end_all()


@pytest.mark.campaign
def test_all_end_in_good_order_and_leave_nothing_hot(clocks: Clocks) -> None:
    runs = (clocks.stepped, clocks.slept, clocks.stopped, clocks.summer)
    assert [run.process.returncode for run in runs] == [143] * 4, [run.said for run in runs]
    assert [run.hot() for run in runs] == [[]] * 4


@pytest.mark.campaign
def test_a_stepped_clock_is_two_events_and_moves_no_tick(clocks: Clocks) -> None:
    events = clocks.stepped.events("clock.step")
    assert [round(value) for value in events["value"]] == [HOUR, -2 * HOUR]
    assert all(CLOCK_STEPPED in text and " to " in text for text in events["text"])
    samples = pd.read_parquet(clocks.stepped.folder / "samples")
    assert set(samples.groupby("port")["tick"].diff().dropna()) == {1}
    assert samples["late_us"].min() >= 0
    assert samples["scan_us"].min() >= 0
    assert all(times.is_monotonic_increasing for _, times in samples.groupby("port")["time"])
    offsets = [round(step.offset_s) for step in clocks.stepped.manifest.clock_steps or []]
    assert offsets == [HOUR, -HOUR]
    duration = open_run(clocks.stepped.folder).duration
    assert duration is not None
    assert 0 < duration.total_seconds() < SOON_S * 2
    assert clocks.stepped.wrong() == []


@pytest.mark.campaign
def test_a_machine_that_slept_is_one_event_no_step_of_the_clock_and_no_rows(clocks: Clocks) -> None:
    (slept,) = clocks.slept.events("host.suspended")["value"]
    assert slept == pytest.approx(NIGHT, abs=5)
    assert len(clocks.slept.events("clock.step")) == 0
    (facts,) = clocks.slept.manifest.stations
    assert facts.skipped == pytest.approx(NIGHT * RATE_HZ, abs=25)
    assert len(_far_from_grid(clocks.slept)) <= 2, (
        "more than the two ports of the tick that was under way"
    )
    # the station's clock knew of no night
    assert [text for text in clocks.slept.wrong() if not text.startswith("I4")] == []


def _far_from_grid(run: Run) -> list[int]:
    """Return the ticks of rows whose time differs from that of their tick."""
    samples, manifest = pd.read_parquet(run.folder / "samples"), run.manifest
    due = (manifest.t0_utc or 0.0) + samples["tick"] * (manifest.stations[0].period_s or 0.0)
    return list(samples["tick"][(samples["time"].astype("int64") / 1e6 - due).abs() > SOON_S])


@pytest.mark.campaign
def test_a_recorder_without_a_guard_that_stood_still_says_so_and_goes_on(clocks: Clocks) -> None:
    (stood,) = clocks.stopped.events("host.suspended")["value"]
    assert 5.0 < stood < SOON_S
    (facts,) = clocks.stopped.manifest.stations
    assert facts.skipped == pytest.approx(stood * RATE_HZ, abs=10)
    assert clocks.stopped.manifest.guard == "none"
    assert clocks.stopped.wrong() == []


@pytest.mark.campaign
def test_an_hour_that_comes_twice_in_madrid_comes_once_in_the_record(clocks: Clocks) -> None:
    run = clocks.summer
    assert run.folder.name.startswith("20261025T0059")
    samples = pd.read_parquet(run.folder / "samples")
    assert str(samples["time"].dt.tz) == "UTC"
    assert samples["time"].max() > pd.Timestamp("2026-10-25T01:00:00Z")
    assert len(run.events("clock.step")) == 0
    assert not pd.read_parquet(run.folder / "settings")["readback"].dropna().str.contains(",").any()
    assert run.wrong() == []


# -- signals (docs/reference/faults.md, F-28) ------------------------------------------------------

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 143}
KILLED = tuple(-number for number in ENDING)

STATES: dict[str, Callable[[Run], bool]] = {
    "starting": lambda run: True,
    "beginning": lambda run: run.out.is_dir(),
    "identifying": lambda run: run.has_asked(),
    "applying": lambda run: bool(run.orders()),
    "at work": lambda run: any(
        order.name == "status" and not order.is_stand for order in run.orders()
    ),
    "sampling": Run.samples,
    "making safe": lambda run: any(order.is_stand for order in run.orders()[-2:]),
    "sealing": lambda run: run.is_at_its_end(),
}
"""In which state a run is to be when the first signal comes, and how that is seen from outside."""


def struck(start: Start, rng: random.Random, state: str) -> int:
    """Send a run of two stations up to three signals from `state` on; return its exit code."""
    is_over = state in ("making safe", "sealing")
    run = start("dde-1", "ale-1", start_new_session=True, duration="0.5s" if is_over else "3h")
    numbers, all_of_them = rng.choices(ENDING, k=rng.randrange(1, 4)), rng.random() < 0.5
    assert until(lambda: STATES[state](run), SOON_S), (run.end(), run.said)
    for number in numbers:
        time.sleep(0.5 * rng.random())
        print(f"{state}: {number.name}{' to all processes of the terminal' if all_of_them else ''}")
        with suppress(ProcessLookupError):
            os.killpg(run.process.pid, number) if all_of_them else run.process.send_signal(number)
    code = run.end(None)
    if not run.out.is_dir() or not any(run.out.iterdir()):
        assert run.orders() == [], "it wrote something, and left no record"
        assert code in (130, *KILLED), run.said
        return code
    assert code == CODES[numbers[0]] or (code == 0 and is_over), run.said
    assert run.wrong() == []
    return code


def strike(start: Start, seed: int, states: Iterable[str]) -> None:
    rng = random.Random(seed)
    print(f"seed {seed}")
    met = Counter((state, struck(start, rng, state)) for state in states)
    print(
        f"{sum(met.values())} runs got one to three signals; (state, exit code): {dict(met)}; lost"
        " 0, wrong 0, hot 0"
    )


@pytest.mark.parametrize("state", ["applying"])
def test_a_signal_ends_a_run_in_good_order(start: Start, state: str) -> None:
    strike(start, SLICE_SEED, [state])


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("state", STATES)
def test_signals_in_each_state_twenty_five_times(
    start: Start, state: str, counted: Callable[..., None]
) -> None:
    strike(start, SEED, [state] * 25)
    counted(runs_ended_by_signals=25, lost=0, wrong=0, left_hot=0)


def test_a_signal_while_what_an_older_run_left_is_dealt_with_is_not_forgotten(
    start: Start, tmp_path: Path
) -> None:
    """Making old tools safe can take seconds, before this run's record begins."""
    there = tmp_path / "there"
    slow = SETTLES_SLOWLY.format(there=str(there))
    run = start("dde-1", program=[sys.executable, "-c", slow])
    assert until(there.exists, SOON_S)
    assert run.end(signal.SIGTERM) == 143, run.said
    assert run.orders() == []
    assert run.wrong() == []


@pytest.mark.campaign
def test_a_run_that_was_started_with_nohup_outlives_its_terminal(start: Start) -> None:
    def as_nohup_does() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    run = start("ucr-1", preexec_fn=as_nohup_does)
    assert until(run.samples, SOON_S)
    run.process.send_signal(signal.SIGHUP)
    time.sleep(0.5)
    assert not run.is_at_its_end()
    assert run.end(signal.SIGTERM) == 143, run.said
    assert run.wrong() == []
    assert len(run.events("run.signal")) == 1


def recovered_under(folder: Path, numbers: list[signal.Signals], moments: list[float]) -> int:
    """Run `recover` on a run that was cut off and end it with these signals; then run it to its
    end. Returns the first exit code.
    """
    run = few_rows.abandoned(folder, commits=6, rows=2000)
    process = subprocess.Popen(
        [*PROGRAM, "recover", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    for number, moment in zip(numbers, moments, strict=True):
        time.sleep(moment)
        process.send_signal(number)
    said = process.communicate(timeout=ENDS_S)[1]
    assert process.returncode in (0, 130, -signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP), said
    again = jbclog("recover", folder)
    assert again.returncode == 0, again.stderr
    assert check_run(run) == []
    assert few_rows.sealed_numbers(run) == list(range(12_000))
    return process.returncode


def test_a_signal_while_recovering_loses_nothing(tmp_path: Path) -> None:
    rng = random.Random(SLICE_SEED)
    recovered_under(tmp_path, [rng.choice(ENDING)], [0.4 + 0.5 * rng.random()])


@pytest.mark.campaign
@pytest.mark.timeout(900)
def test_signals_while_recovering_a_hundred_times(
    tmp_path: Path, counted: Callable[..., None]
) -> None:
    rng = random.Random(SEED)
    codes = Counter(
        recovered_under(tmp_path / str(i), [rng.choice(ENDING)], [1.5 * rng.random()])
        for i in range(100)
    )
    print(
        f"seed {SEED}: 100 times recover was ended by a signal: exit codes {dict(codes)}; lost 0,"
        " wrong 0"
    )
    counted(recoveries_ended_by_signals=100, lost=0, wrong=0)


# -- output that nobody reads (docs/reference/faults.md, F-46) -------------------------------------


@dataclass
class Unread:
    held: Run  # Ctrl-S
    stuck: Run  # two full pipes
    gone: Run  # pipes whose reader ends
    closed: Run  # no stream at all, no terminal
    seconds: dict[str, float]


@pytest.fixture(scope="module")
def unread(line: ServedLine, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Unread]:
    """Four runs whose output nobody reads, each for another reason; all were asked to end."""
    starting = Start(line, tmp_path_factory.mktemp("unread"))
    terminal, slave = pty.openpty()
    reading, writing = full_pipe()
    held = starting("dde-1", stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
    stuck = starting("dde-2", stdout=writing, stderr=writing)
    gone = starting("ucr-1", stdout=subprocess.PIPE)
    shell = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *PROGRAM]
    closed = starting("ale-1", program=shell, start_new_session=True, stderr=subprocess.DEVNULL)
    os.close(slave)
    os.close(writing)
    try:
        assert until(lambda: all(run.samples() for run in starting.runs), SOON_S), [
            run.process.poll() for run in starting.runs
        ]
        os.write(terminal, b"\x13")
        for stream in (gone.process.stdout, gone.process.stderr):
            assert stream is not None
            stream.close()
        gone.process.stdout = gone.process.stderr = None
        time.sleep(0.5)
        for run in starting.runs:
            run.process.send_signal(signal.SIGTERM)
        seconds = {run.stations[0]: _seconds_to_end(run) for run in starting.runs}
        yield Unread(held, stuck, gone, closed, seconds)
    finally:
        starting.end_all()
        os.close(terminal)
        os.close(reading)


def _seconds_to_end(run: Run) -> float:
    began = time.monotonic()
    run.end(None)
    return time.monotonic() - began


@pytest.mark.parametrize("which", ["held", "stuck", "gone", "closed"])
def test_who_does_not_read_keeps_no_run_from_its_end(unread: Unread, which: str) -> None:
    run: Run = getattr(unread, which)
    assert run.process.returncode == 143
    assert run.wrong() == []
    assert unread.seconds[run.stations[0]] < ENDS_S / 2


def test_what_was_not_shown_is_in_the_record_with_the_count(unread: Unread) -> None:
    (missed,) = unread.stuck.events("notes.missed")["value"]
    assert missed > 0
    assert len(unread.closed.events("notes.missed")) == 0  # closed on purpose


@pytest.mark.campaign
def test_safe_does_not_wait_for_a_reader_either(start: Start) -> None:
    run = start("dde-1", "ale-1")
    assert until(run.samples, SOON_S)
    reading, writing = full_pipe()
    began = time.monotonic()
    command = [*PROGRAM, "safe", "--line", str(run.line.path)]
    safe = subprocess.run(command, stdout=writing, stderr=writing, timeout=SOON_S, check=False)
    os.close(reading)
    os.close(writing)
    assert safe.returncode == 0
    assert run.line.at_work() == 0
    assert time.monotonic() - began < ENDS_S
    assert run.end(None) == 143


# -- locales, homes (docs/reference/faults.md, F-46) -----------------------------------------------


def german(folder: Path) -> dict[str, str]:
    """An environment with commas in numbers, if the system has one; an odd time zone, and no
    writable home.
    """
    made = folder / "de_DE.UTF-8"
    if shutil.which("localedef"):
        subprocess.run(
            ["localedef", "-i", "de_DE", "-f", "UTF-8", made], capture_output=True, check=False
        )
    return {
        "LC_ALL": "de_DE.UTF-8" if made.exists() else "C",
        "LOCPATH": str(folder),
        "TZ": "Europe/Madrid",
        "HOME": "/proc",
    }


@pytest.mark.campaign
def test_neither_locale_nor_zone_nor_home_changes_a_digit(clocks: Clocks, tmp_path: Path) -> None:
    """In a run and in a report: the same bytes in C without a home, and with commas in Madrid."""
    pages = []
    for number, environment in enumerate(({"LC_ALL": "C", "HOME": "/nowhere"}, german(tmp_path))):
        copy = tmp_path / str(number) / clocks.summer.folder.name
        shutil.copytree(clocks.summer.folder, copy)
        search = {"PYTHONPATH": os.environ.get("PYTHONPATH", ""), "PATH": os.environ["PATH"]}
        report = subprocess.run(
            [*PROGRAM, "report", str(copy)],
            env=environment | search,
            capture_output=True,
            text=True,
            check=False,
            timeout=SOON_S,
        )
        assert report.returncode == 0, report.stderr
        pages.append((copy / "report.json").read_text() + (copy / "report.html").read_text())
    assert pages[0] == pages[1]
    assert "2026-10-25" in pages[0]


# -- two recorders (docs/reference/faults.md, F-31) ------------------------------------------------


def race(start: Start, apart_s: float) -> str:
    """Start two recorders on one port, that far apart: one records, the other names it."""
    runs = [start("ucr-1", duration="2s")]
    time.sleep(apart_s)
    runs.append(start("ucr-1", duration="2s"))
    codes = [run.end(None) for run in runs]
    assert sorted(codes) == [0, 3], [run.said for run in runs]
    winner, loser = sorted(runs, key=lambda run: run.process.returncode)
    assert f"process {winner.process.pid}" in loser.said, loser.said
    assert winner.wrong() == []
    return "first" if winner is runs[0] else "second"


@pytest.mark.campaign
def test_of_two_recorders_that_start_together_one_says_who_has_the_port(start: Start) -> None:
    race(start, 0.0)


@pytest.mark.campaign
@pytest.mark.timeout(900)
def test_two_recorders_fifty_times(start: Start, counted: Callable[..., None]) -> None:
    rng = random.Random(SEED)
    won = Counter(race(start, rng.random()) for _ in range(50))
    print(
        f"seed {SEED}: 50 pairs of recorders on one port; who recorded: {dict(won)}; lost 0, wrong"
        " 0, both 0, none 0"
    )
    counted(pairs_of_recorders=50, lost=0, wrong=0)


@pytest.mark.campaign
def test_a_program_that_has_the_port_open_without_asking_is_named_and_gets_nothing_into_the_record(
    start: Start,
) -> None:
    """It takes bytes meant for the run: answers are lost, none is invented."""
    run = start("ucr-1", program=[sys.executable, "-c", LOOKS_AT_PORTS_OFTEN])
    assert until(run.samples, SOON_S)
    device = os.open(run.line.url("ucr-1"), os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    thief = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import os, time\nwhile True:\n try: os.read(0, 3)\n except OSError: time.sleep(0.01)",
        ],
        stdin=device,
    )
    os.close(device)
    try:
        assert until(lambda: run.has("link.contention"), SOON_S)
        time.sleep(1.0)
    finally:
        thief.kill()
        thief.wait()
    assert run.end() in (143, 3), run.said
    (text,) = run.events("link.contention")["text"]
    assert f"process {thief.pid} " in text
    assert run.wrong() == []


# -- viewers (docs/reference/faults.md, F-47) ------------------------------------------------------


@pytest.mark.campaign
def test_whatever_fails_in_showing_a_run_is_counted_and_no_fault_of_it(start: Start) -> None:
    run = start("ucr-1", program=[sys.executable, "-c", SHOWING_FAILS], duration="1s")
    assert run.end(None) == 0, run.said
    assert run.wrong() == []
    (missed,) = run.events("notes.missed")["value"]
    assert missed > 0


def test_a_report_that_fails_changes_nothing_of_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("a fault of its own")

    folder = make_run(tmp_path, seconds=2.0)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    patch(monkeypatch, "report.gather", fail)
    ended = invoked("report", folder)
    assert ended.exit_code == 1
    assert INTERNAL_ERROR in ended.stderr
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    assert read_manifest(folder).state == "sealed"
