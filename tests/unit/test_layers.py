"""What imports really load: nothing heavier than what they need."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from syntax import parsed

import jbclog

PACKAGE = Path(jbclog.__file__).parent
HEAVY = ("pandas", "matplotlib", "jinja2")


def test_every_file_begins_with_what_it_is() -> None:
    assert [path.name for path in PACKAGE.rglob("*.py") if not ast.get_docstring(parsed(path))] == []


def loaded_by(statement: str, *names: str) -> set[str]:
    """Which of the modules `names` are loaded in a fresh Python after `statement`."""
    code = f"import sys\n{statement}\nprint(*[name for name in {names!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=200)
    return set(done.stdout.split())


def test_importing_jbclog_is_light() -> None:
    assert loaded_by("import jbclog", *HEAVY, "numpy", "pyarrow", "pydantic", "serial", "typer") == set()


def test_public_names_load_what_they_need_and_no_more() -> None:
    assert loaded_by("import jbclog; jbclog.LinkError", *HEAVY, "pyarrow", "serial") == set()
    assert loaded_by("import jbclog; jbclog.open_run", "pandas", "matplotlib", "scipy") == {"pandas"}, (
        "scipy takes a second to load"
    )


def test_help_is_light() -> None:
    assert loaded_by("import jbclog.cli", *HEAVY, "numpy", "pyarrow", "pydantic", "serial", "sqlite3", "asyncio") == set()


def test_the_recorder_loads_no_heavy_room() -> None:
    path = "import jbclog.cli.run, jbclog.cli.progress, jbclog.app.run.plan, jbclog.app.run.runner, jbclog.record.seal"
    assert (
        loaded_by(path, *HEAVY, "scipy", "jbclog.analysis.joints", "jbclog.sim", "jbclog.analysis.run", "jbclog.report", "rich")
        == set()
    )


def test_joints_are_looked_for_at_the_end_of_a_run_without_the_heavy_rooms() -> None:
    assert loaded_by("import jbclog.analysis.joints.evidence", *HEAVY, "jbclog.analysis.run", "jbclog.report") == set()
