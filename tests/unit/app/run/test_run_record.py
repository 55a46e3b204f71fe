"""A record that no reader would take is refused before a station is touched; and what it says of
the host.
"""

from __future__ import annotations

import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest

from jbclog.app.run import run_record
from jbclog.app.run.options import Metadata
from jbclog.core.errors import RecordError
from support.records.report_runs import RECIPE, STATION
from support.virtual.recorded_run import run_in


def run_of(tmp_path: Path, stated: Metadata) -> Path:
    line = '[line]\nname = "bench-3"\n' + STATION.format(family="dde", number=1, sim="")
    return run_in(tmp_path, line, RECIPE, 1.0, rate=2.0, metadata=stated)


def test_too_much_for_one_record_is_refused_at_the_start(tmp_path: Path) -> None:
    why = "too much for one record: its manifest has [0-9]+ bytes"
    with pytest.raises(RecordError, match=f"{why}.*No station was touched"):
        run_of(tmp_path, Metadata(units=["S" * 500] * 40_000))


def test_the_host_is_named_as_python_and_its_packages_name_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    host = run_record._host()
    assert host["system"] == platform.platform()
    for package in ("pyserial", "pyarrow"):
        assert host[package] == version(package)

    def start(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(platform, "_uname_cache", None)
    monkeypatch.setattr(platform, "_platform_cache", {})
    monkeypatch.setattr(subprocess, "Popen", start)
    assert run_record._host() == host
