"""The texts of the repository: every file under version control that a person can read, and Python
files as syntax trees.
"""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from support.readers.texts import ROOT

TEXT = {".py", ".md", ".toml", ".lock", ".html", ".css", ".ipynb", ""}


def files() -> Iterator[str]:
    """Every text that is kept under version control."""
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:  # not a clone: an unpacked archive
        yield from (
            str(path.relative_to(ROOT))
            for path in ROOT.rglob("*")
            if path.is_file() and ".venv" not in path.parts
        )
    yield from listed.stdout.splitlines()


TEXTS = [name for name in files() if (ROOT / name).suffix in TEXT and (ROOT / name).is_file()]


@cache
def parsed(path: Path) -> ast.Module:
    """The file, parsed once however many tests look at it."""
    return ast.parse(path.read_text(encoding="utf-8"))
