"""Mutation testing: a seeded sample of small changes of the code, each tried with the tests that
cover its line.

::

    python tests/support campaigns.mutants cover WORK            # once: a copy of the tree, and which test runs which line; again to go on
    python tests/support campaigns.mutants cover WORK before-move ../before   # packages and tests of another scope, in another repository
    python tests/support campaigns.mutants run WORK safety,guard 600   # try mutants of these packages for 600 s; again to go on
    python tests/support campaigns.mutants run WORK safety,guard 600 40   # and those that survived again, with 40 s of tests
    python tests/support campaigns.mutants again WORK safety tests/unit/session/safety/test_secure.py   # survivors, tests of today
    python tests/support campaigns.mutants report WORK           # the share that was noticed, with its 95 % interval (Wilson)

A scope (`SCOPES`) names packages, their files and the tests that may cover them: `safety` (as above, if
none is named), `layers` for protocol, session and record, and `before-move` for the same three in the
last commit before the thirteen packages, 510f85a8. That commit asks for fpdf2 in addition.

A mutant is one changed place: a comparison, an operator, a number, a condition, a statement left
out, a value returned. Texts, types and imports are left alone. All is done in WORK/tree, a copy of
the repository as it was when its lines were measured, so that processes that tests start have the
mutant, too.

A process that has collected all tests forks for each mutant; there the code of the changed function
is replaced and the tests are run, cheapest first and each test function before its other
parameters, up to `MOST_S` of CPU time altogether: a mutant that survives those counts as survived.
What is changed outside functions (a constant, a default) is tried in a fork that has not imported
the project yet. A test that takes far longer than usual has noticed. A test that runs in real time
has to fail twice: a busy machine alone may fail it once. So the share that was noticed may be
smaller than it is with all tests, hardly greater. WORK/PACKAGE.jsonl holds the outcome of each.

`cover` and `run` may be ended at any time, and go on where they ended. `run` takes a mutant of each
package in turn, so that all have as many by then, but for one. SIGINT, SIGTERM or SIGHUP to the
tool end the trial in hand as well, with its process group, and put the file that it changed back.
After SIGKILL the trial runs to its end, and the next command puts the file back.
"""  # noqa: E501  # commands are copied as one line

from __future__ import annotations

import ast
import compileall
import copy
import fcntl
import functools
import gc
import importlib
import json
import math
import os
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any, Self

HERE = Path(__file__).resolve().parents[3]
SAMPLE, SEED = 500, 20261122
# a test that runs half of the lines of a file that others run has to be so much cheaper: 2 to this
THOROUGH = 4
MOST_S = 8.0  # of CPU time for a mutant
SIBLINGS = 6  # parameters of a test function that are used
SLOW_S, SLOW = 20.0, 5  # a test may take so long, and so many times as long as usual
CPU_S = 3  # and so much more CPU time than five times the usual: an endless loop ends by that
MORE_BYTES = 2 << 30
SAFETY_TESTS = (
    *(
        "tests/unit/guard",
        "tests/unit/session/safety",
        "tests/unit/transport/test_reactor.py",
        "tests/unit/guard/test_guarding.py",
    ),
    *(
        "tests/unit/protocol/client/test_station_late.py",
        "tests/unit/protocol/test_what_can_heat.py",
        "tests/unit/record/test_left_hot.py",
        "tests/line",
    ),
    *(
        "tests/unit/record/test_guarded.py",
        "tests/unit/cli/test_safe.py",
        "tests/unit/session/test_scheduler.py",
    ),
    *(
        "tests/faults/test_left_hot.py",
        "tests/line/test_link_faults.py",
        "tests/faults/test_wrong_answers.py",
    ),
    *(
        "tests/faults/test_disturbed_runs.py",
        "tests/faults/test_outside_bench.py",
        "tests/faults/test_nothing_is_decided.py",
    ),
    *(
        "tests/faults/test_every_witness.py",
        "tests/line/test_starts.py",
        "tests/serial/test_safe.py",
    ),
    *("tests/serial/test_take_over.py", "tests/faults/test_guard.py"),
)
# one rule for both: what mirrors a package, whole runs, and the verbs that use `session.manual`
COMMON_TESTS = (
    "tests/unit/record",
    "tests/line",
    *(f"tests/unit/cli/test_{name}.py" for name in ("read", "read_doubt", "write", "safe", "scan")),
)


@dataclass(frozen=True)
class Scope:
    """Packages, each with patterns of its files below `jbclog/`, and tests that may cover them."""

    packages: Mapping[str, Sequence[str]]
    tests: Sequence[str]
    without: Sequence[str] = ()

    def files(self, tree: Path, package: str) -> list[Path]:
        place = tree / "jbclog"
        found = {path for one in self.packages[package] for path in place.glob(one)}
        return sorted(found - {place / name for name in self.without})


