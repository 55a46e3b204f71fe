"""Mutation testing: a seeded sample of small changes of the code, each tried with the tests that cover its line.

::

    pip install coverage
    python tests/support/mutants.py cover WORK            # once: which test runs which line; some minutes
    python tests/support/mutants.py run WORK safety 600   # try mutants of a package for 600 s; again to go on
    python tests/support/mutants.py report WORK           # the share that was noticed, with its 95 % interval (Wilson)

A mutant is one changed place: a comparison, an operator, a number, a condition, a statement left out, a value returned.
Texts, types and imports are left alone. It is made in a copy of the repository below WORK, so that processes that tests start
have it, too. Tests are run quickest first, for as long as they usually take `MOST_S` altogether: a mutant that survives those
counts as survived. One that takes three times as long as usual is noticed. WORK/PACKAGE.jsonl holds what came of each, and is
gone on with. Real processes are not followed by the measuring of lines: what runs in the guard's alone is tried with the tests
in `SPAWNED`. Both make the share that is noticed smaller than it is, never greater.
"""

from __future__ import annotations

import ast
import copy
import json
import math
import os
import random
import shutil
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[2]
PACKAGES = ("session", "guard", "safety")
SAMPLE, SEED = 500, 20261122
MOST_S, SLOW_S = 45.0, 30.0
WITHIN = 12  # lines of a statement, of which the first is what is measured
COVERING = (
    *("tests/unit/guard", "tests/unit/safety", "tests/unit/drive/test_reactor.py", "tests/unit/test_guarding.py"),
    *("tests/unit/test_station_late.py", "tests/unit/test_what_can_heat.py", "tests/unit/record/test_left_hot.py", "tests/line"),
    *("tests/faults/test_left_hot.py", "tests/faults/test_link_faults.py", "tests/faults/test_wrong_answers.py"),
    *("tests/faults/test_disturbed_runs.py", "tests/faults/test_outside_bench.py", "tests/faults/test_nothing_is_decided.py"),
    *("tests/faults/test_every_witness.py", "tests/faults/test_starts.py", "tests/serial/test_safe.py"),
)
SPAWNED = {"guard": ["tests/faults/test_guard.py"]}
SPAWNED_S = 120.0
NOT_TRIED = "not tried"  # its tests are others by now: `cover` again


# -- mutants --------------------------------------------------------------------------------------------------------------------

COMPARE = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
COMPARE |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
OPERATE = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv}
OPERATE |= {ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr}
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}


def changes(node: ast.AST) -> Iterator[tuple[str, Any]]:
    """What may be done to a node: a word for it, and a function that does it to a copy and gives what stands there then."""
    match node:
        case ast.Compare(ops=[one]) if type(one) in COMPARE:
            yield COMPARE[type(one)].__name__, lambda new: (setattr(new, "ops", [COMPARE[type(new.ops[0])]()]), new)[1]
        case ast.BinOp(op=one) | ast.AugAssign(op=one) if type(one) in OPERATE:
            yield OPERATE[type(one)].__name__, lambda new: (setattr(new, "op", OPERATE[type(new.op)]()), new)[1]
        case ast.BoolOp():
            yield "and/or", lambda new: (setattr(new, "op", ast.Or() if isinstance(new.op, ast.And) else ast.And()), new)[1]
        case ast.UnaryOp(op=ast.Not()):
            yield "without not", lambda new: new.operand
        case ast.UnaryOp(op=ast.USub()):
            yield "without minus", lambda new: new.operand
        case ast.Constant(value=bool()):
            yield "other bool", lambda new: ast.Constant(not new.value)
        case ast.Constant(value=int() | float()):
            yield "plus 1", lambda new: ast.Constant(new.value + 1)
            if node.value:
                yield "zero", lambda new: ast.Constant(type(new.value)(0))
        case ast.If() | ast.IfExp() | ast.While(test=ast.Compare() | ast.BoolOp() | ast.Name() | ast.Attribute() | ast.Call()):
            yield "never", lambda new: (setattr(new, "test", ast.Constant(False)), new)[1]
            if not isinstance(node, ast.While):
                yield "always", lambda new: (setattr(new, "test", ast.Constant(True)), new)[1]
        case ast.Return(value=value) if value is not None and not (isinstance(value, ast.Constant) and value.value is None):
            yield "returns None", lambda new: ast.Return(ast.Constant(None))
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Assign(targets=[ast.Attribute() | ast.Subscript()]) | ast.AugAssign():
            yield "left out", lambda new: ast.Pass()
        case ast.Expr(value=ast.YieldFrom()):
            yield "left out", lambda new: ast.parse("if False:\n    yield").body[0]
        case ast.Continue():
            yield "break", lambda new: ast.Break()
        case ast.Break():
            yield "continue", lambda new: ast.Continue()
        case ast.Call(func=ast.Name(id=name)) if name in CALLS:
            yield CALLS[name], lambda new: (setattr(new.func, "id", CALLS[new.func.id]), new)[1]


