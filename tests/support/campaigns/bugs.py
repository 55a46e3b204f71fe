"""Mended bugs, put back one at a time: the tests that must notice each of them.

::

    python tests/support campaigns.bugs                 # every bug, on two workers
    python tests/support campaigns.bugs --slice 6       # six of them, others each day
    python tests/support campaigns.bugs --only safety   # those with this text in file or name
    python tests/support campaigns.bugs --wide tests/line tests/unit/protocol   # who else notices

tests/bugs/*.toml holds the bugs as data, a file for each package. A bug has a name, a sentence
(what a user would have seen), the commit that mended it, one place (a file, its text today and the
text with the bug), and the tests that must notice. The old text must stand exactly once in its
file, so it survives code that moves within a file.

All is done in copies of the tree, never in the tree itself. First the named tests run once without
any bug: they must pass. Then each bug is put into a copy, and each of its tests must fail: a test
function by at least one of its rows. The end is 0 only if all bugs were noticed, all places exist
and no test fails by itself. A test that fails to be collected has noticed nothing.

Where a place is gone, because the code was made anew, express the bug in the new code: what a user
would have seen stays, the text changes.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import venv
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import cache_from_source
from pathlib import Path
from queue import SimpleQueue

HERE = Path(__file__).resolve().parents[3]
BUGS = Path("tests/bugs")
WORKERS = 2
MOST_S = 120.0  # for one test, which takes some 20 s at most
OPTIONS = ["-n0", "-q", "-p", "no:cacheprovider", "--tb=no", "-rfEp", "--no-header"]
OPTIONS += ["--hypothesis-seed=0", f"--timeout={MOST_S}", "-m", "not bench and not soak"]
LINE = re.compile(r"^(PASSED|FAILED|ERROR) (tests/\S+?\.py(?:::.*?)?)(?: - .*)?$")
NOTICED, MISSED, GONE = "noticed", "not noticed", "place is gone"


@dataclass(frozen=True)
class Bug:
    """One mended bug: `old` is the text of `file` today, `new` the text with the bug."""

    name: str
    says: str
    mended: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    source: str  # the file in tests/bugs

    def places(self, tree: Path) -> int:
        """How often the old text stands in its file."""
        path = tree / self.file
        return path.read_text().count(self.old) if path.exists() else 0


@dataclass(frozen=True)
class Outcome:
    """What became of one bug: `failed` names the tests (with rows) that failed."""

    bug: Bug
    result: str
    text: str
    failed: tuple[str, ...]
    seconds: float

    def line(self) -> str:
        return f"{self.result:<14} {self.seconds:6.1f} s  {self.bug.name}{self.text}"


def read_bugs(tree: Path = HERE) -> list[Bug]:
    """Read all bugs. Raises `KeyError` or `ValueError` for one that is not complete."""
    bugs = []
    for path in sorted((tree / BUGS).glob("*.toml")):
        for entry in tomllib.loads(path.read_text())["bug"]:
            bug = Bug(
                name=entry["name"],
                says=entry["says"],
                mended=entry["mended"],
                file=entry["file"],
                old=entry["old"],
                new=entry["new"],
                tests=tuple(entry["tests"]),
                source=path.name,
            )
            bugs.append(bug)
    return bugs


def chosen(bugs: Sequence[Bug], count: int, seed: str) -> list[Bug]:
    """Choose `count` bugs by `seed`, in their order."""
    names = {bug.name for bug in random.Random(seed).sample(bugs, min(count, len(bugs)))}
    return [bug for bug in bugs if bug.name in names]


# -- copies of the tree, and pytest in them --------------------------------------------------------


def copy_tree(place: Path) -> Path:
    """Copy what git knows of this tree, as it stands here, and what is new and not ignored."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=HERE,
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    for name in filter(None, listing.split("\0")):
        source, target = HERE / name, place / name
        if source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target, follow_symlinks=False)
    make_environment(place)
    return place


def make_environment(tree: Path) -> None:
    """Give a tree an interpreter of its own, which imports the product from the tree: some tests
    start it with an empty environment, where PYTHONPATH would be lost.
    """
    venv.create(tree / ".venv", symlinks=True, with_pip=False)
    (site,) = (tree / ".venv" / "lib").glob("python*/site-packages")
    packages = [path for path in sys.path if Path(path).name == "site-packages"]
    (site / "tree.pth").write_text("\n".join([str(tree), *packages]) + "\n")


