"""The systemd unit in profiles/, taken apart."""

from __future__ import annotations

import configparser
import shlex
from pathlib import Path

UNIT = Path(__file__).parents[2] / "profiles" / "systemd" / "jbclog@.service"


def unit() -> configparser.ConfigParser:
    """Sections and keys, as systemd reads them: case counts, and a key is there once."""
    parser = configparser.ConfigParser(interpolation=None, strict=True, delimiters=("=",), comment_prefixes=("#",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # keep the keys as they are
    parser.read_string(UNIT.read_text(encoding="utf-8"))
    return parser


def command(key: str) -> list[str]:
    """The words of one of its commands, its program first."""
    return shlex.split(unit()["Service"][key])