SCOPES = {
    "safety": Scope(
        {
            "session": ("session/run/*.py",),
            "guard": ("guard/*.py",),
            "safety": ("session/safety/*.py",),
        },
        SAFETY_TESTS,
    ),
    "layers": Scope(
        {name: (f"{name}/**/*.py",) for name in ("protocol", "session", "record")},
        ("tests/unit/protocol", "tests/unit/session", *COMMON_TESTS),
    ),
    # what is in those three today, where it stood (`git diff -M 510f85a8 441fd285`), and its tests
    "before-move": Scope(
        {
            "protocol": ("protocol/*.py", "commands/*.py", "station/*.py"),
            "session": (
                *("session/*.py", "finding/*.py", "byhand/*.py", "safety/*.py"),
                "scheduler.py",
            ),
            "record": ("record/*.py",),
        },
        (
            *("tests/tables", "tests/wire", "tests/unit/finding", "tests/unit/safety"),
            *(
                f"tests/unit/test_{name}.py"
                for name in (
                    *("frame", "omega_frame", "omega_values", "what_can_heat", "after", "agreed"),
                    *("flow", "omega_station", "station", "station_forms", "station_late"),
                    *("turnaround", "scheduler", "losses"),
                )
            ),
            *COMMON_TESTS,
            # these are in tests/line today
            *(
                f"tests/faults/test_{name}.py"
                for name in ("link_faults", "omega_bits", "omega_sweep", "starts", "two_bits")
            ),
        ),
        # in core today
        without=("record/chained.py", "record/durable.py", "record/lock.py"),
    ),
}
REAL = (
    "tests/serial/",
    "tests/unit/guard/",
    "tests/faults/test_guard.py",
    "tests/faults/test_left_hot.py",
    "tests/unit/transport/",
)
REAL += ("tests/unit/record/", "tests/unit/cli/")
OPTIONS = (
    "-n0",
    "-q",
    "-s",
    "-p",
    "no:cacheprovider",
    "--no-header",
    "--tb=no",
    "--hypothesis-seed=0",
    "-m",
    "not campaign",
)
OPTIONS += ("-W", "ignore:Module already imported")
WARM = (
    "numpy",
    "pandas",
    "pyarrow.parquet",
    "pydantic",
    "typer.testing",
    "serial",
    "hypothesis",
    "pytest",
    "sqlite3",
)
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "ARROW_NUM_THREADS")
# in the environment of all that a test starts: what outlives the test is ended by it
MARK = "JBCLOG_MUTANT"
SCOPE = "scope"  # the file in WORK with its name
TRACE = "JBCLOG_MUTANTS_TRACE"
IN_HAND = "in-hand.json"  # the file that a mutant replaces, as it was
ENDED_BY = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Mutant = tuple[str, int, str, int, int]
"""File, line, word, number of the node, number of the change."""


# -- mutants ---------------------------------------------------------------------------------------

COMPARE = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
COMPARE |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
OPERATE = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
}
OPERATE |= {ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr}
UNTOUCHED = ("annotation", "returns", "type_params", "decorator_list")
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}


def changes(node: ast.AST) -> Iterator[tuple[str, Any]]:
    """What may be done to a node: a word for it, and a function that does it to a copy and gives
    what stands there then.
    """
    match node:
        case ast.Compare(ops=[one]) if type(one) in COMPARE:
            yield (
                COMPARE[type(one)].__name__,
                lambda new: (setattr(new, "ops", [COMPARE[type(new.ops[0])]()]), new)[1],
            )
        case ast.BinOp(op=one) | ast.AugAssign(op=one) if type(one) in OPERATE:
            yield (
                OPERATE[type(one)].__name__,
                lambda new: (setattr(new, "op", OPERATE[type(new.op)]()), new)[1],
            )
        case ast.BoolOp():
            yield (
                "and/or",
                lambda new: (
                    setattr(new, "op", ast.Or() if isinstance(new.op, ast.And) else ast.And()),
                    new,
                )[1],
            )
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
        case (
            ast.If()
            | ast.IfExp()
            | ast.While(
                test=ast.Compare() | ast.BoolOp() | ast.Name() | ast.Attribute() | ast.Call()
            )
        ):
            yield "never", lambda new: (setattr(new, "test", ast.Constant(False)), new)[1]
            if not isinstance(node, ast.While):
                yield "always", lambda new: (setattr(new, "test", ast.Constant(True)), new)[1]
        case ast.Return(value=value) if value is not None and not (
            isinstance(value, ast.Constant) and value.value is None
        ):
            yield "returns None", lambda new: ast.Return(ast.Constant(None))
        case (
            ast.Expr(value=ast.Call())
            | ast.Raise()
            | ast.Assign(targets=[ast.Attribute() | ast.Subscript()])
            | ast.AugAssign()
        ):
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
            if name in UNTOUCHED or isinstance(node, ast.Import | ast.ImportFrom):
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
            if name in UNTOUCHED or isinstance(node, ast.Import | ast.ImportFrom):
                continue
            if isinstance(value, list):
                setattr(
                    node,
                    name,
                    [self.visit(one) if isinstance(one, ast.AST) else one for one in value],
                )
            elif isinstance(value, ast.AST):
                setattr(node, name, self.visit(value))
        return node