class Places(ast.NodeVisitor):
    """All changes of a file, in order: (line, word, path of the node, number of the change)."""

    def __init__(self) -> None:
        self.found: list[tuple[int, str, int, int]] = []
        self._number = 0

    def generic_visit(self, node: ast.AST) -> None:
        number, self._number = self._number, self._number + 1
        for which, (word, _) in enumerate(changes(node)):
            self.found.append((getattr(node, "lineno", 0), word, number, which))
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "type_params", "decorator_list") or isinstance(node, ast.Import | ast.ImportFrom):
                continue
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, ast.AST):
                    self.visit(one)


class Change(ast.NodeTransformer):
    """Makes one change."""

    def __init__(self, number: int, which: int) -> None:
        self._left, self._which = number, which

    def generic_visit(self, node: ast.AST) -> Any:
        number, self._left = self._left, self._left - 1
        if number == 0:
            return ast.copy_location(list(changes(node))[self._which][1](copy.deepcopy(node)), node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "type_params", "decorator_list") or isinstance(node, ast.Import | ast.ImportFrom):
                continue
            if isinstance(value, list):
                setattr(node, name, [self.visit(one) if isinstance(one, ast.AST) else one for one in value])
            elif isinstance(value, ast.AST):
                setattr(node, name, self.visit(value))
        return node


def mutants_of(package: str) -> list[tuple[str, int, str, int, int]]:
    """Every mutant: file, line, word, node, change."""
    found = []
    for path in sorted((HERE / "jbclog" / package).glob("*.py")):
        places = Places()
        places.visit(ast.parse(path.read_text()))
        found += [(path.relative_to(HERE).as_posix(), *place) for place in places.found]
    return found


def mutated(path: Path, node: int, which: int) -> str:
    tree = Change(node, which).visit(ast.parse(path.read_text()))
    return ast.unparse(ast.fix_missing_locations(tree))


def sample(package: str) -> list[tuple[str, int, str, int, int]]:
    everything = mutants_of(package)
    return random.Random(f"{SEED} {package}").sample(everything, min(SAMPLE, len(everything)))


# -- which tests cover what -------------------------------------------------------------------------------------------------------


