"""The contracts of import-linter notice what they forbid, and imports load nothing heavier than
what they need.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import jbclog
from support.readers.other_desk import FOLDERS, PARTIAL, lacking
from support.readers.repository import parsed
from support.readers.texts import ROOT

PACKAGE = Path(jbclog.__file__).parent
HEAVY = ("pandas", "matplotlib", "jinja2")

# module that is added to a copy of the package -> what it imports, and what import-linter says of
# it
FORBIDDEN = {
    "protocol.added": (
        "from jbclog.session import scheduler",
        "jbclog.protocol.added -> jbclog.session.scheduler",
    ),
    "session.added": ("def f():\n    import time", "jbclog.session.added -> time"),
    "protocol.client.added": (
        "from threading import Lock",
        "jbclog.protocol.client.added -> threading",
    ),
    "transport.port": (
        "from jbclog.transport.session_runner import SessionRunner",
        "jbclog.transport.port -> jbclog.transport.session_runner",
    ),
    "record.added": ("import pandas as pd", "jbclog.record.added -> pandas"),
    "analysis.joints.added": ("import pandas as pd", "jbclog.analysis.joints.added -> pandas"),
    "guard.added": ("from serial import Serial", "jbclog.guard.added -> serial"),
    "app.run.added": (
        "from jbclog.sim.virtual import VirtualStation",
        "jbclog.app.run.added -> jbclog.sim.virtual",
    ),
    "cli.added": ("from jbclog.sim import virtual", "jbclog.cli.added -> jbclog.sim.virtual"),
    "app.added": ("from jbclog.report import write", "jbclog.app.added -> jbclog.report.write"),
    "maintenance.added": ("import jinja2", "jbclog.maintenance.added -> jinja2"),
    "guard.added_too": ("import tomllib", "jbclog.guard.added_too -> tomllib"),
    "record.added_too": ("import fcntl", "jbclog.record.added_too -> fcntl"),
    "core.added": ("def f():\n    import resource", "jbclog.core.added -> resource"),
    "report.added": ("from jbclog import spc", "jbclog.report.added -> jbclog.spc"),
}
UNKNOWN = "cellar"  # a package that has no layer


def lint(project: Path) -> str:
    """What import-linter says of a project, and its exit code before that."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo"]
    wide = {**os.environ, "COLUMNS": "1000", "PYTHONPATH": str(project)}
    done = subprocess.run(
        command, cwd=project, env=wide, capture_output=True, text=True, check=False, timeout=200
    )
    return f"{done.returncode}\n{done.stdout}{done.stderr}"


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What import-linter says of a copy of the package with all that is forbidden."""
    project = tmp_path_factory.mktemp("project")
    package = shutil.copytree(
        PACKAGE, project / "jbclog", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(ROOT / "pyproject.toml", project)
    for module, (text, _) in FORBIDDEN.items():
        (package / f"{module.replace('.', '/')}.py").write_text(text, encoding="utf-8")
    (package / UNKNOWN).mkdir()
    (package / UNKNOWN / "__init__.py").touch()
    return lint(project)


@pytest.mark.parametrize("module", FORBIDDEN)
def test_a_forbidden_import_is_found(module: str, said: str) -> None:
    assert said.startswith("1\n")
    assert FORBIDDEN[module][1] in said


def test_a_package_without_a_layer_is_found(said: str) -> None:
    assert said.startswith("1\n")
    assert f"- jbclog.{UNKNOWN}" in said


def test_every_file_begins_with_what_it_is() -> None:
    assert [
        path.name for path in PACKAGE.rglob("*.py") if not ast.get_docstring(parsed(path))
    ] == []


USES_POSIX = (
    "core/operating_system.py",
    *("transport/", "guard/", "sim/"),
    *("app/run/", "app/batch/", "app/safe_state.py"),
)
"""What may use names that Windows lacks, and folders that Linux alone has."""


def of_posix(tree: ast.Module) -> Iterator[str]:
    """What a module uses of POSIX: ``os.pread``, ``/proc``."""
    texts = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = node.value.id
            if module in PARTIAL and node.attr in lacking(module):
                yield f"{module}.{node.attr}"
        elif isinstance(node, ast.ImportFrom) and node.module in PARTIAL:
            names = [name.name for name in node.names if name.name in lacking(node.module)]
            yield from (f"{node.module}.{name}" for name in names)
        elif isinstance(node, ast.Constant) and id(node) not in texts:
            yield from [str(node.value)] if str(node.value).startswith(FOLDERS) else []


def test_only_what_records_uses_names_of_posix() -> None:
    users = {
        path.relative_to(PACKAGE).as_posix(): [*of_posix(parsed(path))]
        for path in PACKAGE.rglob("*.py")
    }
    others = {file: used for file, used in users.items() if not file.startswith(USES_POSIX)}
    assert {file: used for file, used in others.items() if used} == {}
    assert {"os.pread", "os.nice", "select.poll"} <= {*users["core/operating_system.py"]}


@pytest.mark.parametrize(
    "text",
    [
        "os.fdatasync(3)",
        "def f():\n    return signal.SIGHUP",
        "from os import pread",
        "time.CLOCK_BOOTTIME",
        "open('/proc/self/status')",
        "open(f'/dev/fd/{3}')",
    ],
)
def test_a_name_of_posix_is_found(text: str) -> None:
    assert len([*of_posix(ast.parse(text))]) == 1


@pytest.mark.parametrize("text", ["os.fsync(3)", "signal.SIGINT", "'/proc: a docstring'"])
def test_a_name_of_every_system_is_fine(text: str) -> None:
    assert [*of_posix(ast.parse(text))] == []


def loaded_by(statement: str, *names: str) -> set[str]:
    """Which of the modules `names` are loaded in a fresh Python after `statement`."""
    code = f"import sys\n{statement}\nprint(*[name for name in {names!r} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=200
    )
    return set(done.stdout.split())


def test_importing_jbclog_is_light() -> None:
    assert (
        loaded_by("import jbclog", *HEAVY, "numpy", "pyarrow", "pydantic", "serial", "typer")
        == set()
    )


def test_public_names_load_what_they_need_and_no_more() -> None:
    assert loaded_by("import jbclog; jbclog.LinkError", *HEAVY, "pyarrow", "serial") == set()
    assert loaded_by("import jbclog; jbclog.open_run", "pandas", "matplotlib", "scipy") == {
        "pandas"
    }, "scipy takes a second to load"


def test_a_follower_is_light() -> None:
    path = "import jbclog.live; jbclog.live.follow; import jbclog.live.run_follower"
    assert (
        loaded_by(path, *HEAVY, "scipy", "serial", "textual", "starlette", "jbclog.analysis.run")
        == set()
    )


def test_help_is_light() -> None:
    assert (
        loaded_by(
            "import jbclog.cli",
            "jbclog.cli.run",
            "jbclog.cli.plan",
            "jbclog.cli.options",
            "hashlib",
        )
        == set()
    )
    assert (
        loaded_by(
            "import jbclog.cli",
            *HEAVY,
            "numpy",
            "pyarrow",
            "pydantic",
            "serial",
            "sqlite3",
            "asyncio",
        )
        == set()
    )


@pytest.mark.parametrize(
    "words", [["runs"], ["where-used", "--station", "dde-1", "--since", "2026-01-01"]]
)
def test_finding_runs_is_light(words: list[str], tmp_path: Path) -> None:
    call = (
        "from typer.testing import CliRunner; from jbclog.cli.app import app;"
        f" CliRunner().invoke(app, {[*words, str(tmp_path)]!r})"
    )
    assert loaded_by(call, *HEAVY, "numpy", "pyarrow", "scipy") == set()


def test_the_recorder_loads_no_heavy_package() -> None:
    path = (
        "import jbclog.cli.run, jbclog.cli.progress, jbclog.app.run.plan, jbclog.app.run.runner,"
        " jbclog.record.seal"
    )
    assert (
        loaded_by(
            path,
            *HEAVY,
            "scipy",
            "jbclog.analysis.joints",
            "jbclog.sim",
            "jbclog.analysis.run",
            "jbclog.report",
            "rich",
        )
        == set()
    )


def test_the_joint_search_at_the_end_of_a_run_loads_no_heavy_package() -> None:
    assert (
        loaded_by(
            "import jbclog.analysis.joints.evidence", *HEAVY, "jbclog.analysis.run", "jbclog.report"
        )
        == set()
    )