def mutants_of(tree: Path, scope: Scope, package: str) -> list[Mutant]:
    found = []
    for path in scope.files(tree, package):
        places = Places()
        places.visit(ast.parse(path.read_text()))
        found += [(path.relative_to(tree).as_posix(), *place) for place in places.found]
    return found


def mutated(path: Path, node: int, which: int) -> ast.Module:
    return ast.fix_missing_locations(Change(node, which).visit(ast.parse(path.read_text())))


def sample(tree: Path, scope: Scope, package: str) -> list[Mutant]:
    everything = mutants_of(tree, scope, package)
    return random.Random(f"{SEED} {package}").sample(everything, min(SAMPLE, len(everything)))


def around(path: Path, number: int) -> list[tuple[ast.AST, str]]:
    """The nodes from the module to this one, and through which field it goes on; numbered as
    `Places` and `Change` do.
    """
    left = number

    def walk(node: ast.AST) -> list[tuple[ast.AST, str]]:
        nonlocal left
        left -= 1
        if left < 0:
            return [(node, "")]
        for field, value in ast.iter_fields(node):
            if field in UNTOUCHED or isinstance(node, ast.Import | ast.ImportFrom):
                continue
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, ast.AST) and (found := walk(one)):
                    return [(node, field), *found]
        return []

    return walk(ast.parse(path.read_text()))


def function_at(path: Path, number: int) -> tuple[str, int] | None:
    """Name and first line (of its decorators) of the outermost function in whose body this node is;
    None outside of functions.
    """
    name = ""
    for node, field in around(path, number):
        if isinstance(node, ast.ClassDef):
            name += f"{node.name}."
        if isinstance(node, ast.FunctionDef) and field == "body":
            return name + node.name, min(
                [node.lineno, *(one.lineno for one in node.decorator_list)]
            )
    return None


def statement_at(path: Path, number: int) -> range:
    """The lines of the innermost statement that this node is in, without those of the statements in
    it.
    """
    one = [
        node for node, _ in around(path, number) if isinstance(node, ast.stmt | ast.ExceptHandler)
    ][-1]
    inner = [
        child.lineno for child in ast.walk(one) if isinstance(child, ast.stmt) and child is not one
    ]
    return range(one.lineno, max(min([(one.end_lineno or one.lineno) + 1, *inner]), one.lineno + 1))


def called_as_it_loads(text: str) -> set[str]:
    """The functions whose work is done, in part, when their module is imported."""
    loads = [
        node
        for node in ast.parse(text).body
        if not isinstance(node, ast.FunctionDef | ast.ClassDef)
    ]
    calls = [call.func for node in loads for call in ast.walk(node) if isinstance(call, ast.Call)]
    return {name.id for name in calls if isinstance(name, ast.Name)}


# -- a copy, and children in it --------------------------------------------------------------------


