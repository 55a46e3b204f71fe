"""`jbclog init`: its questions end in files that `plan` and `run` take, and overwrite nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import Result

from jbclog.config.line import load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.core.outcome import Exit
from jbclog.protocol.commands.family import FAMILIES
from support.invoked import invoked
from support.virtual.served_line import ServedLine

HAND = ["hand", "dde", "/dev/ttyUSB7", "", "no", "first", "355"]


def answered(folder: Path, answers: list[str]) -> Result:
    return invoked("init", folder, input="\n".join([*answers, ""]))


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_each_family_gets_files_that_are_taken(tmp_path: Path, family: str) -> None:
    answers = ["hand", family, "socket://10.0.0.4:4001", "", "no", "", ""]
    assert answered(tmp_path, answers).exit_code == 0
    line = load_line(tmp_path / "line.toml")
    (station,) = line.stations
    assert (station.name, station.family, station.baudrate) == (
        f"{family}-1",
        family,
        9600 if family == "omega" else 19200,
    )
    assert station.recipe == tmp_path / "recipe.toml"
    assert load_recipe(tmp_path / "recipe.toml").families == (family,)
    planned = invoked("plan", "--line", tmp_path / "line.toml")
    assert planned.exit_code == 0, planned.output


def test_what_is_answered_is_in_the_files(tmp_path: Path) -> None:
    done = answered(tmp_path, HAND)
    assert "Nothing was written to a station." in done.stderr
    assert f"Next: jbclog plan --line {tmp_path / 'line.toml'}" in done.stderr
    text = (tmp_path / "recipe.toml").read_text()
    assert 'name = "first"' in text
    assert "select_c = 355 " in text


def test_a_wrong_answer_is_asked_for_again(tmp_path: Path) -> None:
    answers = [
        "hnd",
        "hand",
        "DDDE",
        "DDE",
        "sockets://x",
        "/dev/ttyUSB7",
        "a name",
        "",
        "no",
        "",
        "352",
        "500",
        "350",
    ]
    done = answered(tmp_path, answers)
    assert done.exit_code == 0, done.output
    for text in (
        "must be scan or hand",
        "did you mean dde?",
        'the kind of port "sockets" is unknown',
        "is not allowed; 1 to 64 of the characters",
        "must be whole °C, 90 to 450 in steps of 5",
    ):
        assert text in done.stderr


def test_two_stations_on_one_port_are_refused_and_asked_for_again(tmp_path: Path) -> None:
    answers = [
        "hand",
        "dde",
        "/dev/ttyUSB7",
        "",
        "yes",
        "nae",
        "/dev/ttyUSB7",
        "",
        "nae",
        "/dev/ttyUSB8",
        "",
        "no",
        "",
        "",
    ]
    done = answered(tmp_path, answers)
    assert "This station is not taken; enter it again." in done.stderr
    assert [one.url for one in load_line(tmp_path / "line.toml").stations] == [
        "/dev/ttyUSB7",
        "/dev/ttyUSB8",
    ]


def test_tips_hot_air_and_omega_have_a_recipe_each(tmp_path: Path) -> None:
    answers = [
        "hand",
        "dde",
        "/dev/a",
        "",
        "y",
        "jtse",
        "/dev/b",
        "",
        "y",
        "omega",
        "/dev/c",
        "",
        "n",
        "x",
        "350",
        "300",
    ]
    assert answered(tmp_path, answers).exit_code == 0
    recipes = {
        one.family: one.recipe.name
        for one in load_line(tmp_path / "line.toml").stations
        if one.recipe
    }
    assert recipes == {
        "dde": "recipe-tips.toml",
        "jtse": "recipe-hot-air.toml",
        "omega": "recipe-omega.toml",
    }
    assert invoked("plan", "--line", tmp_path / "line.toml").exit_code == 0


@pytest.mark.parametrize("name", ["line.toml", "recipe.toml"])
def test_nothing_is_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    done = answered(tmp_path, HAND)
    assert (done.exit_code, [path.name for path in tmp_path.iterdir()]) == (2, [name])
    assert f"{tmp_path / name}: exists; init overwrites nothing" in done.stderr
    assert (tmp_path / name).read_text() == "mine"


def test_a_folder_is_made_with_its_files(tmp_path: Path) -> None:
    assert answered(tmp_path / "a" / "b", HAND[:4]).exit_code == 2
    assert list(tmp_path.iterdir()) == []  # not before the last answer
    assert answered(tmp_path / "a" / "b", HAND).exit_code == 0
    assert {one.name for one in (tmp_path / "a" / "b").iterdir()} == {"line.toml", "recipe.toml"}
    (tmp_path / "file").write_text("")
    done = answered(tmp_path / "file" / "b", HAND)
    assert done.exit_code == 2
    assert "cannot write: Not a directory" in done.stderr


def test_answers_that_end_early_write_nothing(tmp_path: Path) -> None:
    assert answered(tmp_path, HAND[:4]).exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_a_scan_finds_a_station(tmp_path: Path) -> None:
    made = tmp_path / "made"
    made.mkdir()
    with ServedLine(tmp_path) as line:
        url = line.url("dde-1")
        done = answered(made, ["scan", url, "first", "340"])
        assert done.exit_code == 0, done.output
        (station,) = load_line(made / "line.toml").stations
        assert (station.family, station.url) == ("dde", url)
    assert "select_c = 340 " in (made / "recipe.toml").read_text()


def interrupted(asking: subprocess.Popen[bytes]) -> int:
    """What it ends with. Python does not see a signal that comes just before it reads; as anybody
    would, this presses again.
    """
    for _ in range(6):
        asking.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            return asking.wait(5)
    raise AssertionError("it asks on")


def test_ctrl_c_at_a_question_is_an_interruption(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from jbclog.cli import main; main()", "init", str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as asking:
        assert asking.stderr is not None
        assert asking.stderr.read(4) == b"Find"
        assert interrupted(asking) == Exit.INTERRUPTED
    assert list(tmp_path.iterdir()) == []


def test_without_a_terminal_it_names_the_options_that_answer(tmp_path: Path) -> None:
    ended = invoked("init", tmp_path, input="")
    assert ended.exit_code == 2
    assert "Aborted" not in ended.stderr
    answers = (
        "--scan PORT or --station FAMILY=PORT, --recipe NAME, --tip-c C, for hot air --air-c C"
    )
    assert ended.stderr.endswith(f"answer them with options: {answers}\n")
    assert list(tmp_path.iterdir()) == []


def test_options_answer_every_question(tmp_path: Path) -> None:
    stations = ["--station", "dde=/dev/ttyUSB7", "--station", "jtse=socket://10.0.0.4:4001"]
    answers = ["--recipe", "first", "--tip-c", "355", "--air-c", "310"]
    assert invoked("init", tmp_path, *stations, *answers, input="").exit_code == 0
    assert [one.name for one in load_line(tmp_path / "line.toml").stations] == ["dde-1", "jtse-1"]
    assert "select_c = 355 " in (tmp_path / "recipe-tips.toml").read_text()
    assert "temperature_c = 310 " in (tmp_path / "recipe-hot-air.toml").read_text()


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--station", "ddde=x"], "--station ddde: unknown; did you mean dde?"),
        (["--station", "dde"], "--station dde: must be FAMILY=PORT"),
        (["--station", "dde=sockets://x"], 'the kind of port "sockets" is unknown'),
        (["--station", "dde=x", "--recipe", "a b"], "--recipe a b: is not allowed; 1 to 64"),
        (
            ["--station", "dde=x", "--recipe", "a", "--tip-c", "351"],
            "--tip-c 351: must be whole °C, 90 to 450 in steps of 5",
        ),
    ],
)
def test_a_wrong_option_is_refused(tmp_path: Path, options: list[str], why: str) -> None:
    ended = invoked("init", tmp_path, *options, input="")
    assert ended.exit_code == 2
    assert why in ended.stderr


def test_an_empty_answer_is_asked_for_again_with_the_reason(tmp_path: Path) -> None:
    done = answered(tmp_path, ["hand", "", *HAND[1:]])
    assert done.exit_code == 0, done.output
    assert "Error: an answer is required; Ctrl-C ends without writing" in done.stderr


def test_the_example_of_a_port_is_one_of_this_system(tmp_path: Path) -> None:
    asked = answered(tmp_path, HAND).stderr
    assert "COM3" not in asked
    assert "Its port (/dev/" in asked
