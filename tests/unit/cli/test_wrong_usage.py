"""What is wrong on the command line is said before anything is made, with exit code 2."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jbclog.cli.app import app

LINE = '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports = [1]\n'
RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a line file and a recipe, and the program in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / "job.toml").write_text(RECIPE)
    return tmp_path


def refused(*arguments: str) -> str:
    """What a call says that ends with 2."""
    ended = CliRunner().invoke(app, arguments)
    assert (ended.exit_code, ended.stdout) == (2, ""), ended.output
    assert "internal error" not in ended.stderr
    return ended.stderr


@pytest.mark.parametrize("option", ["--operator", "--order", "--product", "--unit"])
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("A.\udcff", "holds bytes that are no text in this system's encoding"),
        ("A.\x1b[2J", "holds the hidden or control character U+001B"),
        ("A.\u202eissoR", "holds the hidden or control character U+202E"),
        ("A" * 201, "201 characters; at most 200 are kept"),
    ],
)
def test_texts_that_cannot_be_signed(place: Path, option: str, text: str, why: str) -> None:
    assert refused("run", "job.toml", "--line", "line.toml", option, text) == f"error: {option}: {why}\n"
    assert not (place / "runs").exists()


@pytest.mark.parametrize("tag", ["shift=\udcff", "\udcff=1", "shift=" + "1" * 200, "shift=\n", "shift"])
def test_tags_that_cannot_be_signed(place: Path, tag: str) -> None:
    assert refused("run", "job.toml", "--line", "line.toml", "--tag", tag).startswith("error: --tag")
    assert not (place / "runs").exists()


def test_names_of_people_may_have_any_letters(place: Path) -> None:
    said = CliRunner().invoke(
        app, ["run", "job.toml", "--line", "line.toml", "--operator", "Łucja Ångström 陳", "--duration", "1s"]
    )
    assert said.exit_code == 3  # the station is not there, and that is all
    assert len(list((place / "runs").iterdir())) == 1


@pytest.mark.parametrize(
    ("folder", "why"),
    [
        ("job.toml", "a file is in its way; give the name of a folder"),
        ("job.toml/below", "a file is in its way; give the name of a folder"),
        ("/proc/jbclog", "no folder can be made there (No such file or directory)"),
    ],
)
def test_virtual_stations_need_a_folder(place: Path, folder: str, why: str) -> None:
    assert refused("sim", "line.toml", "--dir", folder) == f"error: --dir {folder}: {why}\n"


def test_virtual_stations_need_a_log_that_can_be_written(place: Path) -> None:
    assert refused("sim", "line.toml", "--log", "no/log") == "error: --log no/log: cannot be written (No such file or directory)\n"


def test_virtual_stations_need_a_free_port(place: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert "cannot be served" in refused("sim", "line.toml", "--tcp", f"127.0.0.1:{taken.getsockname()[1]}")


@pytest.mark.parametrize("verb", [("check",), ("report",), ("report", "--verify"), ("check", "--json")])
def test_a_folder_that_is_no_runs(place: Path, verb: tuple[str, ...]) -> None:
    for folder, why in (("nope", "there is no such folder"), (".", "is no run's folder"), ("job.toml", "there is no such folder")):
        ended = CliRunner().invoke(app, [*verb, folder])
        assert ended.exit_code == 2
        assert why in ended.stderr
        assert "runs are in `runs/`" in ended.stderr


@pytest.mark.parametrize("verb", [("check",), ("report",)])
def test_a_run_that_was_cut_off_at_its_very_start(place: Path, verb: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    run = place / "20261121T013000Z-bench-k7qd"
    run.mkdir()
    for folder in (run.name, "."):
        ended = CliRunner().invoke(app, [*verb, folder])
        assert ended.exit_code == 4
        assert f"`jbclog recover {folder}` finishes it" in ended.stderr
        monkeypatch.chdir(run)
