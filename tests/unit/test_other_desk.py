"""The reading side on a desk without POSIX, and what the commands that record say there. Windows is
not at hand: its modules and names are taken away on Linux (`support.readers.other_desk`).
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from support.product import (
    FRONT_PAGE_COMMANDS,
    LOCKS_WITHOUT_POSIX,
    NO_RECORDING,
    RECORDING_COMMANDS,
    SERVED_PAGE,
    conduct_run,
)
from support.readers.notebook_runs import HOME, NOTEBOOKS
from support.readers.other_desk import Call, Done, forbidden_name, made_elsewhere
from support.records.small_run import make_run
from support.virtual.recorded_run import Nobody, plan_in

SECONDS = 45

NOTHING_OF_POSIX = """
import os, signal
from importlib import import_module
from pathlib import Path

lacking = [name for name in ("pread", "fdatasync", "nice", "O_CLOEXEC") if not hasattr(os, name)]
assert len(lacking) == 4
assert not hasattr(signal, "SIGHUP")
for module in ("fcntl", "termios", "resource", "pwd", "grp"):
    try:
        import_module(module)
    except ImportError:
        continue
    raise AssertionError(module)
for name in ("aux.csv", "a:b.csv", "end."):
    try:
        Path(name).write_text("")
    except OSError:
        continue
    raise AssertionError(name)
assert not Path("/proc/self/status").parent.joinpath("x").exists()
try:
    open("/proc/self/status")
except FileNotFoundError:
    print("nothing of POSIX")
"""
PYTHON = """
import jbclog
from jbclog import spc
from jbclog.live import follow

run = jbclog.open_run("run")
runs = jbclog.open_runs(".")
frames = (run.samples("dde-1", 1), run.events(), run.alarms(), run.joints(), run.metrics())
assert all(len(frame) for frame in frames)
assert len(runs) == 2
assert spc.control_chart([350.0, 351.0, 349.0, 352.0] * 8)
with follow("run", joints=True) as follower:
    state = follower.poll()