def copied(work: Path, name: str) -> Path:
    """A copy of the repository of one's own."""
    tree = work / name
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=HERE, capture_output=True, check=True, text=True).stdout
    for file in filter(None, listed.split("\0")):
        (tree / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(HERE / file, tree / file, follow_symlinks=False)
    return tree


def tests_in(tree: Path, words: list[str], limit_s: float, **more: str) -> tuple[int, float, str]:
    """Run these tests in the copy: the exit code (-1: too long), seconds, the end of what was said."""
    own = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tree), str(tree / "tests/support")]),
        "PYTHONDONTWRITEBYTECODE": "1",
        **more,
    }
    began = time.monotonic()
    command = [
        sys.executable,
        "-P",
        "-m",
        "pytest",
        "-n0",
        "-x",
        "-q",
        "--no-header",
        "--tb=line",
        "-p",
        "no:cacheprovider",
        *words,
    ]
    run = subprocess.Popen(
        command, cwd=tree, env=own, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    try:
        said, _ = run.communicate(timeout=limit_s)
        return run.returncode, time.monotonic() - began, said[-300:]
    except subprocess.TimeoutExpired:
        os.killpg(
            run.pid, 9
        )  # it has a session of its own, and all that it started is in it but for guards, which end by themselves
        run.communicate()
        return -1, time.monotonic() - began, "too long"


def cover(work: Path) -> None:
    """Measure which test runs which line, and how long each takes."""
    work.mkdir(parents=True, exist_ok=True)
    tree = copied(work, "tree")
    words = ["-p", "mutants", "--maxfail=1000", *(name for name in COVERING if (tree / name).exists())]
    code, seconds, said = tests_in(tree, words, 3600, MUTANTS_COVER=str(work / "cover.json"))
    print(f"{seconds:.0f} s, exit code {code}: {said}")


try:
    import pytest
except ImportError:
    pytest = None  # type: ignore[assignment]

if pytest is not None and os.environ.get("MUTANTS_COVER"):
    import coverage

    _measured = coverage.Coverage(data_file=None, include=[f"*/jbclog/{package}/*" for package in PACKAGES], config_file=False)
    _took: dict[str, float] = defaultdict(float)

    def pytest_configure() -> None:
        _measured.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(item: Any) -> Iterator[None]:
        _measured.switch_context(item.nodeid)
        return (yield)

    def pytest_runtest_logreport(report: Any) -> None:
        _took[report.nodeid] += report.duration
        if report.failed:
            _took[report.nodeid] += 1e6  # one that fails without any mutant proves nothing

    def pytest_unconfigure() -> None:
        _measured.stop()
        data, lines = _measured.get_data(), defaultdict(dict)
        for path in data.measured_files():
            name = Path(path).as_posix()
            lines[name[name.rindex("/jbclog/") + 1 :]] = {
                line: [one for one in tests if one] for line, tests in data.contexts_by_lineno(path).items()
            }
        Path(os.environ["MUTANTS_COVER"]).write_text(json.dumps({"lines": lines, "took": _took}))


def covering(known: dict[str, Any], name: str, line: int) -> list[str]:
    """The tests that run the line, quickest first; of one that no test runs, or that runs as it is loaded, those of its file."""
    took, lines = known["took"], known["lines"].get(name, {})
    line = next((before for before in range(line, max(line - WITHIN, 0), -1) if str(before) in lines), line)
    tests = set(lines.get(str(line), ()))
    if not tests:
        tests = {test for some in lines.values() for test in some}
    chosen, total = [], 0.0
    for test in sorted(tests, key=lambda test: took.get(test, 1e9)):
        total += took.get(test, 1e9)
        if total > MOST_S:
            break
        chosen.append(test)
    return chosen


# -- trying --------------------------------------------------------------------------------------------------------------


def run(work: Path, package: str, seconds: float) -> None:
    """Try mutants of the sample that have not been tried yet, for so long."""
    known, tree, results = json.loads((work / "cover.json").read_text()), copied(work, f"tree-{package}"), work / f"{package}.jsonl"
    before = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    done = {tuple(row["mutant"]) for row in before if row["outcome"] != NOT_TRIED}
    end = time.monotonic() + seconds
    for one in sample(package):
        if time.monotonic() > end:
            return
        if one not in done:
            outcome = tried(known, tree, package, one)
            with results.open("a") as file:
                file.write(json.dumps({"mutant": one, **outcome}) + "\n")
            print(outcome["outcome"], one, f"{outcome['seconds']:.1f} s", flush=True)


def tried(known: dict[str, Any], tree: Path, package: str, one: tuple[str, int, str, int, int]) -> dict[str, Any]:
    name, line, _, node, which = one
    tests = covering(known, name, line)
    spawned = SPAWNED.get(package, [])
    try:
        (tree / name).write_text(mutated(HERE / name, node, which))
        usual = sum(known["took"][test] for test in tests)
        code, seconds, said = (5, 0.0, "") if not tests else tests_in(tree, tests, 3 * usual + SLOW_S)
        if not tests and spawned:
            code, seconds, said = tests_in(tree, spawned, SPAWNED_S)
    finally:
        shutil.copy2(HERE / name, tree / name)
    outcome = {0: "survived", 4: NOT_TRIED, 5: "not covered"}.get(code, "noticed")
    return {"outcome": outcome, "code": code, "tests": len(tests), "seconds": round(seconds, 1), "said": said[-200:]}


# -- the score --------------------------------------------------------------------------------------------------------------


def wilson(hits: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    share, square = hits / count, z * z / count
    middle = (share + square / 2) / (1 + square)
    half = z / (1 + square) * math.sqrt(share * (1 - share) / count + square / (4 * count))
    return middle - half, middle + half


def report(work: Path) -> None:
    print("package: mutants, sample, tried, noticed, survived, not covered; share that was noticed, with its 95 % interval")
    for package in PACKAGES:
        path = work / f"{package}.jsonl"
        rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        rows = [row for row in rows if row["outcome"] != NOT_TRIED]
        count = Counter(row["outcome"] for row in rows)
        low, high = wilson(count["noticed"], len(rows))
        share = f"{count['noticed'] / len(rows):.0%} ({low:.0%} to {high:.0%})" if rows else "-"
        found = ", ".join(str(count[word]) for word in ("noticed", "survived", "not covered"))
        print(f"{package}: {len(mutants_of(package))}, {len(sample(package))}, {len(rows)}, {found}; {share}")
        for row in rows:
            if row["outcome"] != "noticed":
                name, line, word, *_ = row["mutant"]
                print(f"    {row['outcome']}: {name}:{line} {word}: {(HERE / name).read_text().splitlines()[line - 1].strip()}")


def main() -> None:
    match sys.argv[1:]:
        case ["cover", work]:
            cover(Path(work).resolve())
        case ["run", work, package, seconds]:
            run(Path(work).resolve(), package, float(seconds))
        case ["report", work]:
            report(Path(work).resolve())
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
