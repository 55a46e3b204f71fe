"""For all tests: with JBCLOG_NO_SKIP in the environment a skipped test is a failed one, so that CI
lets none slip by.

A campaign says what it tried: ``counted(runs=50, wrong_values=0)`` in its tests, added up by file
at the end of the session.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
import typer.testing
from hypothesis import is_hypothesis_test, settings

from support import once

CAMPAIGN = "campaign"

# A busy machine must not fail a property. The examples are the same each time, so that what fails
# is what was changed; `--hypothesis-profile=anew` draws others, `-m campaign` others and more.
settings.register_profile("same", deadline=None, derandomize=True, max_examples=50)
settings.register_profile("anew", deadline=None, derandomize=False)
settings.register_profile(CAMPAIGN, deadline=None, derandomize=False, max_examples=1000)
settings.load_profile("same")

# each worker, and each of hundreds of processes that tests start, would compile all anew
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# hundreds of runs, each with a process of pandas after it; tests of that switch it on
os.environ["JBCLOG_NO_DERIVED"] = "1"
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="jbclog-tests-cache-")
# leases that tests leave open are not the user's
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="jbclog-tests-")
os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="jbclog-tests-runtime-")


def ignore_here_only(number: signal.Signals) -> None:
    """Go on ignoring a signal that `nohup` or a script's ``&`` had ignored before we began, but do
    not pass that on.

    A program that is started inherits what is ignored and not what is handled, and the tests start
    programs that must hear them.
    """
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, lambda _number, _frame: None)


for of_the_terminal in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
    ignore_here_only(of_the_terminal)

IN_MEMORY, FREE_BYTES = Path("/dev/shm"), 1 << 30
"""Where the tests keep their files if 1 GB is free; 80 MB are taken. They wait for each `fsync` of
a disk, a third of the time of those that record runs; `tests/faults` keeps theirs on the disk."""

NO_SKIP = bool(os.environ.get("JBCLOG_NO_SKIP"))

for home in ("XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
    atexit.register(shutil.rmtree, os.environ[home], ignore_errors=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that was skipped."""
    report = yield
    return _failed_if_skipped(report)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A file that was skipped as a whole."""
    report = yield
    return _failed_if_skipped(report)


def _failed_if_skipped(report: Any) -> Any:
    if NO_SKIP and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which JBCLOG_NO_SKIP forbids: {report.longrepr[-1]}"
    return report


# Hundreds of tests call the command line within their process: its parser, which costs 50 ms to
# make, is made once.
typer.testing._get_command = functools.cache(typer.testing._get_command)  # type: ignore[attr-defined]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--row",
        metavar="TEXT",
        help="of a test over all rows of a table, only the rows with TEXT in their name",
    )
    parser.addoption(
        "--accept",
        action="store_true",
        help="write tests/transcripts and tests/data/verdicts anew; the diff is what changed",
    )


def pytest_configure(config: pytest.Config) -> None:
    if not any(is_at_faults(config.invocation_params.dir / each) for each in config.args):
        _keep_in_memory()
    if row := config.getoption("--row"):
        os.environ["JBCLOG_ROW"] = row
    if config.option.markexpr == CAMPAIGN:
        settings.load_profile(CAMPAIGN)
    for hook in config.hook.pytest_runtest_logreport.get_hookimpls():
        if type(hook.plugin).__name__ == "WorkerInteractor":
            hook.function = functools.partial(_send, hook.function)


def is_at_faults(given: Path) -> bool:
    """Whether an argument of the command names `tests/faults`, what is in it, or what has it."""
    path = Path(str(given).partition("::")[0]).resolve()
    return path == FAULTS or FAULTS in path.parents or path in FAULTS.parents


def _keep_in_memory() -> None:
    """Have pytest make its temporary folders there; whoever has named others keeps them."""
    with contextlib.suppress(OSError):
        there = os.statvfs(IN_MEMORY)
        if os.access(IN_MEMORY, os.W_OK) and there.f_bavail * there.f_frsize > FREE_BYTES:
            os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(IN_MEMORY))


def _send(send: Callable[..., None], report: pytest.TestReport) -> None:
    """Of a worker: send what is counted or shown, a third of its reports."""
    if report.when == "call" or not report.passed or report.sections or report.user_properties:
        send(report=report)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Fast tests wait for nothing: a worker for each processor, which imports for seconds."""
    if config.option.markexpr == "fast" and config.pluginmanager.hasplugin("xdist"):
        config.option.maxprocesses = config.option.maxprocesses or max(2, os.cpu_count() or 2)


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Leave out the collector of cycles while ten thousand tests are made that all stay."""
    _begin_elsewhere(session.config)
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def _begin_elsewhere(config: pytest.Config) -> None:
    """Have each worker begin with other files: in a new clone it then finds compiled what the
    others began with.
    """
    folders = [config.rootpath / each for each in config.getini("testpaths")]
    if hasattr(config, "workerinput") and [Path(each).resolve() for each in config.args] == folders:
        files = sorted(
            path
            for folder in folders
            for path in folder.rglob("test_*.py")
            if not pytest_ignore_collect(path, config)
        )
        first = (
            len(files)
            * int(config.workerinput["workerid"].removeprefix("gw"))
            // config.workerinput["workercount"]
        )
        config.args = [*map(str, files[first:]), *map(str, files[:first])]


def pytest_collection_finish() -> None:
    """Identify the tip of a recorded run, draw it and set its paper once, however many reports,
    metrics and joints are made of it.

    Keep the collector from walking through ten thousand collected tests again and again: a
    twentieth of the suite's time."""
    once.install()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


