"""Runs on a virtual clock whose record is on a disk that fails.

``python tests/support faults.failing_run SCENARIO DIR ERROR AGAIN FIRST STRIDE``, with
`failing_disk.c` preloaded: operation FIRST, FIRST + STRIDE ... of the scenario fails with ERROR
(``EIO``, ``ENOSPC``), and with AGAIN 1 everything after it, until the scenario ends without having
met it. A line of JSON for each tells what did not hold. `run` is a run from its folder to its seal;
`recover` finishes one that was cut off. Each is done in a process of its own, from the same
beginning; afterwards the disk is well again, the folder is recovered, and another run is made
beside it.
"""

from __future__ import annotations

import ctypes
import errno
import json
import shutil
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from support.faults.crash import contents, in_child
from support.faults.killed_run import sealed_rows
from support.oracles.invariants import Wires, violations
from support.product import (
    COLUMN,
    COMMIT_EVERY_S,
    NOT_KEPT,
    STAND,
    CounterRow,
    EventRow,
    FolderLock,
    RecordError,
    RunPlan,
    RunRecord,
    RunResult,
    RunStore,
    SampleRow,
    SettingRow,
    StationFacts,
    VirtualClock,
    VirtualDriver,
    VirtualStation,
    put,
    read_manifest,
    recover_run,
    run_station,
    seal,
    virtual_station,
)
from support.virtual.recorded_run import Nobody, plan_in
from support.virtual.virtual_run import Memory, Tap, line_text

DURATION_S = 3.0
SIM = "joints_per_minute = 30\n"
NEVER = 1 << 40
TIME = COLUMN["time"]
TOLD = ("record.failed", "record.new_file", "record.not_sealed")


