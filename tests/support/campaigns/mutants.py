"""Mutation testing: small changes of the code, each tried with the tests that run its line.

::

    .ci/mutants                               # every package, from nothing; again to go on
    .ci/mutants --package guard --seconds 600
    .ci/mutants --again survivors             # try once more what survived, or all of it
    .ci/mutants --report                      # the score by package, and what changed since HEAD
    .ci/mutants --report --against 0422b429

A mutant is one changed place: a comparison, an operator, a number, a condition, a statement left
out, a value returned. Texts, types and imports are left alone. It is known by its file, its
function (class and outermost function; outside of functions, class and name that is assigned), what
is done (`LtE`, `left out`), and its number among those of the same kind there: results survive
lines that move. Of a package those are tried whose identity, hashed with the seed, comes first:
most mutants of tomorrow's code are those of today. `tests/data/mutants/PACKAGE.csv` keeps what
came out.

All is done in WORK/tree, a copy of the repository, so that processes that tests start have the
mutant, too. First each test of a group of packages (`GROUPS`) runs once, watched: which lines it
runs, and what it costs. The copy and what was measured are made anew when code or tests change.

A process that has collected all tests forks for each mutant; there the code of the changed function
is replaced and the tests are run, cheapest first and each test function before its other
parameters, up to `MOST_S` of CPU time altogether: a mutant that survives those counts as survived.
The test that noticed it at HEAD comes first. What is changed outside functions (a constant, a
default) is tried in a fork that has not imported the project yet. A test that takes far longer than
usual has noticed. A test that runs in real time has to fail twice: a busy machine alone may fail it
once. So the share that was noticed may be smaller than it is with all tests, hardly greater.

The tool may be ended at any time, and continues where it ended. It takes a mutant of each package
of a group in turn. SIGINT, SIGTERM or SIGHUP end the trial in hand as well, with its process group,
and put the file that it changed back. After SIGKILL the trial runs to its end, and the next command
puts the file back.
"""

from __future__ import annotations

import argparse
import ast
import compileall
import csv
import fcntl
import functools
import gc
import hashlib
import importlib
import itertools
import json
import math
import os
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
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any, NamedTuple, Self

HERE = Path(__file__).resolve().parents[3]
DATA = HERE / "tests/data/mutants"
SEED = 20261122
# a test that runs half of the lines of a file that others run has to be so much cheaper: 2 to this
THOROUGH = 4
MOST_S = 4.0  # of CPU time for a mutant
SIBLINGS = 6  # parameters of a test function that are used
SLOW_S, SLOW = 20.0, 5  # a test may take so long, and so many times as long as usual
CPU_S = 3  # and so much more CPU time than five times the usual: an endless loop ends by that
MORE_BYTES = 2 << 30


@dataclass(frozen=True)
class Package:
    """A folder below `jbclog/` without some of it, the number of its mutants that are tried (None:
    all), and the tests that may notice them.
    """

    folder: str
    most: int | None
    tests: Sequence[str]
    without: str = "-"

    def files(self, tree: Path) -> list[Path]:
        found = (tree / "jbclog" / self.folder).rglob("*.py")
        return sorted(path for path in found if not path.is_relative_to(tree / self.without))


