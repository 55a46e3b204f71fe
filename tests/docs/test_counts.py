"""What `.ci/count` counts, on a package of a few lines."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

COUNT = Path(__file__).resolve().parents[2] / ".ci" / "count"
MODULE = '''"""A module."""


def public(x):
    return _once(x) + _twice(x) if x else _twice(-x)


def _once(x):
    return x


def _twice(x):
    return x


async def _asked():
    await _asked_by_nobody()


def _long(x):
    x += 1
    x += 1
    x += 1
    x += 1
    x += 1
    x += 1
    x += 1
    return x


class Caller:
    def call(self):
        self._by_name = (_asked, _long)
'''


def test_each_measure_is_counted(tmp_path: Path) -> None:
    for folder in ("jbclog/part", "tests", "docs"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "jbclog" / "part" / "__init__.py").write_text('"""A part."""\n')
    (tmp_path / "jbclog" / "part" / "module.py").write_text(MODULE)
    (tmp_path / "tests" / "test_it.py").write_text("assert True\n")
    (tmp_path / "README.md").write_text("four words by hand\n")
    (tmp_path / "docs" / "made.md").write_text("<!-- Made from the code by it -->\none\n")
    counted = subprocess.run(
        [sys.executable, COUNT, tmp_path], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    statements = 1 + 1 + 3 * 2 + 2 + 9 + 3
    assert counted[0].startswith(f"jbclog: 2 files (1 __init__), 34 lines, {statements} statements")
    assert counted[2] == f"statements by part: part {statements}"
    assert counted[3] == (
        f"conditional expressions per 1000 statements: {1000 / statements:.1f};"
        " private functions of at most 8 lines that are named once: 2"  # _once, _asked
    )
    assert counted[4] == "documentation: 4 words written by hand, 9 generated"
    assert counted[5] == "packages: 1 (part)"
