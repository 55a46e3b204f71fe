"""Kills a process at a chosen step of its work on a run's folder, for real, and looks at what it
leaves.

Run as a program, because it forks: ``python tests/support faults.crash SCENARIO DIR FIRST STRIDE
[--power]`` prints a line of JSON for each step FIRST, FIRST + STRIDE ... at which it killed, until
the work ends by itself. ``... slice DIR FIRST STRIDE`` does so in every scenario, with and without
``--power``. ``... random DIR SEED TRIALS`` kills a recorder at random moments instead.

A step is whatever reaches the disk: a sync, a rename, a removal, a new folder, a row group, what
the store of an open run does. The kill is SIGKILL, just before the step. With ``--power`` a rename
whose folder was not synced afterwards is undone, as a power cut may do. Nothing of this is in the
product: the child patches what it calls.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow.dataset  # noqa: F401  # once, instead of in each child
import pyarrow.parquet as pq

from support.product import (
    before_each_write,
    check_run,
    conclude_run,
    create_run,
    open_store,
    read_manifest,
    recover_run,
    seal,
    seal_part,
)
from support.records import few_rows

ROWS = 120


# -- the work that is cut off ----------------------------------------------------------------------


def close_and_seal(folder: Path) -> None:
    """What a recorder does at the end of a run."""
    seal(folder)
    conclude_run(folder)


def seal_a_part(folder: Path) -> None:
    """What its child does each hour."""
    seal_part(folder)


def recover_it(folder: Path) -> None:
    """What a person does after a crash."""
    recover_run(folder)


def record(folder: Path) -> None:
    """Some seconds of a recorder's life; each commit that is acknowledged is told in a file."""
    store = open_store(folder, seal_every_s=None)
    store.start()
    for first in range(0, ROWS, 10):
        few_rows.hand_over(store, range(first, first + 10))
        store.commit_now()
        acknowledge(folder, first + 10)
    store.close()
    store.release()


def acknowledge(folder: Path, rows: int) -> None:
    with folder.with_name("acknowledged").open("a") as file:
        file.write(f"{rows}\n")


def abandoned(out: Path) -> Path:
    return few_rows.abandoned(out, commits=4, rows=ROWS // 4)


def closed(out: Path) -> Path:
    return few_rows.closed(out, ROWS)


def empty(out: Path) -> Path:
    return create_run(out, "bench", 0.0)


SCENARIOS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], None]]] = {
    "seal": (closed, close_and_seal),
    "part": (abandoned, seal_a_part),
    "recover": (abandoned, recover_it),
    "record": (empty, record),
}


# -- the kill --------------------------------------------------------------------------------------


@dataclass
class Steps:
    """Counts the steps of this process and kills it before a chosen one; notes renames and synced
    folders.
    """

    fatal: int
    notes: Path
    done: int = 0

    def step(self) -> None:
        self.done += 1
        if self.done == self.fatal:
            os.kill(os.getpid(), signal.SIGKILL)

    def note(self, *words: object) -> None:
        with self.notes.open("a") as file:
            file.write(json.dumps([str(word) for word in words]) + "\n")

    def arm(self) -> None:
        fsync, replace, write_table = os.fsync, os.replace, pq.ParquetWriter.write_table

        def syncing(descriptor: int) -> None:
            self.step()
            fsync(descriptor)
            self.note("synced", Path(f"/proc/self/fd/{descriptor}").readlink())

        def replacing(old: Path, new: Path) -> None:
            self.step()
            before = self.notes.with_name(f"before-{self.done}")
            if Path(new).exists():
                shutil.copy(new, before)
            replace(old, new)
            self.note("renamed", new, before)

        def writing(writer: pq.ParquetWriter, *arguments: object, **more: object) -> None:
            self.step()
            write_table(writer, *arguments, **more)

        os.fsync, os.replace = syncing, replacing
        before_each_write(self.step)
        pq.ParquetWriter.write_table = writing
        for name in ("unlink", "mkdir"):
            setattr(os, name, self.before(getattr(os, name)))

    def before(self, real: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **more: object) -> object:
            self.step()
            return real(*arguments, **more)

        return call