class Disk:
    """The preloaded library, or a disk that never fails where there is none."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL(None)

    def fail(self, below: Path, nth: int, error: int, again: int) -> None:
        self._library.failing_arm(str(below).encode(), ctypes.c_long(nth), error, again)

    def heal(self) -> tuple[int, int]:
        """How many operations there were, and how many failed; none fails any more."""
        found = int(self._library.failing_count()), int(self._library.failing_fired())
        self._library.failing_arm(b"", ctypes.c_long(NEVER), 0, 0)
        return found


class Both:
    """A journal that gives everything to the record and keeps it in memory too."""

    def __init__(self, store: RunStore, memory: Memory) -> None:
        self._to = (store, memory)

    def sample(self, row: SampleRow) -> None:
        for one in self._to:
            one.sample(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        for one in self._to:
            one.event(event, at_once=at_once)

    def setting(self, setting: SettingRow) -> None:
        for one in self._to:
            one.setting(setting)

    def counter(self, counter: CounterRow) -> None:
        for one in self._to:
            one.counter(counter)

    def facts(self, facts: StationFacts) -> None:
        for one in self._to:
            one.facts(facts)


@dataclass
class Trial:
    """One run of `plan` below `out`, its commits made by the virtual clock as the writer's thread
    makes them by the real one.
    """

    plan: RunPlan
    out: Path
    heard: Wires
    memory: Memory
    safe: bool = True
    folder: Path | None = None
    result: RunResult | None = None
    acknowledged: int = 0  # rows of samples

    def go(self, *, ends: bool = True) -> None:
        """Raises `RecordError` where the record cannot be begun. Without `ends` it is cut off
        there.
        """
        clock, failures = VirtualClock(), []
        papers = RunRecord(self.plan, self.out, Nobody(), clock, failures.append, seal_every_s=None)
        self.folder = papers.folder
        for context in papers.contexts:
            context.log.journal = Both(papers._store, self.memory)
        driver = VirtualDriver(clock)
        papers.begin()
        stations = [
            virtual_station(station.spec, now=clock.monotonic()) for station in self.plan.stations
        ]
        taps = {station.name: Tap(station) for station in stations}
        self.heard = {name: tap.heard for name, tap in taps.items()}
        for station, context in zip(stations, papers.contexts, strict=True):
            driver.add(run_station(context), taps[station.name])

        def commit() -> None:
            handed = len(self.memory.samples)
            with suppress(RecordError):
                papers._store.commit_now()
                self.acknowledged = handed
            if failures:
                driver.end(f"the record cannot be kept: {failures[0]}")
            driver.at(clock.monotonic() + COMMIT_EVERY_S, commit)

        driver.at(clock.monotonic() + COMMIT_EVERY_S, commit)
        driver.run()
        self.safe = all(
            _is_safe(station) for station in stations if isinstance(station, VirtualStation)
        )
        if ends:
            self.result = papers.conclude(papers.close())


def _is_safe(station: VirtualStation) -> bool:
    last = {write.port: write.value for write in station.log.written("status")}
    return all(value == STAND for value in last.values())


def trial(home: Path, duration_s: float = DURATION_S) -> Trial:
    return Trial(plan_in(home, line_text(SIM), duration_s=duration_s), home / "runs", {}, Memory())


# -- the scenarios ---------------------------------------------------------------------------------


def failing_run(disk: Disk, home: Path, nth: int, error: int, again: int) -> dict[str, object]:
    """A run, from making its folder to sealing it."""
    one = trial(home)
    one.out.mkdir()
    disk.fail(one.out, nth, error, again)
    wrong, refused = [], ""
    try:
        one.go()
    except RecordError as failure:
        refused = str(failure)
    except Exception as failure:
        wrong = [f"I9: {type(failure).__name__}: {failure}"]
    count, fired = disk.heal()
    wrong += [] if one.safe else ["unsafe: a tool was left at work"]
    touched = [ask.text for asked in one.heard.values() for ask in asked]
    if refused and touched:
        wrong.append(f"refused, and stations were asked: {touched[:3]}")
    code = one.result.exit_code.value if one.result else None
    wrong += _after(one, code) if one.folder is not None else []
    wrong += _next(home)
    told = refused or (str(one.result.findings[0]) if one.result and one.result.findings else "")
    return {"count": count, "fired": fired, "code": code, "told": told[:120], "wrong": wrong}


def _after(one: Trial, code: int | None) -> list[str]:
    """What the disk has, once it is well again and the folder was recovered."""
    assert one.folder is not None
    if not one.folder.exists():
        return ["the folder is gone, and its stations were asked"] if one.heard else []
    before = read_manifest(one.folder) if (one.folder / "manifest.json").exists() else None
    was_sealed = before is not None and before.state == "sealed"
    try:
        recover_run(one.folder)
        first = contents(one.folder)
        recover_run(one.folder)
    except RecordError as failure:
        return [f"not recovered: {failure}"]
    wrong = [] if contents(one.folder) == first else ["recovered twice is not recovered once"]
    wrong += violations(one.folder, one.heard)
    return wrong + _account(one, code, was_sealed=was_sealed)


def _account(one: Trial, code: int | None, *, was_sealed: bool) -> list[str]:
    """Every row that was handed over is there, as it was, or its loss is told: by the exit code,
    the manifest, an event.
    """
    assert one.folder is not None
    sealed, manifest = sealed_rows(one.folder), read_manifest(one.folder)
    samples = [list(row[1:]) for row in sealed["samples"]]  # without `seq`
    handed = [list(row) for row in one.memory.samples]
    wrong = []
    if [row for row in samples if row not in handed]:
        wrong.append("I4: rows that were never handed over")
    missing = len(handed) - len(samples)
    if samples[: one.acknowledged] != handed[: one.acknowledged]:
        wrong.append(f"I3: {one.acknowledged} rows were acknowledged, {len(samples)} are there")
    if missing and manifest.lost is None:
        wrong.append(
            f"lost without a word: {missing} of {len(handed)} samples; exit status"
            f" {manifest.exit_status}, code {code}"
        )
    if missing and code not in (4, 5):
        wrong.append(f"{missing} samples are missing, and the exit code is {code}")
    if not was_sealed and code == 0:
        wrong.append("it was not sealed, and the exit code was 0")
    kinds = {str(row[5]) for row in sealed["events"]}
    if missing and was_sealed and not kinds & set(TOLD) and NOT_KEPT not in str(manifest.lost):
        wrong.append(
            f"{missing} samples are missing, and nothing tells why: {sorted(kinds)},"
            f" {manifest.lost}"
        )
    if missing and manifest.lost is not None and manifest.lost.seconds_at_most is not None:
        seconds = (handed[-1][TIME] - (samples[-1][TIME] if samples else handed[0][TIME])) / 1e6
        if seconds > manifest.lost.seconds_at_most:
            wrong.append(
                f"I3: {seconds:.1f} s are missing, {manifest.lost.seconds_at_most:g} s are admitted"
            )
    return wrong


def _next(home: Path) -> list[str]:
    """Another run beside it, on a disk that is well."""
    try:
        after = trial(home, duration_s=0.5)
        after.go()
    except Exception as failure:
        return [f"the next run does not start: {type(failure).__name__}: {failure}"]
    assert after.folder is not None
    return [f"the next run: {text}" for text in violations(after.folder, after.heard)]


def failing_recovery(disk: Disk, home: Path, nth: int, error: int, again: int) -> dict[str, object]:
    """Finishing a run that was cut off, whose rows are known."""
    (folder,) = (home / "runs").iterdir()
    expected = json.loads((home / "expected.json").read_text())
    disk.fail(folder, nth, error, again)
    wrong, told = [], ""
    try:
        recover_run(folder)
    except RecordError as failure:
        told = str(failure)
    except Exception as failure:
        wrong = [f"I9: {type(failure).__name__}: {failure}"]
    count, fired = disk.heal()
    try:
        recover_run(folder)
        first = contents(folder)
        recover_run(folder)
        wrong += [] if contents(folder) == first else ["recovered twice is not recovered once"]
        rows = json.loads(json.dumps(sealed_rows(folder)))
        wrong += [f"{table} is not what it was" for table in rows if rows[table] != expected[table]]
        wrong += [text for text in violations(folder, {}) if text.startswith("I8")]
    except RecordError as failure:
        wrong.append(f"not recovered: {failure}")
    return {"count": count, "fired": fired, "code": None, "told": told[:120], "wrong": wrong}


def cut_off(home: Path) -> None:
    """Make the folder of a run that was cut off, and note which rows a recovery gives."""
    one = trial(home)
    one.go(ends=False)
    assert one.folder is not None
    copy = Path(shutil.copytree(one.folder, home / "copy" / one.folder.name))
    recover_run(copy)
    (home / "expected.json").write_text(json.dumps(sealed_rows(copy)))
    shutil.rmtree(copy.parent)


SCENARIOS = {"run": failing_run, "recover": failing_recovery}


def main() -> None:
    scenario, home, error, again = (
        sys.argv[1],
        Path(sys.argv[2]),
        getattr(errno, sys.argv[3]),
        int(sys.argv[4]),
    )
    first, stride = int(sys.argv[5]), int(sys.argv[6])
    disk = Disk()
    put("run_record.seal_in_child", _seal)  # a child process would take a second for it
    put("RunStore._write_loop", lambda self: None)  # the virtual clock commits
    if scenario == "recover":
        (home / "base").mkdir()
        in_child(lambda: cut_off(home / "base"))
    for nth in range(first, 100_000, stride):
        place = home / str(nth)
        shutil.copytree(home / "base", place) if scenario == "recover" else place.mkdir()
        _, told = in_child(
            lambda place=place, nth=nth: SCENARIOS[scenario](disk, place, nth, error, again)
        )
        print(
            json.dumps(
                {
                    "nth": nth,
                    **(told if isinstance(told, dict) else {"fired": 1, "wrong": [str(told)]}),
                }
            ),
            flush=True,
        )
        if isinstance(told, dict) and not told["wrong"]:
            shutil.rmtree(place)
        if isinstance(told, dict) and told["count"] < nth:
            return


def _seal(folder: Path, _lock: FolderLock) -> None:
    seal(folder)


if __name__ == "__main__":
    main()