FAST = ("app", "cli", "config", "core", "maintenance", "protocol", "session", "sim", "transport")
"""Packages whose tests are fast."""
# files that take seconds: large inputs, many runs, real connections, real time,
# processes, a browser, figures, slices of campaigns
NOT_FAST = {
    *("test_jobs_file.py", "test_hands.py"),
    *("test_wrong_usage.py", "test_audit_fleet.py", "test_exchanges.py"),
    *(
        "test_every_command.py",
        "test_reader_properties.py",
        "test_scan.py",
        "test_loaded_modules.py",
        "test_export.py",
        "test_mdf.py",
        "test_qdas.py",
    ),
    *(
        "publish/*.py",
        "export/*.py",
        "watch/test_page.py",
        "maintenance/test_page.py",
        "test_terminal.py",
        "test_cpu_limit.py",
    ),
    "app/run/test_derive.py",
    "test_book.py",
    *("transport/test_reactor.py", "test_budget.py", "test_server.py", "test_connections.py"),
    *("test_progress.py", "batch/test_journal.py"),
}
UNIT = Path(__file__).parent / "unit"
FAULTS = Path(__file__).parent / "faults"


@functools.cache
def is_fast(path: Path) -> bool:
    return (
        path.is_relative_to(UNIT)
        and path.relative_to(UNIT).parts[0] in FAST
        and not any(map(path.match, NOT_FAST))
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m fast`` no other file is even imported."""
    wanted = config.option.markexpr == "fast" and collection_path.suffix == ".py"
    return True if wanted and not is_fast(collection_path) else None


WAITING = "serial"
"""The tests in it wait for real lines most of the time."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Spread the files that wait among those that compute, so that the workers do both at any time;
    alike in each worker. Properties are campaigns as well.
    """
    for item in items:
        if config.option.markexpr == CAMPAIGN and is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker(CAMPAIGN)
        if is_fast(item.path) and not any(
            map(item.get_closest_marker, ("campaign", "bench", "soak"))
        ):
            item.add_marker(pytest.mark.fast)
    files = sorted({item.path for item in items})
    waiting = [path for path in files if path.parent.name == WAITING]
    computing = [path for path in files if path.parent.name != WAITING]
    place = {
        path: number / len(group)
        for group in (waiting, computing)
        for number, path in enumerate(group)
    }
    items.sort(
        key=lambda item: (
            place[item.path] * (0.8 if item.path.parent.name == WAITING else 1.0),
            item.path,
        )
    )


COUNTED = "counted "


@pytest.fixture
def counted(record_property: Callable[[str, object], None]) -> Callable[..., None]:
    """Numbers of a campaign, by name; they come through workers, too."""

    def count(**numbers: int) -> None:
        for name, number in numbers.items():
            record_property(COUNTED + name.replace("_", " "), number)

    return count


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """What was counted, a line a file."""
    sums: dict[str, Counter[str]] = defaultdict(Counter)
    for report in (
        one for outcome in ("passed", "failed") for one in terminalreporter.stats.get(outcome, [])
    ):
        for name, number in report.user_properties:
            if name.startswith(COUNTED):
                sums[report.nodeid.split("::")[0]][name.removeprefix(COUNTED)] += number
    for path, numbers in sums.items():
        terminalreporter.write_line(
            f"{path}: " + ", ".join(f"{number} {name}" for name, number in numbers.items())
        )


@pytest.fixture
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A state folder of its own: what one test left open is no other's."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
