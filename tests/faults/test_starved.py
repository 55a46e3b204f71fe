"""Memory refused to a recorder or a guard while tools are hot: whichever request fails, every tool
is put in its safe state.

The recorder does it if it can end its run in order; the guard does it if the recorder dies; if the
guard dies, it is replaced and the recorder does it at its own end. Requests fail below Python,
once, a hundred times, or permanently (`failing_alloc.c`), including those of the store and Arrow,
at a random number whose orders of magnitude are equally likely. Afterwards the folder recovers, its
record is accounted for, and no lease is open. Left out: a guard that takes over and then gets no
memory at all, because nobody is left then.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from support import program
from support.faults.starved import ALWAYS, RECORDER, TAKING_OVER, WATCHING, Starving
from support.virtual.served_line import ServedLine

SEED = random.randrange(1 << 32)
OF_THE_SLICE = 1106854856  # the recorder's 25th request, a lease renewal
MOST = {RECORDER: 200_000, WATCHING: 2_500, TAKING_OVER: 12_000}
"""Requests while tools are hot, about: of a run of five seconds, of a guard of one, of a guard that
takes over.
"""
WAYS = [
    (RECORDER, 1),
    (RECORDER, 100),
    (RECORDER, ALWAYS),
    (WATCHING, 1),
    (WATCHING, ALWAYS),
    (TAKING_OVER, 1),
]
NAMES = [f"{who.replace(' ', '-')}-{'always' if many < 0 else many}" for who, many in WAYS]
TRIALS = 40


def drawn(rng: random.Random, most: int) -> int:
    return round(most ** rng.random())


def starve(
    line: ServedLine, home: Path, library: Path, way: tuple[str, int], seed: int, trials: int
) -> list[Starving]:
    rng, done, wrong = random.Random(seed), [], []
    for trial in range(trials):
        one = Starving(line, home / str(trial), library, way[0], drawn(rng, MOST[way[0]]), way[1])
        found = [f"request {one.nth} of the {one.who} ({one.many}): {text}" for text in one.go()]
        print(
            f"seed {seed}, {one.who}, request {one.nth}: code {one.code}, {one.refused} refused,"
            f" safe after {one.safe_s:.1f} s"
        )
        wrong += found
        done.append(one)
    assert wrong == []
    return done


@pytest.mark.parametrize("way", [WAYS[0], WAYS[5]], ids=[NAMES[0], NAMES[5]])
def test_once(
    line: ServedLine, tmp_path: Path, starving_library: Path, way: tuple[str, int]
) -> None:
    starve(line, tmp_path, starving_library, way, OF_THE_SLICE, 1)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("way", WAYS, ids=NAMES)
def test_again_and_again(
    line: ServedLine,
    tmp_path: Path,
    starving_library: Path,
    way: tuple[str, int],
    counted: Callable[..., None],
) -> None:
    done = starve(line, tmp_path, starving_library, way, SEED, TRIALS)
    refused = [one for one in done if one.refused]
    name = NAMES[WAYS.index(way)]
    counted(
        **{
            f"{name} runs": len(done),
            f"{name} with requests refused": len(refused),
            f"{name} left hot": 0,
        }
    )
    counted(
        **{
            f"{name} safe within ms at the latest": round(
                1000 * max((one.safe_s for one in refused), default=0.0)
            )
        }
    )


@pytest.mark.parametrize("part", ["lease_writer", "limit"])
def test_one_refusal_ends_no_thread_of_the_guard_and_leaves_none_waiting(
    part: str, tmp_path: Path, starving_library: Path
) -> None:
    more = {
        "FAILING_ALLOC": str(tmp_path),
        "FAILING_ALLOC_IN": "refused_once",
        "XDG_STATE_HOME": str(tmp_path),
    }
    done = subprocess.run(
        program("faults.refused_once", part, tmp_path),
        env={**os.environ, **more, "LD_PRELOAD": str(starving_library), "PYTHONMALLOC": "malloc"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[]\n"


def test_the_library_refuses_what_it_is_asked_to(tmp_path: Path, starving_library: Path) -> None:
    """A program that requests a thousand objects gets all but one."""
    code = (
        "import mmap, os, struct, sys; f = open(f'{sys.argv[1]}/{os.getpid()}', 'r+b'); m ="
        " mmap.mmap(f.fileno(), 32)\n"
    )
    code += "m[8:16] = struct.pack('q', 1); m[0:8] = struct.pack('q', 50); got = 0\n"
    code += (
        "for _ in range(1000):\n    try:\n        bytes(1000); got += 1\n    except MemoryError:\n "
        "       pass\n"
    )
    code += "print(got, struct.unpack_from('q', m, 24)[0])"
    more = {
        "LD_PRELOAD": str(starving_library),
        "PYTHONMALLOC": "malloc",
        "FAILING_ALLOC": str(tmp_path),
        "FAILING_ALLOC_IN": "mmap",
    }
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        env={**os.environ, **more},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["999", "1"]
