"""The systemd units in profiles/, taken apart, and what systemd itself says of units."""

from __future__ import annotations

import configparser
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

SYSTEMD = Path(__file__).parents[3] / "profiles" / "systemd"
UNIT = SYSTEMD / "jbclog@.service"
AUDIT = SYSTEMD / "jbclog-audit.service"
TIMER = SYSTEMD / "jbclog-audit.timer"


def unit(path: Path = UNIT) -> configparser.ConfigParser:
    """Sections and keys, as systemd reads them: case counts. Of a key that is there several times
    the last.
    """
    parser = configparser.ConfigParser(
        interpolation=None, strict=False, delimiters=("=",), comment_prefixes=("#",)
    )
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keep the keys as they are
    parser.read_string(path.read_text(encoding="utf-8"))
    return parser


def command(key: str, path: Path = UNIT) -> list[str]:
    """The words of one of its commands, its program first."""
    return shlex.split(unit(path)["Service"][key])


def analyzed(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """What `systemd-analyze` says; the test is skipped where it is not installed."""
    if (program := shutil.which("systemd-analyze")) is None:
        pytest.skip("needs systemd-analyze (Debian package systemd)")
    command = [program, "--no-pager", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)


MOST_EXPOSED = 20
"""What the units may come to by `systemd-analyze security`, in tenths: 18 with systemd 252. 92 is a
unit without any hardening.
"""


def exposed(unit: Path) -> str | None:
    """Why a unit is not closed enough; None where it is."""
    done = analyzed("security", "--offline=true", f"--threshold={MOST_EXPOSED}", unit)
    return None if done.returncode == 0 else done.stdout + done.stderr