print(run.verdict, state.phase.value, state.ports[0].joints.why)
"""

CALLS = {
    "nothing": Call(code=NOTHING_OF_POSIX),
    "locks": Call(code=LOCKS_WITHOUT_POSIX),
    "python": Call(code=PYTHON),
    "runs": Call(("runs", ".", "--json")),
    "report": Call(("report", "run", "--json")),
    "check": Call(("check", "run", "--json")),
    "csv": Call(("export", "run", "--to", "csv", "--out", "as-csv")),
    "xlsx": Call(("export", "run", "--to", "xlsx", "--out", "run.xlsx")),
    "mf4": Call(("export", "run", "--to", "mf4", "--out", "run.mf4")),
    "qdas": Call(("export", "run", "--to", "qdas", "--out", "as-qdas")),
    "again": Call(("export", "run", "--to", "csv", "--out", "as-csv", "--force")),
    "annotate": Call(("annotate", "run", "scrapped", "--by", "A. Rossi", "--reason", "cracked")),
    "checked": Call(("check", "run", "--json")),
    "alarms": Call(("alarms", "run", "--json")),
    "compare": Call(("compare", "run", "other", "--plot", "both.png")),
    "trend": Call(("trend", ".", "--metric", "recovery_s", "--plot", "trend.png")),
    "chart": Call(("chart", "run", "--metric", "dwell_s", "--plot", "chart.png")),
    "limits": Call(("limits", "learn", "run", "--metric", "dwell_s", "--out", "limits.json")),
    "publish": Call(("publish", "run", "other", "table")),
    "compared": Call(("publish", "--check", "run", "other", "table")),
    "published": Call(("runs", "table", "--json")),
    "where-used": Call(("where-used", ".", "--station", "dde-1", "--port", "1")),
    "plan": Call(("plan", "recipe.toml", "--line", "line.toml", "--json")),
    "maintenance": Call(
        (
            *("maintenance", "done", "--station", "dde-1", "--task", "service"),
            *("--line", "line.toml", "--by", "A. Rossi"),
        )
    ),
    "watch": Call(code=SERVED_PAGE),
    "run --help": Call(("run", "--help")),
}
FINDINGS = {"alarms": 1, "limits": 1}
"""The exit codes of those that find something in these runs; the others end with 0."""

REFUSED = {
    "audit": ("--line", "line.toml", "--ledger", "ledger.jsonl", "--json"),
    "batch": ("night.toml",),
    "demo": (),
    "doctor": ("--json",),
    "init": (),
    "read": ("dde-1", "--line", "line.toml", "--json"),
    "recover": (".",),
    "run": ("recipe.toml", "--line", "line.toml", "--json"),
    "safe": ("--line", "line.toml"),
    "scan": (),
    "sim": ("line.toml",),
    "verify": (
        *("dde-1", "-l", "line.toml", "-p", "1", "--reading", "352.4", "--instrument", "TC-7"),
        *("--due", "2030-03-01", "--tip", "T-17", "--by", "A. Rossi"),
    ),
    "write": ("dde-1", "selected_temperature", "350", "--line", "line.toml"),
}
LINE = """[line]
name = "bench"
[[station]]
name = "dde-1"
url = "nowhere"
family = "dde"
ports = [1]
"""


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    for name, seed in (("run", 1), ("other", 2)):
        make_run(folder / "made", SECONDS, seed).rename(folder / name)
    shutil.rmtree(folder / "made")
    plan_in(folder, LINE)
    return folder


@pytest.fixture(scope="module")
def done(desk: Path) -> dict[str, Done]:
    calls = CALLS | {name: Call((name, *words)) for name, words in REFUSED.items()}
    return dict(zip(calls, made_elsewhere([*calls.values()], desk), strict=True))


@pytest.mark.parametrize("name", CALLS)
def test_what_reads_works_without_posix(name: str, done: dict[str, Done]) -> None:
    made = done[name]
    assert (made.code, "Traceback" in made.err) == (FINDINGS.get(name, 0), False), made.err


def test_what_is_read_there_is_what_was_recorded(desk: Path, done: dict[str, Done]) -> None:
    assert done["nothing"].out == "nothing of POSIX\n"
    assert done["locks"].out == "fine\n"
    verdict, phase, *why = done["python"].out.split(" ", 2)
    assert (verdict, phase) == ("REJECT", "finalized")
    assert "needs a POSIX system" in why[0]
    checks = [json.loads(done[name].out) for name in ("check", "checked")]
    assert [(check["agrees"], check["findings"]) for check in checks] == [(True, [])] * 2
    assert len(done["runs"].out.splitlines()) == len(done["published"].out.splitlines()) == 2
    assert "no differences (2 runs)" in done["compared"].out
    assert done["watch"].out == "200\n"
    for file in ("run/report.html", "run/report.pdf", "run.xlsx", "run.mf4", "trend.png"):
        assert (desk / file).stat().st_size, file


@pytest.mark.parametrize("name", REFUSED)
def test_what_records_says_that_it_needs_posix(name: str, done: dict[str, Done]) -> None:
    made = done[name]
    assert (made.code, made.err) == (2, f"error: {NO_RECORDING}\n")
    if "--json" in REFUSED[name]:
        assert json.loads(made.out)["problems"] == [NO_RECORDING]


def test_every_command_reads_or_is_refused() -> None:
    commands = {name for group in FRONT_PAGE_COMMANDS.values() for name in group}
    assert set(REFUSED) == RECORDING_COMMANDS
    reading = {call.words[0] for call in CALLS.values() if call.words} - {"run"}
    assert reading | {"watch"} == commands - RECORDING_COMMANDS


def test_notebooks_run_without_posix(desk: Path) -> None:
    first, *others = NOTEBOOKS
    environment = (("JBCLOG_RUN", str(desk / "run")),)
    calls = [Call(notebook=str(notebook)) for notebook in others]
    calls.append(Call(notebook=str(first), environment=environment))
    for call, made in zip(calls, made_elsewhere(calls, HOME), strict=True):
        assert made.code == 0, f"{call.notebook}: {made.err}"


def test_windows_allows_every_name(desk: Path, done: dict[str, Done], tmp_path: Path) -> None:
    assert done["publish"].code == done["report"].code == 0
    plan = plan_in(tmp_path, LINE, duration_s=1.0, wire=True)
    captured = conduct_run(plan, tmp_path / "runs", Nobody()).folder
    paths = [path.relative_to(home) for home in (desk, captured) for path in home.rglob("*")]
    first = {path.parts[0] for path in paths}
    assert {"run", "as-csv", "as-qdas", "table", "wire", "recipes"} <= first
    assert [path for path in paths if forbidden_name(path) is not None] == []


@pytest.mark.parametrize(
    "name", ["aux", "CON.csv", "com1.part", "a:b", "a?", "end.", "end ", "tab\t", "lpt9.x.y"]
)
def test_names_that_windows_does_not_allow_are_noticed(name: str) -> None:
    assert forbidden_name(Path("runs", name, "fine")) == name


@pytest.mark.parametrize("name", ["auxiliary", "com", "console.csv", ".hidden", "line=bench-3"])
def test_other_names_are_fine(name: str) -> None:
    assert forbidden_name(Path("/runs", name)) is None
