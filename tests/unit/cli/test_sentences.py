"""What is wrong in the files, in words that name it once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.invoked import invoked

STATION = '[[station]]\nname = "dde-{0}"\nurl = "nowhere-{0}"\nfamily = "dde"\nports = [1]\n'
LINE = '[line]\nname = "bench"\n' + STATION.format(1) + STATION.format(2)
RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a line of two stations and a recipe, and the program in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / "job.toml").write_text(RECIPE)
    return tmp_path


def planned(
    recipe: str = "job.toml", line: str = "line.toml", *, verb: str = "plan", code: int = 2
) -> list[str]:
    """The lines that a call puts on stderr."""
    ended = invoked(verb, recipe, "--line", line)
    assert ended.exit_code == code, ended.output
    return ended.stderr.splitlines()


def test_a_value_is_shown_as_it_is_written(place: Path) -> None:
    (place / "job.toml").write_text(
        RECIPE + "[alarm.high]\nlimit_c = 9999\ndelay_s = 1.333\n[sleep]\ndelay_min = 10\n"
    )
    assert planned() == [
        "error: job.toml:6: alarm.high.limit_c: 9999 °C is not allowed; steps of 5 °C",
        (
            "error: job.toml:7: alarm.high.delay_s: 1.333 s is not allowed; 0 to 99.99 s, in steps"
            ' of 0.01, or "off"'
        ),
        (
            "error: job.toml:9: sleep.delay_min: 10 min is not allowed; 0 to 9 min, in steps of 1,"
            ' or "off"'
        ),
        "3 problems; nothing sent",
    ]


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_recipe_and_line_file_the_wrong_way_round(place: Path, verb: str) -> None:
    told = planned("line.toml", "job.toml", verb=verb)
    assert told == ["error: job.toml is a recipe and line.toml a line file: swap them"]


def test_the_wrong_kind_of_file_is_said_once(place: Path) -> None:
    one, _ = planned("line.toml")
    assert (
        one
        == "error: line.toml: this is a line file; a recipe has [recipe] and what is asked of the"
        " stations"
    )
    one, _ = planned("job.toml", "job.toml")
    assert (
        one
        == "error: job.toml: this is a recipe; a line file has [line] and a [[station]] for each"
        " station"
    )


def test_a_recipe_that_no_station_uses_is_refused(place: Path) -> None:
    shutil.copy(place / "job.toml", place / "own.toml")
    (place / "line.toml").write_text(
        LINE.replace("ports = [1]\n", 'ports = [1]\nrecipe = "own.toml"\n', 1)
    )
    assert planned(code=0) == []
    (place / "line.toml").write_text(
        LINE.replace("ports = [1]\n", 'ports = [1]\nrecipe = "own.toml"\n')
    )
    assert planned(code=0, recipe="own.toml") == []
    for verb in ("plan", "run"):
        told = planned(verb=verb, code=2)[0]
        assert told.startswith(
            "error: job.toml: is used by no station: each one that runs has its own recipe in"
            " line.toml; leave"
        )


def test_a_port_that_is_not_there_is_named_without_a_question(place: Path) -> None:
    told = planned(verb="run", code=3)
    assert not [line for line in told if "?." in line]
    assert [line for line in told if "no such port; check that it is plugged in" in line]