def copied(work: Path, repository: Path) -> Path:
    """A copy of the repository of one's own; which commit it is of stands in `COMMIT`."""
    tree = work / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=repository, capture_output=True, check=True, text=True
    ).stdout
    for file in filter(None, listed.split("\0")):
        (tree / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(repository / file, tree / file, follow_symlinks=False)
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=repository,
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    (tree / "COMMIT").write_text(commit)
    compileall.compile_dir(tree / "jbclog", quiet=1)
    return tree


def scope_of(work: Path) -> Scope:
    path = work / SCOPE
    return SCOPES[path.read_text() if path.exists() else "safety"]


def begin(work: Path) -> None:
    """Be the only one to work in WORK as long as this process lives, and put right what a killed
    one has left there: a changed file, a part of a row.
    """
    lock = os.open(work / "lock", os.O_RDWR | os.O_CREAT)
    try:
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        sys.exit(f"another process works in {work}")
    restore(work)
    for path in work.glob("*.jsonl"):
        os.truncate(path, path.read_bytes().rfind(b"\n") + 1)


@contextmanager
def changed(work: Path, name: str, text: str) -> Iterator[None]:
    """Have `text` in this file of the tree for as long as the `with` lasts."""
    path, kept = work / "tree" / name, work / IN_HAND
    before = path.stat()
    times = [before.st_atime_ns, before.st_mtime_ns]  # by which compiled files are known
    aside = kept.with_suffix(".new")
    aside.write_text(json.dumps({"name": name, "text": path.read_text(), "times": times}))
    aside.replace(kept)
    try:
        path.write_text(text)
        yield
    finally:
        restore(work)


def restore(work: Path) -> None:
    """Put back what `changed` has replaced."""
    kept = work / IN_HAND
    if not kept.exists():
        return
    was = json.loads(kept.read_text())
    path = work / "tree" / was["name"]
    with suppress(FileNotFoundError):  # the tree was removed, to be copied anew
        path.write_text(was["text"])
        os.utime(path, ns=tuple(was["times"]))
    kept.unlink()


def whole_rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a file of JSON lines, without one that is being written."""
    text = path.read_text() if path.exists() else ""
    return [json.loads(row) for row in text[: text.rfind("\n") + 1].splitlines()]


def add_row(path: Path, row: Mapping[str, Any]) -> None:
    with path.open("a") as file:
        file.write(json.dumps(row) + "\n")


def interrupted(number: int, _frame: FrameType | None) -> None:
    """End the work here, once: what puts things right is not ended again."""
    for one in ENDED_BY:
        signal.signal(one, signal.SIG_IGN)
    raise KeyboardInterrupt(signal.Signals(number).name)


def end_when_asked() -> None:
    """Call `interrupted` on the signals of `ENDED_BY` that are not ignored (`nohup`)."""
    for number in ENDED_BY:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupted)


def take_signals_as_usual() -> None:
    """Undo `end_when_asked`: tests expect what a new process does."""
    for number in ENDED_BY:
        if signal.getsignal(number) is interrupted:
            usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, usual)


def enter(work: Path) -> None:
    """Be in the copy, with everything imported that is not the project's."""
    tree = work / "tree"
    site = work / "site"
    site.mkdir(exist_ok=True)
    program = HERE / "tests/support/campaigns/mutants.py"
    (site / "sitecustomize.py").write_text(
        f"import os, runpy\nif os.environ.get({TRACE!r}):\n   "
        f" runpy.run_path({str(program)!r})['traced_here']()\n"
    )
    os.chdir(tree)
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    os.environ |= {
        "PYTHONPATH": os.pathsep.join([str(tree), str(site)]),
        "HYPOTHESIS_STORAGE_DIRECTORY": str(work / "hypothesis"),
    }
    sys.path[:] = [
        str(tree),
        *(place for place in sys.path if Path(place).resolve() != Path(__file__).resolve().parent),
    ]
    for name in WARM:
        importlib.import_module(name)


def wanted(items: dict[str, Any], tests: Sequence[str]) -> list[Any]:
    """Those of these tests that there are, in their order; of a file, all."""
    return [
        item
        for test in tests
        for item in ([items[test]] if test in items else of_file(items, test))
    ]


def of_file(items: dict[str, Any], name: str) -> list[Any]:
    return [item for test, item in items.items() if test.startswith(f"{name}::")]


class Child:
    """A fork that runs tests and says so, line by line: ``begun NODEID``, ``failed NODEID``,
    ``done``.
    """

    def __init__(
        self, work: Path, act: Callable[[Callable[[str], None]], None], trace: Path | None = None
    ) -> None:
        self._place = work / f"child-{os.getpid()}"
        shutil.rmtree(self._place, ignore_errors=True)
        self._place.mkdir()
        self._lines = b""
        self._end, write = os.pipe()
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid:
            os.close(write)
            with suppress(OSError):  # here as well: it may not have begun when it is ended
                os.setpgid(self.pid, self.pid)
            return
        try:
            self._live(act, write, trace)
        finally:
            os._exit(9)

    def _live(
        self, act: Callable[[Callable[[str], None]], None], write: int, trace: Path | None
    ) -> None:
        # in the same session: where the system groups by session, its nice value holds
        os.setpgid(0, 0)
        take_signals_as_usual()
        quiet = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(quiet, number)
        sys.dont_write_bytecode = True
        os.environ |= {
            MARK: str(os.getpid()),
            "XDG_STATE_HOME": str(self._place / "state"),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        os.environ |= {"PYTEST_DEBUG_TEMPROOT": str(self._place)}
        if trace is not None:
            os.environ[TRACE] = str(trace)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + MORE_BYTES, size + MORE_BYTES))
        act(lambda text: os.write(write, f"{text}\n".encode()) and None)
        os._exit(0)

    def said(self, limit_s: Callable[[str], float]) -> Iterator[str]:
        """What it says, until its end or until it has been silent for longer than `limit_s` of its
        last words.
        """
        last, heard = "", b""
        while select.select([self._end], [], [], limit_s(last))[0]:
            if not (more := os.read(self._end, 65536)):
                break
            heard += more
            *lines, heard = heard.split(b"\n")
            for line in lines:
                last = line.decode()
                yield last

    def end(self) -> int:
        """End it with its process group, and all that was started in it; give how it ended."""
        os.close(self._end)
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        _, status, used = os.wait4(self.pid, 0)
        self.cpu_s = used.ru_utime + used.ru_stime
        mark = f"{MARK}={self.pid}".encode()
        for place in Path("/proc").iterdir():
            with suppress(OSError):
                if place.name.isdigit() and mark in (place / "environ").read_bytes().split(b"\0"):
                    os.kill(int(place.name), signal.SIGKILL)
        shutil.rmtree(self._place, ignore_errors=True)
        return status


def allow_cpu(seconds: float) -> None:
    """So much CPU time from now on, then SIGXCPU."""
    used = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + seconds), resource.RLIM_INFINITY))