SAFETY_TESTS = (
    "tests/unit/session/safety",
    "tests/unit/guard",
    "tests/unit/session/test_scheduler.py",
    "tests/unit/record/test_left_hot.py",
    "tests/unit/record/test_guarded.py",
    "tests/line/test_safe_state.py",
    "tests/unit/protocol/client/test_station_late.py",
    "tests/unit/transport/test_reactor.py",
)
GUARD_TESTS = (*SAFETY_TESTS, "tests/unit/cli/test_safe.py", "tests/serial/test_take_over.py")
LAYER_TESTS = ("tests/unit/protocol", "tests/unit/session", "tests/line", "tests/unit/record")
OTHERS = (
    *("analysis", "app", "cli", "config", "core", "live", "maintenance", "report", "sim"),
    "transport",
)
PACKAGES = {
    "safety": Package("session/safety", None, SAFETY_TESTS),
    "guard": Package("guard", None, GUARD_TESTS),
    "protocol": Package("protocol", 500, LAYER_TESTS),
    "session": Package("session", 500, LAYER_TESTS, without="jbclog/session/safety"),
    "record": Package("record", 500, LAYER_TESTS),
    **{name: Package(name, 100, (f"tests/unit/{name}",)) for name in OTHERS},
}
GROUPS = (("safety", "guard"), ("protocol", "session", "record"), OTHERS)
REAL = (
    "tests/serial/",
    *(f"tests/unit/{name}/" for name in ("cli", "guard", "record", "transport")),
)
OPTIONS = ["-n0", "-q", "-s", "-p", "no:cacheprovider", "--no-header", "--tb=no"]
OPTIONS += ["--hypothesis-seed=0", "-m", "not campaign", "-W", "ignore:Module already imported"]
WARM = ["numpy", "pandas", "pyarrow.parquet", "pydantic", "typer.testing", "serial", "hypothesis"]
WARM += ["pytest"]
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "ARROW_NUM_THREADS")
# in the environment of all that a test starts: what outlives the test is ended by it
MARK = "JBCLOG_MUTANT"
TRACE = "JBCLOG_MUTANTS_TRACE"
IN_HAND = "in-hand.json"  # the file that a mutant replaces, as it was
ENDED_BY = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


# -- mutants ---------------------------------------------------------------------------------------

PAIRS = (
    (ast.Lt, ast.LtE),
    (ast.Gt, ast.GtE),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
    (ast.In, ast.NotIn),
)
COMPARE = dict(PAIRS) | {second: first for first, second in PAIRS}
OPERATE = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
OPERATE |= {ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv}
OPERATE |= {ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr}
UNTOUCHED = ("annotation", "returns", "type_params", "decorator_list")
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}


def with_(field: str, value: Any) -> Callable[[ast.AST], ast.AST]:
    """A function that gives a node this field."""

    def act(node: ast.AST) -> ast.AST:
        setattr(node, field, value)
        return node

    return act