def undo_unsynced_renames(notes: Path) -> None:
    """What a power cut may take back: renames in folders that were not synced since."""
    lines = [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    for place, (what, *paths) in reversed(list(enumerate(lines))):
        if what == "renamed" and ["synced", str(Path(paths[0]).parent)] not in lines[place:]:
            new, before = map(Path, paths)
            if before.exists():
                shutil.copy(before, new)
            else:
                new.unlink()


def in_child(work: Callable[[], object]) -> tuple[int, object]:
    """Do `work` in a forked process; give how it ended and what it returned."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        status = 1
        try:
            os.write(writing, json.dumps(work()).encode())
            status = 0
        except BaseException as error:
            os.write(writing, json.dumps(f"{type(error).__name__}: {error}").encode())
        os._exit(status)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        told = pipe.read()
    _, status = os.waitpid(pid, 0)
    return status, json.loads(told) if told else None


# -- what is left ----------------------------------------------------------------------------------


def aftermath(folder: Path) -> dict[str, object]:
    """Recover the folder, twice, and say what is in it then."""
    recover_run(folder, 20.0)
    first = contents(folder)
    recover_run(folder)
    manifest = read_manifest(folder)
    told = folder.with_name("acknowledged")
    return {
        "acknowledged": (
            int(told.read_text().split()[-1]) if told.exists() and told.read_text() else 0
        ),
        "numbers": few_rows.sealed_numbers(folder),
        "events": few_rows.sealed_events(folder),
        "findings": [str(finding) for finding in check_run(folder)],
        "twice the same": contents(folder) == first,
        "exit status": manifest.exit_status,
        "lost": None if manifest.lost is None else manifest.lost.seconds_at_most,
        "leavings": (
            sorted(path.name for path in folder.rglob(".*"))
            + sorted(path.name for path in folder.glob("live*"))
        ),
    }


def contents(folder: Path) -> dict[str, str]:
    """The files below a folder, each with its digest."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def kill_at_steps(scenario: str, home: Path, first: int, stride: int, power: bool) -> None:
    make, work = SCENARIOS[scenario]
    _, name = in_child(lambda: str(make(home / "base")))
    base = Path(str(name))
    for fatal in range(first, 10_000, stride):
        trial = home / str(fatal)
        folder = Path(shutil.copytree(base, trial / base.name))
        steps = Steps(fatal, trial / "notes")

        def working(steps: Steps = steps, folder: Path = folder) -> None:
            steps.arm()
            work(folder)

        status, told = in_child(working)
        if status == 0:
            return
        if not os.WIFSIGNALED(status):
            print(json.dumps({"step": fatal, "error": told}), flush=True)
            return
        if power:
            undo_unsynced_renames(trial / "notes")
        status, left = in_child(lambda folder=folder: aftermath(folder))
        print(
            json.dumps({"step": fatal, **(left if isinstance(left, dict) else {"error": left})}),
            flush=True,
        )
        shutil.rmtree(trial)


def kill_at_some_steps(home: Path, first: int, stride: int) -> None:
    """In every scenario, with and without power, each beginning at another step; a line with its
    name comes before each.
    """
    for power in (False, True):
        for number, scenario in enumerate(sorted(SCENARIOS)):
            print(json.dumps([scenario, power]), flush=True)
            kill_at_steps(
                scenario, home / f"{scenario}-{power}", first + 4 * power + number, stride, power
            )


def kill_at_random(home: Path, seed: int, trials: int) -> None:
    rng = random.Random(seed)
    for trial in range(trials):
        out = home / f"{seed}-{trial}"
        out.mkdir()
        pid = os.fork()
        if pid == 0:
            record_for_ever(out, rng.random())
        time.sleep(0.05 + rng.random() * 0.6)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        folder = next(path for path in out.iterdir() if path.is_dir())
        _, left = in_child(lambda folder=folder: aftermath(folder))
        print(
            json.dumps({"step": trial, **(left if isinstance(left, dict) else {"error": left})}),
            flush=True,
        )
        shutil.rmtree(out)


def record_for_ever(out: Path, chance: float) -> None:
    """Record as fast as commits go, sealing a part now and then, until the kill comes."""
    store = open_store(create_run(out, "bench", 0.0), seal_every_s=None)
    store.start()
    rng = random.Random(chance)
    number = 0
    while True:
        more = rng.randrange(1, 60)
        few_rows.hand_over(store, range(number, number + more))
        number += more
        store.commit_now()
        acknowledge(store.folder, number)
        if rng.random() < 0.02:
            store.seal_now()
        store._reap()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenario", choices=[*SCENARIOS, "random", "slice"])
    parser.add_argument("dir", type=Path)
    parser.add_argument("first", type=int)
    parser.add_argument("stride", type=int)
    parser.add_argument("--power", action="store_true")
    given = parser.parse_args()
    if given.scenario == "random":
        kill_at_random(given.dir, given.first, given.stride)
    elif given.scenario == "slice":
        kill_at_some_steps(given.dir, given.first, given.stride)
    else:
        kill_at_steps(given.scenario, given.dir, given.first, given.stride, given.power)
    sys.stdout.flush()


if __name__ == "__main__":
    main()
