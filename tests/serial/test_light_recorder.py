"""A recorder loads only the modules that it needs to record, seal and judge."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from support.command import RECIPE, WireLog, fresh
from support.product import LOADED_TO_RECORD, NOT_LOADED_TO_RECORD

# an attempt that was refused is a line too, so for pandas its inner rooms are looked for
HEAVY = (
    "pandas.core",
    "matplotlib",
    "jinja2",
    "scipy",
    *NOT_LOADED_TO_RECORD,
)


def test_a_whole_run_loads_no_heavy_package(
    bench: tuple[Path, WireLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")  # each import is a line on stderr
    line, _ = bench
    ended = fresh(
        "run", RECIPE, "--line", line, "--out", tmp_path, "-d", "2s", "-s", "ale-1", "--rate", "2"
    )
    loaded = set(re.findall(r"^import time:.*\| +([\w.]+)$", ended.stderr, re.MULTILINE))
    assert loaded >= LOADED_TO_RECORD
    assert [name for name in loaded if name in HEAVY] == []