def run_tests(tree: Path, tests: Sequence[str]) -> dict[str, str]:
    """Run tests in a copy of the tree; return PASSED, FAILED or ERROR by node."""
    command = [
        str(tree / ".venv" / "bin" / "python"),
        "-m",
        "pytest",
        *OPTIONS,
        *tests,
    ]
    try:
        ended = subprocess.run(
            command,
            cwd=tree,
            capture_output=True,
            text=True,
            timeout=MOST_S * (1 + len(tests)),
        )
    except subprocess.TimeoutExpired:
        return {}
    results = {}
    for line in ended.stdout.splitlines():
        match = LINE.match(line)
        if match is not None:
            results[match[2]] = match[1]
    if not results:
        print(ended.stdout[-2000:], ended.stderr[-2000:], file=sys.stderr)
    return results


def rows_of(test: str, results: dict[str, str]) -> list[str]:
    """The results of a test, or of all rows of a test function."""
    rows = (node == test or node.startswith(f"{test}[") for node in results)
    return [result for result, is_row in zip(results.values(), rows, strict=True) if is_row]


@contextmanager
def put_back(bug: Bug, tree: Path) -> Iterator[None]:
    """Put a bug into a copy of the tree for a while."""
    path = tree / bug.file
    mended = path.read_text()
    write_code(path, mended.replace(bug.old, bug.new))
    try:
        yield
    finally:
        write_code(path, mended)


def write_code(path: Path, code: str) -> None:
    """Replace a module, and drop what was compiled of it: a compiled file counts as current as long
    as size and second of the source are the same.
    """
    path.write_text(code)
    Path(cache_from_source(path)).unlink(missing_ok=True)


def try_bug(bug: Bug, tree: Path, more: Sequence[str] = ()) -> Outcome:
    """Put one bug back and run its tests, and `more` tests that may notice as well."""
    begun = time.monotonic()
    places = bug.places(tree)
    if places != 1:
        text = f": its text stands {places} times in {bug.file}; express it in the new code"
        return Outcome(bug, GONE, text, (), 0.0)
    with put_back(bug, tree):
        results = run_tests(tree, [*bug.tests, *more])
    failed = tuple(node for node, result in results.items() if result == "FAILED")
    missed = [test for test in bug.tests if "FAILED" not in rows_of(test, results)]
    seconds = time.monotonic() - begun
    if missed:
        return Outcome(bug, MISSED, f": by {', '.join(missed)}", failed, seconds)
    return Outcome(bug, NOTICED, "", failed, seconds)


def failing_unpatched(tree: Path, bugs: Sequence[Bug]) -> list[str]:
    """The named tests that do not pass without any bug."""
    tests = sorted({test for bug in bugs for test in bug.tests})
    shares = [tests[number::WORKERS] for number in range(WORKERS)]
    with ThreadPoolExecutor(WORKERS) as pool:
        results: dict[str, str] = {}
        for share in pool.map(lambda names: run_tests(tree, names) if names else {}, shares):
            results |= share
    return [test for test in tests if set(rows_of(test, results)) != {"PASSED"}]


def try_all(bugs: Sequence[Bug], more: Sequence[str] = ()) -> int:
    """Try bugs on `WORKERS` copies of the tree; print what became of each; return the exit code."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="jbclog-bugs-") as place:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(WORKERS):
            trees.put(copy_tree(Path(place) / f"tree-{number}"))
        first = trees.get()
        failing = failing_unpatched(first, bugs)
        trees.put(first)
        for test in failing:
            print(f"fails without any bug: {test}")

        def try_one(bug: Bug) -> Outcome:
            tree = trees.get()
            try:
                outcome = try_bug(bug, tree, more)
            finally:
                trees.put(tree)
            print(outcome.line(), flush=True)
            if more:
                print(*(f"    {node}" for node in outcome.failed), sep="\n", flush=True)
            return outcome

        with ThreadPoolExecutor(WORKERS) as pool:
            outcomes = list(pool.map(try_one, bugs))
    noticed = sum(outcome.result == NOTICED for outcome in outcomes)
    seconds = time.monotonic() - begun
    print(f"{noticed} of {len(bugs)} bugs were noticed, in {seconds:.0f} s")
    return int(noticed < len(bugs) or bool(failing))


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="bugs", description="Put mended bugs back, one at a time."
    )
    parser.add_argument("--slice", type=int, metavar="N", help="only N bugs, by the seed")
    parser.add_argument("--seed", default=time.strftime("%Y-%m-%d"), help="default: the date")
    parser.add_argument(
        "--only", nargs="+", metavar="TEXT", help="only those with TEXT in file or name"
    )
    parser.add_argument("--wide", nargs="+", default=[], metavar="TEST", help="run these, too")
    given = parser.parse_args(arguments)
    bugs = read_bugs()
    if given.only is not None:
        bugs = [
            bug for bug in bugs if any(text in f"{bug.source} {bug.name}" for text in given.only)
        ]
    if given.slice is not None:
        bugs = chosen(bugs, given.slice, given.seed)
        print(f"seed {given.seed}: {', '.join(bug.name for bug in bugs)}")
    return try_all(bugs, given.wide)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
