"""Files in a run's folder that are not what their names say: every command ends with a result, and
one folder never blocks the others.
"""

from __future__ import annotations

import os
import shutil
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.record.annotations import append
from jbclog.record.manifest import NAME
from jbclog.record.recover import recover
from jbclog.report.write import write_report
from support.campaigns.foreign_matrix import (
    OF_A_FOLDER,
    SPECIAL,
    VERBS,
    Ended,
    Pairs,
    put,
    table,
    words_of,
)
from support.faults.bombs import BOMBS, PARTS
from support.faults.forged_parts import FORGED
from support.records import few_rows
from support.records.small_run import make_run

GOOD, BAD, CRASHED = "good", "bad", "crashed"
WIRE_NAME = "wire/a.tsv.gz"
PATHS = (
    *(
        NAME,
        "annotations.jsonl",
        "lease.json",
        "guard.jsonl",
        "guard.lock",
        "damage.jsonl",
        "line.toml",
        "recipes/tht.toml",
    ),
    *(
        "samples/part-0000.parquet",
        "events/part-0000.parquet",
        "settings/part-0000.parquet",
        "counters/part-0000.parquet",
    ),
    *(
        "samples",
        "recipes",
        "wire",
        WIRE_NAME,
        "report.json",
        "report.html",
        "joints.parquet",
        "metrics.parquet",
        "figures",
        "live.reserve",
        "live.sqlite",
        "live.lock",
    ),
    *("live.sqlite-wal", "damaged", "../verifications.jsonl"),
)
FORGED_IN = tuple(
    f"{table}/part-0000.parquet" for table in ("samples", "events", "settings", "counters")
)
EVERY = {**BOMBS, "counters/part-0000.parquet": PARTS}
EVERY |= {path: EVERY[path] | FORGED for path in FORGED_IN}
"""File of a run -> what is made of it or put in its place, by name."""
OF_CRASHED = (
    NAME,
    "live.sqlite",
    "live.sqlite-wal",
    "live.sqlite-shm",
    "live.lock",
    "guard.jsonl",
    "guard.lock",
    "lease.json",
    "damage.jsonl",
)
VERBS_OF_CRASHED = (
    "recover",
    "runs",
    "check",
    "report",
    "alarms",
    "trend",
    "start of the next run",
)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs: a sealed one that stays intact, one to be altered, one that crashed."""
    out = tmp_path_factory.mktemp("kept") / "runs"
    for name in (GOOD, BAD):
        made = make_run(out / name, 8.0)
        append(made, who="x", what="x", why="x")
        write_report(made)
    few_rows.abandoned(out / CRASHED)
    return out


class Place:
    """A copy of the folder of runs, with one file of one run replaced."""

    def __init__(self, kept: Path, home: Path, of: str = BAD) -> None:
        self.runs = home / "runs"
        shutil.rmtree(home, ignore_errors=True)
        self.runs.mkdir(parents=True)
        source = {
            name: next(path for path in (kept / name).iterdir() if path.is_dir())
            for name in (GOOD, of)
        }
        for path in source.values():
            shutil.copytree(path, self.runs / path.name)
        self.bad, self.good = self.runs / source[of].name, self.runs / source[GOOD].name
        (home / "line.toml").write_text(
            '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\n'
        )
        self.places = {
            "run": self.bad,
            "runs": self.runs,
            "other": self.good,
            "line": home / "line.toml",
            "ledger": home / "ledger",
        }

    def run(self, pairs: Pairs, verb: str) -> Ended:
        return pairs.run(words_of(verb, self.places))


def spoilt(kept: Path, home: Path, path: str, made: Callable[[Path], None], of: str = BAD) -> Place:
    """The folder of runs with that in place of a file; a bomb may use the file it replaces."""
    place = Place(kept, home, of)
    where = place.bad / path
    if made in SPECIAL.values():
        put(where, made)
    else:
        where.parent.mkdir(exist_ok=True)
        made(where)
    return place


def is_answer(place: Place, verb: str, ended: Ended) -> str | None:
    """Return the fault of a command's answer, or None; for a folder of runs the good run must still
    appear.
    """
    if ended.trouble:
        return ended.trouble
    if verb == "runs" and place.good.name not in ended.output:
        return "the good run is not shown"
    return None


def special_pairs() -> list[tuple[str, str, str]]:
    return [(path, kind, BAD) for path in PATHS for kind in SPECIAL] + [
        (path, kind, CRASHED) for path in OF_CRASHED for kind in SPECIAL
    ]


def bomb_pairs() -> list[tuple[str, str, str]]:
    live = [path for path in EVERY if path.startswith(("live", "damage", "guard", "lease"))]
    return [
        (path, kind, BAD)
        for path in EVERY
        if path not in live
        for kind in EVERY[path]
        if path not in ("joints.parquet",) and kind not in FORGED
    ] + [(path, kind, CRASHED) for path in live for kind in EVERY[path]]


def forged_pairs() -> list[tuple[str, str, str]]:
    return [(path, kind, BAD) for path in FORGED_IN for kind in FORGED]


def tried(
    kept: Path, home: Path, pairs: Pairs, those: list[tuple[str, str, str]]
) -> tuple[dict[str, list[Ended]], list[str]]:
    """Run all commands for each; return the answers by replacement, and the faults of some."""
    results: dict[str, list[Ended]] = defaultdict(list)
    wrong = []
    for path, kind, of in those:
        made = SPECIAL.get(kind) or EVERY[path][kind]
        place = None
        for verb in VERBS if of == BAD else VERBS_OF_CRASHED:
            if place is None or verb not in (
                "check",
                "runs",
                "trend",
                "compare",
                "where-used",
                "alarms",
                "start of the next run",
            ):
                place = spoilt(kept, home, path, made, of)
            ended = place.run(pairs, verb)
            what = "forged" if kind in FORGED else "bombs"
            results[kind if kind in SPECIAL else f"{what}: {path}"].append(ended)
            trouble = is_answer(place, verb, ended)
            if trouble:
                wrong.append(
                    f"{verb}, {path} of the {of} run is {kind} ({ended.seconds:.1f} s): {trouble}"
                )
    return results, wrong


def _slice(those: list[tuple[str, str, str]], part: str | None) -> list[tuple[str, str, str]]:
    """Return a part of a campaign, ``1/4``, if JBCLOG_PART asks for it."""
    if not part:
        return those
    number, parts = map(int, part.split("/"))
    return those[number - 1 :: parts]


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    "those",
    [special_pairs(), bomb_pairs(), forged_pairs()],
    ids=["special files", "bombs", "forged parts"],
)
def test_every_verb_answers_whatever_lies_in_a_run(
    kept: Path,
    tmp_path: Path,
    pairs: Pairs,
    those: list[tuple[str, str, str]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    results, wrong = tried(kept, tmp_path, pairs, _slice(those, os.environ.get("JBCLOG_PART")))
    with capsys.disabled():
        print("", *table(results), *wrong, sep="\n")
    assert wrong == []


SLICE = [
    (NAME, "link to /dev/zero", BAD),
    ("samples/part-0000.parquet", "many rows", BAD),
    (NAME, "t0_utc = 1e308", BAD),
    (NAME, "ended = no time", BAD),
    ("recipes/tht.toml", "dotted key", BAD),
    ("samples/part-0000.parquet", "nested station", BAD),
    ("samples/part-0000.parquet", "empty pages that all row groups share", BAD),
    ("samples/part-0000.parquet", "a station of its own in each row", BAD),
    ("settings/part-0000.parquet", "a header of two kinds", BAD),
    ("settings/part-0000.parquet", "columns by other names", BAD),
    ("events/part-0000.parquet", "a long word that the footer does not count", BAD),
    ("counters/part-0000.parquet", "2**31 - 1 words in a small dictionary", BAD),
    ("counters/part-0000.parquet", "texts of their own in each row", BAD),
    ("settings/part-0000.parquet", "a large row group", BAD),
    ("settings/part-0000.parquet", "row groups of one row", BAD),
    (WIRE_NAME, "heads in one another", BAD),
    ("live.sqlite", "endless views", CRASHED),
    ("live.lock", "pipe", CRASHED),
]


@pytest.mark.parametrize("one", SLICE, ids=lambda one: f"{one[0]} {one[1]}")
def test_a_slice_of_that(
    kept: Path, tmp_path: Path, pairs: Pairs, one: tuple[str, str, str]
) -> None:
    _, wrong = tried(kept, tmp_path, pairs, [one])
    assert wrong == []


@pytest.mark.parametrize("kind", ["socket", "pipe"])
def test_no_report_of_a_run_that_crashed_and_has_no_manifest(
    kept: Path, tmp_path: Path, kind: str
) -> None:
    place = spoilt(kept, tmp_path, NAME, SPECIAL[kind], CRASHED)
    with pytest.raises(RecordError, match="still open"):
        write_report(place.bad)


def test_a_report_of_a_run_whose_record_does_not_say_its_line(tmp_path: Path) -> None:
    """It crashed before it had a manifest: what made it is not known."""
    folder = few_rows.abandoned(tmp_path)
    recover(folder)
    assert "<dt>Line</dt><dd>not known</dd>" in write_report(folder).read_text(encoding="utf-8")


def test_the_paths_of_the_matrix_are_files_of_its_runs(kept: Path) -> None:
    """What is put beside a run's files is opened by few commands; a recipe once had another
    name.
    """
    runs = [path for name in (BAD, CRASHED) for path in (kept / name).iterdir() if path.is_dir()]
    there = {path for run in runs for path in (*PATHS, *EVERY) if (run / path).exists()}
    beside = {
        *("lease.json", "guard.jsonl", "damage.jsonl", "damaged", "wire", WIRE_NAME),
        *("live.reserve", "live.sqlite-wal", "live.lock", "guard.lock", "metrics.parquet"),
        "../verifications.jsonl",
    }
    assert {*PATHS, *EVERY} - there <= beside


SILENT = ("where-used", "audit --runs", "start of the next run")  # their answer does not need it


def test_one_bad_folder_is_a_finding_in_its_place(kept: Path, tmp_path: Path, pairs: Pairs) -> None:
    for verb in VERBS:
        place = spoilt(kept, tmp_path, NAME, os.mkfifo)
        ended = place.run(pairs, verb)
        assert is_answer(place, verb, ended) is None, (verb, ended)
        assert place.bad.name in ended.output or verb in SILENT or verb not in OF_A_FOLDER, (
            verb,
            ended,
        )


@pytest.mark.campaign
@pytest.mark.timeout(900)
def test_five_hundred_copies_of_one_run(
    kept: Path, tmp_path: Path, pairs: Pairs, counted: Callable[..., None]
) -> None:
    """A few lines for each, in time, and errors that count once."""
    place = Place(kept, tmp_path / "home")
    for number in range(500):
        name = f"20260101T00{number // 60:02d}{number % 60:02d}Z-bench-aaaa"
        shutil.copytree(place.good, place.runs / name, copy_function=os.link)
    words = {verb: words_of(verb, place.places) for verb in OF_A_FOLDER}
    ended = {verb: pairs.run(those) for verb, those in words.items()}
    with_one_line = {
        verb: replace(one, output=one.output.replace("\n", " ")) for verb, one in ended.items()
    }
    wrong = {verb: one.trouble for verb, one in with_one_line.items() if one.trouble}
    counted(commands_on_500_copies=len(ended), without_an_answer=len(wrong))
    assert wrong == {}


def _gone(path: Path) -> None:
    path.unlink(missing_ok=True)


def _longer(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b" " * 200_000)


REPLACED = {
    "pipe": SPECIAL["pipe"],
    "link to /dev/zero": SPECIAL["link to /dev/zero"],
    "gone": _gone,
    "longer": _longer,
}


@contextmanager
def replaced_without_end(path: Path, made: Callable[[Path], None]) -> Iterator[None]:
    """Swap the file and another one under its name repeatedly, as another program might."""
    data, new, is_over = path.read_bytes(), path.parents[2] / "new", threading.Event()

    def replace() -> None:
        while not is_over.is_set():
            with suppress(OSError):  # the command removes or makes it at the same time
                made(path) if made in (_gone, _longer) else put(path, made)
                new.write_bytes(data)
                new.replace(path)

    swapping = threading.Thread(target=replace)
    swapping.start()
    try:
        yield
    finally:
        is_over.set()
        swapping.join()


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", REPLACED)
@pytest.mark.parametrize(
    "path",
    [
        NAME,
        "annotations.jsonl",
        "samples/part-0000.parquet",
        "events/part-0000.parquet",
        "report.json",
        "recipes/tht.toml",
        "live.sqlite",
        "live.lock",
    ],
)
def test_every_verb_answers_while_a_file_is_replaced(
    kept: Path, tmp_path: Path, pairs: Pairs, path: str, kind: str
) -> None:
    of = CRASHED if path.startswith("live") else BAD
    wrong = []
    for verb in VERBS if of == BAD else VERBS_OF_CRASHED:
        place = Place(kept, tmp_path / "home", of)
        with replaced_without_end(place.bad / path, REPLACED[kind]):
            trouble = is_answer(place, verb, place.run(pairs, verb))
        if trouble:
            wrong.append(f"{verb}: {trouble}")
    assert wrong == []