def allowed(took: dict[str, list[float]], test: str) -> float:
    return SLOW * took.get(test, [10.0, 10.0])[1] + CPU_S


def patience(took: dict[str, list[float]]) -> Callable[[str], float]:
    return lambda last: SLOW_S + SLOW * took.get(last.partition(" ")[2], [20.0, 20.0])[0]


# -- which tests cover what ------------------------------------------------------------------------


def watch_lines(files: Set[str], note: Callable[[str, int], None]) -> None:
    """Call `note` once for each line of a function of these files that is run, with its file."""
    known: dict[CodeType, tuple[str, set[int]] | None] = {}

    def of(code: CodeType) -> tuple[str, set[int]] | None:
        name = code.co_filename[code.co_filename.rfind("/jbclog/") + 1 :]
        # 1: a function, no module and no class
        if not code.co_flags & 1 or name not in files:
            return None
        return name, {line for *_, line in code.co_lines() if line}

    def calls(frame: FrameType, event: str, arg: object) -> Any:
        code = frame.f_code
        if code not in known:
            known[code] = of(code)
        return lines if known[code] is not None and known[code][1] else None  # type: ignore[index]

    def lines(frame: FrameType, event: str, arg: object) -> Any:
        name, left = known[frame.f_code]  # type: ignore[misc]
        if event == "line" and frame.f_lineno in left:
            left.discard(frame.f_lineno)
            note(name, frame.f_lineno)
        return lines

    threading.settrace(calls)
    sys.settrace(calls)


