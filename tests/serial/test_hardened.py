"""The commands of the systemd units, with no more rights than the units grant: system calls,
addresses, privileges, folders (`faults.confined`).
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from support import program
from support.command import RECIPE, WireLog, is_sampling, until
from support.product import MAIN, check_run, read_manifest
from support.readers.unit_file import AUDIT, UNIT

JBCLOG = ("-c", MAIN)


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """On the disk, where a unit's command may write only what its unit grants: it may write
    anywhere below `/dev`, where the other tests have their files (`tests/conftest.py`).
    """
    with tempfile.TemporaryDirectory(prefix="jbclog-hardened-") as folder:
        yield Path(folder)


@pytest.fixture
def state(tmp_path: Path) -> Path:
    """A folder that a unit may write to."""
    if os.geteuid() != 0 or shutil.which("systemd-analyze") is None:
        pytest.skip("needs root and systemd-analyze (Debian package systemd)")
    folder = tmp_path / "state"
    folder.mkdir()
    tried = output(program("faults.confined", UNIT, folder, "true"))
    if tried.returncode != 0:  # a container that may not
        pytest.skip(f"needs a root that may unshare and mount: {tried.stderr}")
    return folder


def under(unit: Path, folder: Path, *words: str | Path) -> list[str]:
    return program("faults.confined", unit, folder, sys.executable, *words)


def output(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)


FORBIDDEN = """
import ctypes, os, socket, sys
for name, what in {
    "disk": lambda: open(sys.argv[1], "w"),
    "owner": lambda: os.chown(sys.argv[2], 1, 1),
    "address": lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW),
    "clock": lambda: __import__("time").clock_settime(0, 0),
    "code": lambda: __import__("mmap").mmap(-1, 4096, prot=7),
}.items():
    try:
        what()
    except OSError as error:
        continue
    print(name)
os.nice(3)
print("nice", open(sys.argv[2] + "/x", "w").write("x"))
"""


def test_what_confines_them_does(state: Path, tmp_path: Path) -> None:
    done = output(under(UNIT, state, "-c", FORBIDDEN, tmp_path / "elsewhere", state))
    assert (done.stdout, done.stderr) == ("nice 1\n", "")


def test_the_unit_lets_a_run_be_recorded_and_sealed_and_the_line_be_made_safe(
    bench: tuple[Path, WireLog], state: Path
) -> None:
    line, wire = bench
    command = under(
        UNIT,
        state,
        *JBCLOG,
        "run",
        RECIPE,
        "--line",
        line,
        "--out",
        state / "runs",
        "-s",
        "ale-1",
        "--rate",
        "5",
    )
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert until(lambda: is_sampling(state / "runs"))
    run.send_signal(signal.SIGTERM)
    told = run.communicate(timeout=100)[1]
    (folder,) = (state / "runs").iterdir()
    manifest = read_manifest(folder)
    assert (manifest.state, manifest.guard, manifest.lost, check_run(folder)) == (
        "sealed",
        "on",
        None,
        [],
    ), told
    assert wire.writes("ale-1")[-1] == "WPS100001"
    safe = output(under(UNIT, state, *JBCLOG, "safe", "--line", line))
    assert safe.returncode == 0, safe.stderr


def test_the_unit_lets_an_audit_be_made(
    bench: tuple[Path, WireLog], state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line, _ = bench
    monkeypatch.setenv("MPLCONFIGDIR", str(state / "matplotlib"))  # as the unit sets it
    files = (
        "--ledger",
        state / "counters.jsonl",
        "--html",
        state / "page.html",
        "--csv",
        state / "all.csv",
    )
    done = output(under(AUDIT, state, *JBCLOG, "audit", "--line", line, *files))
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in state.iterdir()) == [
        "all.csv",
        "counters.jsonl",
        "matplotlib",
        "page.html",
    ]