def changes(node: ast.AST) -> Iterator[tuple[str, Any]]:
    """What may be done to a node: a word for it, and a function that does it and gives what stands
    there then.
    """
    match node:
        case ast.Compare(ops=[operator]) if type(operator) in COMPARE:
            other = COMPARE[type(operator)]
            yield other.__name__, with_("ops", [other()])
        case ast.BinOp(op=operator) | ast.AugAssign(op=operator) if type(operator) in OPERATE:
            yield OPERATE[type(operator)].__name__, with_("op", OPERATE[type(operator)]())
        case ast.BoolOp(op=operator):
            yield "and/or", with_("op", ast.Or() if isinstance(operator, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not()):
            yield "without not", lambda old: old.operand
        case ast.UnaryOp(op=ast.USub()):
            yield "without minus", lambda old: old.operand
        case ast.Constant(value=bool()):
            yield "other bool", lambda old: ast.Constant(not old.value)
        case ast.Constant(value=int() | float()):
            yield "plus 1", lambda old: ast.Constant(old.value + 1)
            if node.value:
                yield "zero", lambda old: ast.Constant(type(old.value)(0))
        case (
            ast.If()
            | ast.IfExp()
            | ast.While(
                test=ast.Compare() | ast.BoolOp() | ast.Name() | ast.Attribute() | ast.Call()
            )
        ):
            yield "never", with_("test", ast.Constant(False))
            if not isinstance(node, ast.While):
                yield "always", with_("test", ast.Constant(True))
        case ast.Return(value=value) if value is not None and not (
            isinstance(value, ast.Constant) and value.value is None
        ):
            yield "returns None", lambda _: ast.Return(ast.Constant(None))
        case (
            ast.Expr(value=ast.Call() | ast.Await())
            | ast.Raise()
            | ast.Assign(targets=[ast.Attribute() | ast.Subscript()])
            | ast.AugAssign()
        ):
            yield "left out", lambda _: ast.Pass()
        case ast.Expr(value=ast.YieldFrom()):
            yield "left out", lambda _: ast.parse("if False:\n    yield").body[0]
        case ast.Continue():
            yield "break", lambda _: ast.Break()
        case ast.Break():
            yield "continue", lambda _: ast.Continue()
        case ast.Call(func=ast.Name(id=name)) if name in CALLS:
            yield CALLS[name], with_("func", ast.Name(CALLS[name], ast.Load()))


Identity = tuple[str, str, str, str]
"""File, function, operator and number of a mutant."""


class Mutant(NamedTuple):
    """One change of one place."""

    file: str
    function: str  # its class and outermost function; else class and name that is assigned
    operator: str
    number: int  # among those of the same kind in this function, from 1
    line: int
    node: int  # its number in the file, as `ways` counts
    change: int  # its number among the `changes` of the node

    @property
    def identity(self) -> Identity:
        return self.file, self.function, self.operator, str(self.number)


Way = Sequence[tuple[ast.AST, str]]
"""The nodes from the module to one, each with the field of its parent that it stands in."""


def ways(tree: ast.Module) -> Iterator[Way]:
    """The way to each node that may be changed, in order."""

    def below(way: Way) -> Iterator[Way]:
        yield way
        node = way[-1][0]
        if isinstance(node, ast.Import | ast.ImportFrom):
            return
        for field, value in ast.iter_fields(node):
            if field in UNTOUCHED:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from below([*way, (child, field)])

    return below([(tree, "")])


def way_to(tree: ast.Module, number: int) -> Way:
    return next(itertools.islice(ways(tree), number, None))


def function_of(way: Way) -> str:
    names = []
    for node, _ in way:
        match node:
            case ast.ClassDef(name=name):
                names.append(name)
            case (
                ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
                | ast.Assign(targets=[ast.Name(id=name), *_])
                | ast.AnnAssign(target=ast.Name(id=name))
            ):
                names.append(name)
                break
    return ".".join(names)


def mutants_of(tree: Path, path: Path) -> list[Mutant]:
    """All mutants of a file, in order."""
    file = path.relative_to(tree).as_posix()
    kinds: Counter[tuple[str, str]] = Counter()
    found = []
    for node, way in enumerate(ways(ast.parse(path.read_text()))):
        function = function_of(way)
        line = getattr(way[-1][0], "lineno", 0)
        for change, (operator, _) in enumerate(changes(way[-1][0])):
            kinds[function, operator] += 1
            number = kinds[function, operator]
            found.append(Mutant(file, function, operator, number, line, node, change))
    return found


def mutated(text: str, number: int, change: int) -> ast.Module:
    """The code with this change of this node."""
    tree = ast.parse(text)
    *_, (parent, _), (node, field) = way_to(tree, number)
    new = list(changes(node))[change][1](node)
    if new is not node:
        ast.copy_location(new, node)
        value = getattr(parent, field)
        if isinstance(value, list):
            value[value.index(node)] = new
        else:
            setattr(parent, field, new)
    return ast.fix_missing_locations(tree)


def everything(tree: Path, package: str) -> list[Mutant]:
    """All mutants of a package, drawn by the hash of their identity: the first n are a sample."""
    files = PACKAGES[package].files(tree)
    found = [mutant for path in files for mutant in mutants_of(tree, path)]
    return sorted(found, key=lambda mutant: drawn(mutant.identity))


def drawn(identity: Sequence[str]) -> bytes:
    return hashlib.sha256("\t".join([str(SEED), *identity]).encode()).digest()


def sample(tree: Path, package: str) -> list[Mutant]:
    return everything(tree, package)[: PACKAGES[package].most]


def function_at(text: str, number: int) -> tuple[str, int] | None:
    """Name and first line (of its decorators) of the outermost function in whose body this node is;
    None outside of functions.
    """
    name = ""
    way = way_to(ast.parse(text), number)
    for (node, _), (_, field) in itertools.pairwise(way):
        if isinstance(node, ast.ClassDef):
            name += f"{node.name}."
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and field == "body":
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            return name + node.name, first
    return None


def statement_at(text: str, number: int) -> range:
    """The lines of the innermost statement that this node is in, without those of the statements in
    it.
    """
    way = way_to(ast.parse(text), number)
    *_, statement = [node for node, _ in way if isinstance(node, ast.stmt | ast.ExceptHandler)]
    inside = [node for node in ast.walk(statement) if isinstance(node, ast.stmt)]
    inner = [node.lineno for node in inside if node is not statement]
    end = min([(statement.end_lineno or statement.lineno) + 1, *inner])
    return range(statement.lineno, max(end, statement.lineno + 1))


def called_as_it_loads(text: str) -> set[str]:
    """The functions whose work is done, in part, when their module is imported."""
    loads = [
        node
        for node in ast.parse(text).body
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
    ]
    calls = [call.func for node in loads for call in ast.walk(node) if isinstance(call, ast.Call)]
    return {name.id for name in calls if isinstance(name, ast.Name)}


# -- a copy, and children in it --------------------------------------------------------------------


def copied(work: Path) -> Path:
    """A copy of the repository of one's own, made anew, without what was measured, where code or
    tests are others than those it is of. `REVISION` names these, also where nothing is committed.
    """
    tree = work / "tree"
    revision = tree / "REVISION"
    looked_at = ["jbclog", "tests/*.py", ":!tests/support/campaigns", ":!*test_mutants.py"]
    if revision.exists():
        compared = ["git", "diff", "--quiet", revision.read_text(), "--", *looked_at]
        if not subprocess.run(compared, cwd=HERE, check=False).returncode:
            return tree
    shutil.rmtree(tree, ignore_errors=True)
    (work / "cover.jsonl").unlink(missing_ok=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=HERE, capture_output=True, check=True, text=True
    ).stdout
    for file in filter(None, listed.split("\0")):
        (tree / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(HERE / file, tree / file, follow_symlinks=False)
    compileall.compile_dir(tree / "jbclog", quiet=1)
    stashed = "git stash create | grep . || git rev-parse HEAD"
    named = subprocess.run(
        stashed, shell=True, cwd=HERE, capture_output=True, check=True, text=True
    )
    revision.write_text(named.stdout.strip())
    return tree


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
    path = work / "cover.jsonl"
    if path.exists():
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

        def say(text: str) -> None:
            os.write(write, f"{text}\n".encode())

        act(say)
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
        _, status = os.waitpid(self.pid, 0)
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


def watch_lines(note: Callable[[str, int], None]) -> None:
    """Call `note` once for each line of a function of the project that is run, with its file."""
    known: dict[CodeType, tuple[str, set[int]] | None] = {}

    def of(code: CodeType) -> tuple[str, set[int]] | None:
        name = code.co_filename[code.co_filename.rfind("/jbclog/") + 1 :]
        # 1: a function, no module and no class
        if not code.co_flags & 1 or not name.startswith("jbclog/"):
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

    def note(name: str, line: int) -> None:
        os.write(file, f"{name}:{line}\n".encode())

    watch_lines(note)


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


def cover(work: Path, tests: Sequence[str], end: float) -> None:
    """Measure which of these tests runs which line, and what each costs: seconds, and seconds of
    CPU time. What was measured before stays.
    """
    path = work / "cover.jsonl"
    known = {row["test"] for row in whole_rows(path)}
    is_collected = False

    def measure(items: dict[str, Any]) -> None:
        nonlocal is_collected
        is_collected = bool(items)
        for item in chosen(list(items.values())):
            if item.nodeid not in known and time.monotonic() < end:
                row = measured(work, item)
                with path.open("a") as file:
                    file.write(json.dumps(row) + "\n")

    collected(measure, tests)
    if not is_collected:
        sys.exit("the tests could not be collected")


def covered(work: Path, places: Sequence[str]) -> dict[str, Any]:
    """Of the measured tests in these files and folders: those of each line of each file, and what
    each took.
    """
    measured = [row for row in whole_rows(work / "cover.jsonl") if row["took"]]
    rows = [row for row in measured if row["test"].startswith(tuple(places))]
    lines: dict[str, dict[int, list[str]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        for place in row["ran"]:
            name, _, line = place.rpartition(":")
            lines[name][int(line)].append(row["test"])
    return {"lines": lines, "took": {row["test"]: row["took"] for row in rows}}


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
            if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef):
                lines -= set(range(one.lineno, (one.end_lineno or one.lineno) + 1))
        found |= dict.fromkeys(lines, frozenset(names))
    return found


def lines_of(
    tree: Path, name: str, line: int, known: Mapping[str, Mapping[int, object]]
) -> list[tuple[str, int]]:
    """The lines where a change of this line outside of functions shows: for a class, or a statement
    that defines no name, its file's; else where its name is used. If no test runs one of those,
    where a name is used that is made from it, and so on.
    """
    texts = {file: (tree / file).read_text() for file in sorted({name, *known})}
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
    while left and not any(number in known.get(file, ()) for file, number in found):
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
    known: dict[str, Any], tree: Path, mutant: Mutant, noticed: Counter[str], first: str = ""
) -> list[str]:
    """The tests that run the line, cheapest first; other parameters of the same test later, those
    that noticed much, and those that run more of the file, earlier; those of the function `first`
    before all.
    """
    took, lines = known["took"], known["lines"]
    text = (tree / mutant.file).read_text()
    of_file = lines.get(mutant.file, {})
    is_within = function_at(text, mutant.node) is not None
    within = [(mutant.file, number) for number in statement_at(text, mutant.node)]
    places = within if is_within else lines_of(tree, mutant.file, mutant.line, lines)
    tests = {test for file, number in places for test in lines.get(file, {}).get(number, ())}
    if not tests and not is_within:  # a default of a field, say
        tests = {test for some in of_file.values() for test in some}
    cost = {test: max(took[test][1], took[test][0] / 4) for test in tests}
    siblings: Counter[str] = Counter()
    runs = Counter(test for some in of_file.values() for test in some)
    thorough = max(runs.values(), default=1)
    order = {}
    for test in sorted(tests, key=lambda test: (cost[test], test)):
        function = test.partition("[")[0]
        siblings[function] += 1
        share = thorough / max(runs[test], 1)
        worth = cost[test] * siblings[function] / (1 + noticed[function]) * share**THOROUGH
        order[test] = (function != first, worth)
    result: list[str] = []
    total = 0.0
    for test in sorted(order, key=lambda test: order[test]):
        if result and total + cost[test] > MOST_S:
            continue
        total += cost[test]
        result.append(test)
    return result


# -- trying ----------------------------------------------------------------------------------------


class Trial:
    """Tries mutants, each in a child: of one that has collected the tests, or of this process,
    which has not even imported the project.
    """

    def __init__(self, work: Path, took: dict[str, list[float]], tests: Sequence[str]) -> None:
        self.work, self.tree, self.took = work, work / "tree", took
        ask, self._ask = os.pipe()
        self._answer, answer = os.pipe()
        self._warm = os.fork()
        if not self._warm:
            os.close(self._ask)
            os.close(self._answer)
            try:
                collected(lambda items: self._serve(items, ask, answer), tests)
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

    def outcome(self, mutant: Mutant, tests: Sequence[str]) -> tuple[str, str]:
        """Its outcome, and the test function that noticed. Tried again with that test alone where
        it runs in real time.
        """
        if not tests:
            return NOT_RUN, ""
        path, left = self.tree / mutant.file, list(tests)
        text = path.read_text()
        function = function_at(text, mutant.node)
        place = None
        if function is not None and function[0] not in called_as_it_loads(text):
            place = (str(path), *function, mutant.node, mutant.change)
        new = ast.unparse(mutated(text, mutant.node, mutant.change))
        with changed(self.work, mutant.file, new):
            while left:
                test = self._tried(place, text, left)
                if not test:
                    break
                if not test.startswith(REAL) or self._tried(place, text, [test]):
                    return NOTICED, test.partition("[")[0]
                left = left[left.index(test) + 1 :]
        return SURVIVED, ""

    def _tried(
        self, place: tuple[str, str, int, int, int] | None, text: str, tests: Sequence[str]
    ) -> str:
        if place is None:
            return judged(Child(self.work, lambda say: self._cold(tests, say)), self.took)
        os.write(self._ask, (json.dumps([place, text, list(tests)]) + "\n").encode())
        return str(json.loads(self._answers.readline()))

    def _cold(self, tests: Sequence[str], say: Callable[[str], None]) -> None:
        def act(items: dict[str, Any]) -> None:
            if items and one_by_one(wanted(items, tests), self.took, say):
                say("done")
                os._exit(0)
            if items:
                os._exit(1)

        collected(act, list(dict.fromkeys(test.partition("::")[0] for test in tests)))
        say("failed import")
        os._exit(0)

    def _serve(self, items: dict[str, Any], ask: int, answer: int) -> None:
        if not items:
            return
        functions = self._functions()
        os.write(answer, b"ready\n")
        for line in os.fdopen(ask, "r"):
            place, text, tests = json.loads(line)
            changed = functions[tuple(place[:3])]
            act = functools.partial(self._warm_act, changed, place, text, wanted(items, tests))
            # no test may have it
            test = judged(Child(self.work, act), self.took) if changed else ""
            os.write(answer, (json.dumps(test) + "\n").encode())

    def _functions(self) -> dict[tuple[str, str, int], list[FunctionType]]:
        """The functions of the project by file, name and first line."""
        gc.unfreeze()
        found = defaultdict(list)
        place = str(self.tree / "jbclog")
        for thing in gc.get_objects():
            if isinstance(thing, FunctionType) and thing.__code__.co_filename.startswith(place):
                code = thing.__code__
                found[code.co_filename, code.co_qualname, code.co_firstlineno].append(thing)
        gc.collect()
        gc.freeze()
        return found

    def _warm_act(
        self,
        functions: Sequence[FunctionType],
        place: tuple[str, str, int, int, int],
        text: str,
        items: Sequence[Any],
        say: Callable[[str], None],
    ) -> None:
        file, name, first, node, change = place
        made = codes(compile(mutated(text, node, change), file, "exec"))
        code = next(it for it in made if (it.co_qualname, it.co_firstlineno) == (name, first))
        for function in functions:
            function.__code__ = code
        if one_by_one(items, self.took, say):
            say("done")


def codes(code: CodeType) -> Iterator[CodeType]:
    """This and all within."""
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from codes(one)


def judged(child: Child, took: dict[str, list[float]]) -> str:
    """The test that noticed: it failed, took too long or ended its process; empty if all passed."""
    last = "begun import"
    try:
        for text in child.said(patience(took)):
            last = text
    finally:
        child.end()
    return "" if last == "done" else last.partition(" ")[2]


# -- the data --------------------------------------------------------------------------------------

COLUMNS = ("file", "function", "operator", "number", "outcome", "noticed_by")
NOTICED, SURVIVED, NOT_RUN = "noticed", "survived", "line not run"

Rows = dict[Identity, tuple[str, str]]
"""Of each mutant by its identity: the outcome, and the test function that noticed it first."""


def rows_in(text: str) -> Rows:
    table = csv.DictReader(text.splitlines())
    return {
        (row["file"], row["function"], row["operator"], row["number"]): (
            row["outcome"],
            row["noticed_by"],
        )
        for row in table
    }


def kept(package: str) -> Rows:
    path = DATA / f"{package}.csv"
    return rows_in(path.read_text()) if path.exists() else {}


def kept_at(revision: str, package: str) -> Rows:
    """What was kept at this revision: nothing where it has none."""
    file = f"{revision}:{DATA.relative_to(HERE)}/{package}.csv"
    shown = subprocess.run(
        ["git", "show", file], cwd=HERE, capture_output=True, check=False, text=True
    )
    return rows_in(shown.stdout)


def keep(package: str, rows: Rows) -> None:
    """Write them, sorted."""
    DATA.mkdir(parents=True, exist_ok=True)
    path = DATA / f"{package}.csv"
    aside = path.with_suffix(".new")
    with aside.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        ordered = sorted(rows, key=lambda key: (*key[:3], int(key[3])))
        table.writerows([*identity, *rows[identity]] for identity in ordered)
    aside.replace(path)


def forget(package: str, which: str) -> None:
    """Leave out what is to be tried once more."""
    rows = kept(package)
    left = {
        identity: row
        for identity, row in rows.items()
        if which == "survivors" and row[0] == NOTICED
    }
    if rows:
        keep(package, left)


def in_turn(mutants: Mapping[str, Sequence[Mutant]]) -> Iterator[tuple[str, Mutant]]:
    """Yield one of each package, then the next of each."""
    each = [[(package, mutant) for mutant in some] for package, some in mutants.items()]
    turns = itertools.zip_longest(*each)
    return filter(None, itertools.chain.from_iterable(turns))


def run(work: Path, packages: Sequence[str], seconds: float) -> None:
    """Try what has not been tried yet of these packages, group by group, for so long."""
    work.mkdir(parents=True, exist_ok=True)
    begin(work)
    tree = copied(work)
    enter(work)
    end = time.monotonic() + seconds
    for group in GROUPS:
        left = {}
        for package in filter(packages.__contains__, group):
            rows = kept(package)
            new = [mutant for mutant in sample(tree, package) if mutant.identity not in rows]
            if new:
                left[package] = new
        if not left:
            continue
        tests = [test for name in left for test in PACKAGES[name].tests]
        tests = [test for test in dict.fromkeys(tests) if Path(test).exists()]
        in_a_fork(lambda tests=tests: cover(work, tests, end))  # type: ignore[misc]
        if time.monotonic() > end:
            break
        if not try_each(work, left, tests, end):
            break
    else:
        print("all are tried")
        return
    print("the time is over; the same command continues")


def in_a_fork(act: Callable[[], None]) -> None:
    """Call this in a process that may import the project; this one may not. A signal that ends this
    one ends it, too.
    """
    sys.stdout.flush()
    pid = os.fork()
    if not pid:
        status = 1
        try:
            act()
            status = 0
        finally:
            sys.stdout.flush()
            os._exit(status)
    try:
        _, status = os.waitpid(pid, 0)
    except BaseException:
        os.kill(pid, signal.SIGTERM)
        os.waitpid(pid, 0)
        raise
    if status:
        sys.exit("not all tests were measured")


def try_each(
    work: Path, left: Mapping[str, Sequence[Mutant]], tests: Sequence[str], end: float
) -> bool:
    """Try these in turn, and keep each outcome; whether there was time for all."""
    known = {package: covered(work, PACKAGES[package].tests) for package in left}
    took = {test: cost for some in known.values() for test, cost in some["took"].items()}
    rows = {package: kept(package) for package in left}
    before = {package: kept_at("HEAD", package) for package in left}
    noticed: dict[str, Counter[str]] = defaultdict(Counter)
    for some in [*before.values(), *rows.values()]:
        for (file, *_), (_, test) in some.items():
            noticed[file][test] += 1
    with Trial(work, took, tests) as trial:
        for package, mutant in in_turn(left):
            if time.monotonic() > end:
                return False
            _, first = before[package].get(mutant.identity, ("", ""))
            chosen = covering(known[package], work / "tree", mutant, noticed[mutant.file], first)
            outcome, test = trial.outcome(mutant, chosen)
            noticed[mutant.file][test] += 1
            rows[package][mutant.identity] = (outcome, test)
            keep(package, rows[package])
            print(outcome, *mutant.identity, test, flush=True)
    return True


# -- the score -------------------------------------------------------------------------------------


def wilson(hits: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    share, square = hits / count, z * z / count
    middle = (share + square / 2) / (1 + square)
    half = z / (1 + square) * math.sqrt(share * (1 - share) / count + square / (4 * count))
    return middle - half, middle + half


def report(packages: Sequence[str], revision: str) -> bool:
    """Print the scores, and each mutant whose outcome is another than at this revision; whether all
    that were noticed there and exist are still noticed.
    """
    print(
        "| package | mutants | to try | tried | noticed | survived | line not run | noticed, 95 % |"
    )
    print("|---|---|---|---|---|---|---|---|")
    lost = 0
    changed: list[str] = []
    for package in packages:
        mutants = everything(HERE, package)
        there = {mutant.identity for mutant in mutants}
        rows = {identity: row for identity, row in kept(package).items() if identity in there}
        count = Counter(outcome for outcome, _ in rows.values())
        low, high = wilson(count[NOTICED], len(rows))
        share = f"{count[NOTICED] / len(rows):.0%} ({low:.0%} to {high:.0%})" if rows else "–"
        figures = [len(mutants), len(mutants[: PACKAGES[package].most]), len(rows)]
        figures += [count[NOTICED], count[SURVIVED], count[NOT_RUN]]
        print("|", " | ".join(map(str, [package, *figures, share])), "|")
        told, worse = compared(kept_at(revision, package), rows, there)
        if told:
            changed += [f"{package}, since {revision}:", *told]
        lost += worse
    print(*changed, sep="\n")
    return not lost


def compared(before: Rows, now: Rows, there: Set[Identity]) -> tuple[list[str], int]:
    """What to say of those tried both times, and of those that are not there any more; how many
    survive now that were noticed before.
    """
    lost, gained = [], []
    for identity in sorted(before.keys() & now.keys()):
        name = " ".join(identity)
        (was, by), (outcome, by_now) = before[identity], now[identity]
        if was == NOTICED and outcome != NOTICED:
            lost.append(f"    {outcome}: {name}, was noticed by {by}")
        if was != NOTICED and outcome == NOTICED:
            gained.append(f"    noticed: {name}, by {by_now}; was {was}")
    gone = [f"    no longer there: {' '.join(identity)}" for identity in before.keys() - there]
    return [*lost, *gained, *sorted(gone)], len(lost)


def main() -> None:
    words = argparse.ArgumentParser(prog=".ci/mutants", description="mutants of the code")
    words.add_argument("--package", action="append", choices=PACKAGES, help="this one; again: more")
    words.add_argument("--seconds", type=float, default=math.inf, help="no new mutant after that")
    words.add_argument("--again", choices=["survivors", "all"], help="what to try once more")
    words.add_argument("--report", action="store_true", help="print the scores and what changed")
    words.add_argument("--against", default="HEAD", help="the revision to compare with")
    words.add_argument(
        "--work", type=Path, default=HERE / "build/mutants", help="folder of the copy"
    )
    given = words.parse_args()
    packages = given.package or list(PACKAGES)
    if given.report:
        sys.exit(not report(packages, given.against))
    for package in packages if given.again else ():
        forget(package, given.again)
    end_when_asked()
    try:
        run(given.work.resolve(), packages, given.seconds)
    except KeyboardInterrupt as signalled:
        sys.exit(f"ended by {signalled}; the same command continues")


if __name__ == "__main__":
    main()