def traced_here() -> None:
    """Write down what this process runs; called as a process that a test started begins."""
    trace = Path(os.environ[TRACE])
    file = os.open(trace, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    scope, tree = scope_of(trace.parent), trace.parent / "tree"
    files = [path for package in scope.packages for path in scope.files(tree, package)]
    watch_lines(
        {path.relative_to(tree).as_posix() for path in files},
        lambda name, line: os.write(file, f"{name}:{line}\n".encode()) and None,
    )


def chosen(items: Sequence[Any]) -> list[Any]:
    """Some parameters of each test function, spread over all of them."""
    groups = defaultdict(list)
    for item in items:
        groups[item.nodeid.partition("[")[0]].append(item)
    result = []
    for group in groups.values():
        count = min(len(group), SIBLINGS)
        result += [group[place * len(group) // count] for place in range(count)]
    return result


class Served:
    """A plugin of pytest: instead of running what was collected, `act` is called with it."""

    def __init__(self, act: Callable[[dict[str, Any]], None]) -> None:
        self._act = act

    def pytest_runtestloop(self, session: Any) -> bool:
        items = {} if session.testsfailed else {item.nodeid: item for item in session.items}
        gc.collect()
        gc.freeze()
        self._act(items)
        return True


def collected(act: Callable[[dict[str, Any]], None], words: Sequence[str]) -> None:
    import pytest

    pytest.main([*OPTIONS, *words], plugins=[Served(act)])


def one_by_one(
    items: Sequence[Any], took: dict[str, list[float]], say: Callable[[str], None]
) -> bool:
    """Run these; whether all passed. It ends with the first that did not."""
    from _pytest.runner import runtestprotocol

    for item, following in zip(items, [*items[1:], None], strict=True):
        say(f"begun {item.nodeid}")
        allow_cpu(allowed(took, item.nodeid))
        if any(report.failed for report in runtestprotocol(item, log=False, nextitem=following)):
            say(f"failed {item.nodeid}")
            return False
    return True


def cover(work: Path, scope: str = "safety", repository: Path = HERE) -> None:
    """Measure which test runs which line, and what each costs: seconds, and seconds of CPU time.

    What was copied and measured before stays: another commit takes another WORK.
    """
    work.mkdir(parents=True, exist_ok=True)
    begin(work)
    path, is_whole = work / "cover.jsonl", False
    if not (work / "tree/COMMIT").exists():
        path.unlink(missing_ok=True)
        (work / SCOPE).write_text(scope)
        copied(work, repository)
    enter(work)
    known = {row["test"] for row in whole_rows(path)}

    def measure(items: dict[str, Any]) -> None:
        nonlocal is_whole
        for item in chosen(list(items.values())):
            if item.nodeid not in known:
                add_row(path, measured(work, item))
        is_whole = bool(items)

    collected(measure, [name for name in scope_of(work).tests if Path(name).exists()])
    if not is_whole:
        sys.exit("not all tests were measured")
    rows = [row for row in whole_rows(path) if row["took"]]
    lines: dict[str, dict[int, list[str]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for place in row["ran"]:
            name, _, line = place.rpartition(":")
            lines[name][int(line)].append(row["test"])
    took = {row["test"]: row["took"] for row in rows}
    (work / "cover.json").write_text(json.dumps({"lines": lines, "took": took}))
    print(f"{len(took)} tests, {sum(cpu for _, cpu in took.values()):.0f} s of CPU time")


def measured(work: Path, item: Any) -> dict[str, Any]:
    """The lines that this test runs, and what it costs; None where it fails while it is watched."""
    trace = work / "trace"
    trace.write_text("")
    began, cpu = time.monotonic(), None

    def act(say: Callable[[str], None]) -> None:
        traced_here()
        if one_by_one([item], {item.nodeid: [99.0, 99.0]}, say):
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            say(f"done {time.process_time() + used.ru_utime + used.ru_stime}")

    child = Child(work, act, trace)
    try:
        for text in child.said(lambda _: 100.0):
            if text.startswith("done "):
                cpu = float(text.split()[1])
    finally:
        status = child.end()
    if cpu is None:
        print("left out", item.nodeid, status, flush=True)
        return {"test": item.nodeid, "took": None, "ran": []}
    took = [round(time.monotonic() - began, 3), round(cpu, 3)]
    return {"test": item.nodeid, "took": took, "ran": sorted(set(trace.read_text().split()))}


@functools.cache
def defined(text: str) -> Mapping[int, frozenset[str]]:
    """For each line outside of functions, what the statement of the module that it is in defines: a
    class, or names that are assigned.
    """
    found: dict[int, frozenset[str]] = {}
    for node in ast.parse(text).body:
        names: list[str] = []
        if isinstance(node, ast.ClassDef):
            names = [node.name]
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            inner = [one for target in targets for one in ast.walk(target)]
            names = [one.id for one in inner if isinstance(one, ast.Name)]
        lines = set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        for one in node.body if isinstance(node, ast.ClassDef) else []:
            if isinstance(one, ast.FunctionDef):
                lines -= set(range(one.lineno, (one.end_lineno or one.lineno) + 1))
        found |= dict.fromkeys(lines, frozenset(names))
    return found


def lines_of(
    tree: Path, name: str, line: int, covered: Mapping[str, Mapping[str, object]]
) -> list[tuple[str, int]]:
    """The lines where a change of this line outside of functions shows: for a class, or a statement
    that defines no name, its file's; else where its name is used. If no test runs one of those,
    where a name is used that is made from it, and so on.
    """
    texts = {file: (tree / file).read_text() for file in sorted({name, *covered})}
    left = defined(texts[name]).get(line, frozenset())
    names = left
    is_class = any(
        isinstance(node, ast.ClassDef) and node.lineno <= line <= (node.end_lineno or line)
        for node in ast.parse(texts[name]).body
    )
    found = (
        [(name, number) for number in range(1, texts[name].count("\n") + 1)]
        if is_class or not left
        else []
    )
    while left and not any(str(number) in covered.get(file, ()) for file, number in found):
        word = re.compile(r"\b(" + "|".join(sorted(left)) + r")\b")
        more = [
            (file, number)
            for file, text in texts.items()
            for number, row in enumerate(text.splitlines(), 1)
            if word.search(row)
        ]
        found += more
        made = [defined(texts[file]).get(number, frozenset()) for file, number in more]
        left = frozenset().union(*made) - names
        names |= left
    return found


def covering(
    known: dict[str, Any], tree: Path, mutant: Mutant, noticed: Counter[str], most_s: float = MOST_S
) -> list[str]:
    """The tests that run the line, cheapest first; other parameters of the same test later, those
    that noticed much, and those that run more of the file, earlier.
    """
    name, line, _, node, _ = mutant
    took, lines = known["took"], known["lines"]
    is_within = function_at(tree / name, node) is not None
    within = [(name, number) for number in statement_at(tree / name, node)]
    places = within if is_within else lines_of(tree, name, line, lines)
    tests = {test for place, number in places for test in lines.get(place, {}).get(str(number), ())}
    if not tests and not is_within:  # a default of a field, say
        tests = {test for some in lines.get(name, {}).values() for test in some}
    cost = {test: max(took[test][1], took[test][0] / 4) for test in tests}
    siblings: Counter[str] = Counter()
    runs = Counter(test for some in lines.get(name, {}).values() for test in some)
    thorough = max(runs.values(), default=1)
    order = {}
    for test in sorted(tests, key=lambda test: cost[test]):
        function = test.partition("[")[0]
        siblings[function] += 1
        order[test] = (
            cost[test]
            * siblings[function]
            / (1 + noticed[test])
            * (thorough / max(runs[test], 1)) ** THOROUGH
        )
    result, total = [], 0.0
    for test in sorted(order, key=lambda test: order[test]):
        if result and total + cost[test] > most_s:
            continue
        total += cost[test]
        result.append(test)
    return result


# -- trying ----------------------------------------------------------------------------------------


class Trial:
    """Tries mutants, each in a child: of one that has collected the tests, or of this process,
    which has not even imported the project.
    """

    def __init__(self, work: Path, known: dict[str, Any], words: Sequence[str]) -> None:
        self.work, self.tree, self.took = work, work / "tree", known["took"]
        ask, self._ask = os.pipe()
        self._answer, answer = os.pipe()
        self._warm = os.fork()
        if not self._warm:
            os.close(self._ask)
            os.close(self._answer)
            try:
                collected(
                    lambda items: self._serve(items, ask, answer),
                    [name for name in words if Path(name).exists()],
                )
            finally:
                os._exit(0)
        os.close(ask)
        os.close(answer)
        self._answers = os.fdopen(self._answer, "r")

    def __enter__(self) -> Self:
        try:
            if not self._answers.readline():
                sys.exit("the tests could not be collected")
        except BaseException:
            self._end(signal.SIGTERM)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(None if kind is None else signal.SIGTERM)

    def _end(self, how: signal.Signals | None) -> None:
        """End the process that has collected, with the trial that it is at where `how` says so."""
        if how is not None:
            os.kill(self._warm, how)
        os.close(self._ask)
        self._answers.close()
        os.waitpid(self._warm, 0)

    def outcome(self, mutant: Mutant, tests: Sequence[str]) -> dict[str, Any]:
        """Its result. Done again with the test alone that noticed, where that runs in real time."""
        began, self._cpu_s = time.monotonic(), 0.0
        name, _, _, node, which = mutant
        path, left = self.tree / name, list(tests)
        text, function = path.read_text(), function_at(path, node)
        code = (
            None
            if function is None or function[0] in called_as_it_loads(text)
            else (str(path), *function, node, which)
        )
        by, why = "", ""
        with changed(self.work, name, ast.unparse(mutated(path, node, which))):
            while left:
                by, why = self._tried(code, text, left)
                if not by or not by.startswith(REAL):
                    break
                if self._tried(code, text, [by])[0]:
                    break
                left, by, why = left[left.index(by) + 1 :], "", ""
        word = "not covered" if not tests else "noticed" if by else "survived"
        seconds = round(time.monotonic() - began, 1)
        return {
            "outcome": word,
            "by": by,
            "why": why,
            "tests": len(tests),
            "seconds": seconds,
            "cpu": round(self._cpu_s, 2),
        }

    def _tried(
        self, code: tuple[str, str, int, int, int] | None, text: str, tests: Sequence[str]
    ) -> tuple[str, str]:
        if code is None:
            by, why, cpu = judged(Child(self.work, lambda say: self._cold(tests, say)), self.took)
            self._cpu_s += cpu
            return by, why
        os.write(self._ask, (json.dumps([code, text, list(tests)]) + "\n").encode())
        by, why, cpu = json.loads(self._answers.readline())
        self._cpu_s += cpu
        return by, why

    def _cold(self, tests: Sequence[str], say: Callable[[str], None]) -> None:
        def act(items: dict[str, Any]) -> None:
            if items and one_by_one(wanted(items, tests), self.took, say):
                say("done")
                os._exit(0)
            if items:
                os._exit(1)

        collected(act, list(dict.fromkeys(test.partition("::")[0] for test in tests)))
        say("failed to collect")
        os._exit(0)

    def _serve(self, items: dict[str, Any], ask: int, answer: int) -> None:
        if not items:
            return
        gc.unfreeze()
        functions: dict[tuple[str, str, int], list[FunctionType]] = defaultdict(list)
        for one in gc.get_objects():
            if isinstance(one, FunctionType) and one.__code__.co_filename.startswith(
                str(self.tree / "jbclog")
            ):
                functions[
                    one.__code__.co_filename, one.__code__.co_qualname, one.__code__.co_firstlineno
                ].append(one)
        gc.collect()
        gc.freeze()
        os.write(answer, b"ready\n")
        for line in os.fdopen(ask, "r"):
            (file, name, first, node, which), text, tests = json.loads(line)

            def act(say: Callable[[str], None]) -> None:
                tree = ast.fix_missing_locations(Change(node, which).visit(ast.parse(text)))  # noqa: B023
                made = [*codes(compile(tree, file, "exec"))]  # noqa: B023
                there = [(one.co_qualname, one.co_firstlineno) for one in made]
                code = made[there.index((name, first))]  # noqa: B023
                for one in functions[file, name, first]:  # noqa: B023
                    one.__code__ = code
                if one_by_one(wanted(items, tests), self.took, say):  # noqa: B023
                    say("done")

            # no test has it
            found = (
                judged(Child(self.work, act), self.took)
                if functions[file, name, first]
                else ("", "", 0.0)
            )
            os.write(answer, (json.dumps(found) + "\n").encode())


def codes(code: CodeType) -> Iterator[CodeType]:
    """This and all within."""
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from codes(one)


def judged(child: Child, took: dict[str, list[float]]) -> tuple[str, str, float]:
    """The test that noticed, and how, both empty where all passed; seconds of CPU time."""
    last = "begun nothing"
    try:
        for text in child.said(patience(took)):
            last = text
    finally:
        status = child.end()
    test = last.partition(" ")[2]
    if last == "done":
        return "", "", child.cpu_s
    if last.startswith("failed "):
        return test, "failed", child.cpu_s
    is_killed = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGKILL, signal.SIGXCPU)
    return test, "too long" if is_killed else f"ended by {status}", child.cpu_s


def rows_of(work: Path, package: str) -> list[dict[str, Any]]:
    """The result of each mutant, at the last try."""
    rows = whole_rows(work / f"{package}.jsonl")
    return list({tuple(row["mutant"]): row for row in rows}.values())


def in_turn(mutants: Mapping[str, Sequence[Mutant]]) -> Iterator[tuple[str, Mutant]]:
    """Yield one of each package, then the next of each."""
    each = [[(package, one) for one in some] for package, some in mutants.items()]
    return filter(None, chain.from_iterable(zip_longest(*each)))


def run(work: Path, packages: Sequence[str], seconds: float, most_s: float = MOST_S) -> None:
    """Try mutants of the samples that have not been tried yet, or survived less than this, of each
    package in turn, for so long. A package that was tried less comes first.
    """
    begin(work)
    known, tree, end = (
        json.loads((work / "cover.json").read_text()),
        work / "tree",
        time.monotonic() + seconds,
    )
    before = [row for package in packages for row in rows_of(work, package)]
    done = {
        tuple(row["mutant"])
        for row in before
        if row["outcome"] == "noticed" or row.get("most_s", MOST_S) >= most_s
    }
    noticed: dict[str, Counter[str]] = defaultdict(Counter)
    for row in before:
        noticed[row["mutant"][0]][row["by"]] += 1
    scope = scope_of(work)
    samples = {package: sample(tree, scope, package) for package in packages}
    enter(work)
    with Trial(work, known, scope.tests) as trial:
        for package, one in in_turn(samples):
            if one in done:
                continue
            if time.monotonic() > end:
                break
            outcome = trial.outcome(one, covering(known, tree, one, noticed[one[0]], most_s))
            noticed[one[0]][outcome["by"]] += 1
            add_row(work / f"{package}.jsonl", {"mutant": one, "most_s": most_s, **outcome})
            print(
                *(outcome["outcome"], one, outcome["seconds"], outcome["cpu"], outcome["by"]),
                flush=True,
            )


def again(work: Path, package: str, words: Sequence[str]) -> None:
    """Try those that survived with tests as they are in the repository by now; what notices one is
    written to its row.
    """
    begin(work)
    tree, rows = work / "tree", rows_of(work, package)
    for path in [*(HERE / "tests/support").rglob("*.py"), *(HERE / word for word in words)]:
        shutil.copy2(path, tree / path.relative_to(HERE))
    enter(work)
    with Trial(work, {"took": {}}, words) as trial:
        for row in rows:
            if row["outcome"] != "noticed" and not row.get("since"):
                row["since"] = trial.outcome(tuple(row["mutant"]), words)["by"]
                print(row["mutant"], row["since"], flush=True)
    (work / f"{package}.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


# -- the score -------------------------------------------------------------------------------------


def wilson(hits: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    share, square = hits / count, z * z / count
    middle = (share + square / 2) / (1 + square)
    half = z / (1 + square) * math.sqrt(share * (1 - share) / count + square / (4 * count))
    return middle - half, middle + half


def report(work: Path) -> None:
    print(
        "package: mutants, sample, tried, noticed, survived, not covered; share that was noticed,"
        " with its 95 % interval"
    )
    scope, tree = scope_of(work), work / "tree"
    for package in scope.packages:
        rows = rows_of(work, package)
        count = Counter(row["outcome"] for row in rows)
        low, high = wilson(count["noticed"], len(rows))
        share = f"{count['noticed'] / len(rows):.0%} ({low:.0%} to {high:.0%})" if rows else "-"
        found = ", ".join(str(count[word]) for word in ("noticed", "survived", "not covered"))
        print(
            f"{package}: {len(mutants_of(tree, scope, package))},"
            f" {len(sample(tree, scope, package))},"
            f" {len(rows)}, {found}; {share}"
        )
        for row in rows:
            if row["outcome"] != "noticed":
                name, line, word, *_ = row["mutant"]
                print(
                    f"    {row['outcome']}: {name}:{line} {word}:"
                    f" {(tree / name).read_text().splitlines()[line - 1].strip()}"
                )


def main() -> None:
    end_when_asked()
    try:
        act()
    except KeyboardInterrupt as signalled:
        sys.exit(f"ended by {signalled}; the same command goes on")


def act() -> None:
    match sys.argv[1:]:
        case ["cover", work]:
            cover(Path(work).resolve())
        case ["cover", work, scope]:
            cover(Path(work).resolve(), scope)
        case ["cover", work, scope, repository]:
            cover(Path(work).resolve(), scope, Path(repository).resolve())
        case ["run", work, packages, seconds, *most]:
            run(Path(work).resolve(), packages.split(","), float(seconds), *map(float, most))
        case ["again", work, package, *words]:
            again(Path(work).resolve(), package, words)
        case ["report", work]:
            report(Path(work).resolve())
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
