"""Sessions that cannot read UTF-8 or write their home."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.records.small_run import make_run

RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'
PROGRAM = (sys.executable, "-c", "from jbclog.cli import main; main()")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.toml").write_text(RECIPE)
    return tmp_path


@pytest.mark.parametrize(
    ("locale", "operator", "told"),
    [
        (
            {"LANG": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
            "Jörg Müller".encode(),
            "characters beyond ASCII, the encoding of this session; set LANG=C.UTF-8 and try again",
        ),
        (
            {"LC_ALL": "POSIX", "LANG": "C.UTF-8", "PYTHONUTF8": "0"},
            "Jörg Müller".encode(),
            "characters beyond ASCII, the encoding of this session; set LC_ALL=C.UTF-8 and try"
            " again",
        ),
        (
            {"LANG": "C.UTF-8"},
            "Jörg Müller".encode("latin-1"),
            "bytes that are not UTF-8; set the terminal to UTF-8",
        ),
        ({"LANG": "POSIX"}, "Jörg Müller".encode(), None),
    ],
)
def test_a_name_that_the_session_cannot_read(
    place: Path, locale: dict[str, str], operator: bytes, told: str | None
) -> None:
    without = {name: text for name, text in os.environ.items() if name[:2] not in ("LC", "LA")}
    words = [*PROGRAM, "run", "job.toml", "--line", "absent.toml", "--operator", operator]
    ended = subprocess.run(words, env=without | locale, capture_output=True, check=False)
    assert ended.returncode == 2
    errors = ended.stderr.decode().splitlines()
    is_told = errors[0].startswith("error: --operator: ")
    assert is_told is (told is not None), errors
    if told is not None:
        assert errors[0] == f"error: --operator: {told}"


def test_a_home_that_cannot_be_written_does_not_concern_who_makes_a_report(place: Path) -> None:
    run = make_run(place / "runs", 10.0)
    no_home = {"HOME": "/dev/null/home", "XDG_CONFIG_HOME": "", "XDG_CACHE_HOME": ""}
    environment = {k: v for k, v in os.environ.items() if k != "MPLCONFIGDIR"} | no_home
    words = [*PROGRAM, "report", str(run)]
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, ""), ended.stderr
    assert "report" in ended.stdout
