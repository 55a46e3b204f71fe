"""What is wrong on the command line is said before anything is made, with exit code 2."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from jbclog.cli import main
from jbclog.record.manifest import read_manifest
from support.invoked import invoked
from support.records.few_rows import table

LINE = (
    '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports ='
    " [1]\n"
)
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
    ended = invoked(*arguments)
    assert (ended.exit_code, ended.stdout) == (2, ""), ended.output
    assert "internal error" not in ended.stderr
    return ended.stderr


ONE_PROBLEM = "1 problem; nothing sent\n"


@pytest.mark.parametrize(
    "option", ["--operator", "--order", "--product", "--unit", "--wire-lot", "--flux-lot", "--tip"]
)
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("A.\udcff", "bytes that are not text in this system's encoding"),
        ("A.\x1b[2J", "hidden or control character U+001B"),
        ("A.\u202eissoR", "hidden or control character U+202E"),
        ("A" * 201, "201 characters, at most 200"),
    ],
)
def test_texts_that_cannot_be_signed(place: Path, option: str, text: str, why: str) -> None:
    assert (
        refused("run", "job.toml", "--line", "line.toml", option, text)
        == f"error: {option}: {why}\n{ONE_PROBLEM}"
    )
    assert not (place / "runs").exists()


@pytest.mark.parametrize("bare", ["5", "1.5", "1h30"])
def test_a_duration_needs_its_unit(place: Path, bare: str) -> None:
    expected = (
        f"error: --duration {bare}: give the unit: {bare}s, {bare}m or {bare}h\n{ONE_PROBLEM}"
    )
    assert refused("run", "job.toml", "--line", "line.toml", "--duration", bare) == expected
    assert not (place / "runs").exists()


@pytest.mark.parametrize(
    "tag", ["shift=\udcff", "\udcff=1", "shift=" + "1" * 200, "shift=\n", "shift"]
)
def test_tags_that_cannot_be_signed(place: Path, tag: str) -> None:
    assert refused("run", "job.toml", "--line", "line.toml", "--tag", tag).startswith(
        "error: --tag"
    )
    assert not (place / "runs").exists()


@pytest.mark.parametrize("tip", ["dde-2=T245", "dde-1:2=T245", "dde-1=", "=T245"])
def test_a_tip_is_in_a_tool_of_this_run(place: Path, tip: str) -> None:
    assert refused("run", "job.toml", "--line", "line.toml", "--tip", tip).startswith(
        f"error: --tip {tip}: give ID, STATION=ID"
    )


def test_a_dry_run_asks_for_nothing_and_says_what_run_will_ask_for(place: Path) -> None:
    (place / "job.toml").write_text(f'{RECIPE}[metadata]\nrequired = ["operator", "wire_lot"]\n')
    planned = invoked("plan", "job.toml", "--line", "line.toml")
    assert planned.exit_code == 0
    assert "note: job.toml requires --operator … --wire-lot …: give it to `run`\n" in planned.stderr


def test_a_tag_has_one_value(place: Path) -> None:
    told = refused("run", "job.toml", "--line", "line.toml", "--tag", "shift=1", "--tag", "shift=2")
    assert told == f"error: --tag shift=2: shift is given twice\n{ONE_PROBLEM}"


def test_what_the_recipe_requires_is_asked_for_by_its_option(place: Path) -> None:
    names = ["operator", "order", "product", "unit", "wire_lot", "flux_lot", "tip", "tag.shift"]
    (place / "job.toml").write_text(f"{RECIPE}[metadata]\nrequired = {names}\n")
    told = refused("run", "job.toml", "--line", "line.toml", "--operator", "A", "--tip", "T1")
    assert "give --order … --product … --unit … --wire-lot … --flux-lot … --tag shift=…" in told


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (b"SN-1\nSN\x1d2\n", "hidden characters"),
        (b"X" * 201, "too long"),
        (b"SN\n" * 400_000, "not a list of serials"),
    ],
)
def test_a_list_of_serials_that_is_none(place: Path, text: bytes, why: str) -> None:
    (place / "serials.txt").write_bytes(text)
    assert why in refused("run", "job.toml", "--line", "line.toml", "--units", "serials.txt")
    assert not (place / "runs").exists()


@pytest.mark.parametrize("name", ["nowhere.txt", "."])
def test_serials_from_nowhere(place: Path, name: str) -> None:
    assert refused("run", "job.toml", "--line", "line.toml", "--units", name).startswith(
        f"error: --units {name}"
    )


def test_a_list_of_serials_names_the_units_of_the_run(place: Path) -> None:
    (place / "serials.txt").write_bytes(b"\xef\xbb\xbfSN-1\r\nSN-2\r\n\r\nSN-1")
    ended = invoked(
        "run",
        "job.toml",
        "--line",
        "line.toml",
        "--units",
        "serials.txt",
        "--unit",
        "SN-0",
        "--duration",
        "1s",
    )
    assert ended.exit_code == 3  # the station is not there
    manifest = read_manifest(next((place / "runs").iterdir()))
    assert (manifest.metadata.units, manifest.units) == (["SN-0", "SN-1", "SN-2"], [])


def test_a_recipe_that_requires_a_unit_and_none_that_is_read(place: Path) -> None:
    (place / "job.toml").write_text(f'{RECIPE}[metadata]\nrequired = ["unit"]\n')
    assert "give --unit …" in refused("run", "job.toml", "--line", "line.toml")
    os.mkfifo(place / "serials")
    invoked("run", "job.toml", "--line", "line.toml", "--units", "serials", "--duration", "1s")
    events = table(next((place / "runs").iterdir()), "events")
    assert "unit.missing" in events["kind"].to_pylist()


def test_names_of_people_may_have_any_letters(place: Path) -> None:
    said = invoked(
        "run",
        "job.toml",
        "--line",
        "line.toml",
        "--operator",
        "Łucja Ångström 陳",
        "--duration",
        "1s",
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
    assert (
        refused("sim", "line.toml", "--log", "no/log")
        == "error: --log no/log: cannot write: No such file or directory\n"
    )


def test_virtual_stations_need_a_free_port(place: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert "cannot be served" in refused(
            "sim", "line.toml", "--tcp", f"127.0.0.1:{taken.getsockname()[1]}"
        )


@pytest.mark.parametrize("verb", [("check",), ("report",), ("check", "--json")])
def test_a_folder_that_is_no_runs(place: Path, verb: tuple[str, ...]) -> None:
    for folder, why in (
        ("nope", "no such folder"),
        (".", "not a run"),
        ("job.toml", "no such folder"),
    ):
        ended = invoked(*verb, folder)
        assert ended.exit_code == 2
        assert why in ended.stderr
        assert "runs are in `runs/`" in ended.stderr


@pytest.mark.parametrize("verb", [("check",), ("report",)])
def test_a_run_that_was_cut_off_at_its_very_start(
    place: Path, verb: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = place / "20261121T013000Z-bench-k7qd"
    run.mkdir()
    for folder in (run.name, "."):
        ended = invoked(*verb, folder)
        assert ended.exit_code == 4
        assert f"finish it with `jbclog recover {folder}`" in ended.stderr
        monkeypatch.chdir(run)


WRITTEN = (
    ("trend", "runs", "--html", "there"),
    ("trend", "runs", "--plot", "there.png"),
    ("chart", "runs", "--plot", "there.png"),
    ("sim", "line.toml", "--log", "there"),
    ("sim", "line.toml", "--dir", "served"),
)


@pytest.mark.parametrize("words", WRITTEN, ids=lambda words: f"{words[0]} {words[2]}")
def test_nothing_is_written_into_a_pipe_that_nobody_may_ever_read(
    place: Path, words: tuple[str, ...]
) -> None:
    (place / "runs").mkdir()
    (place / "served").mkdir()
    os.mkfifo(place / ("served/line.toml" if words[-1] == "served" else words[-1]))
    assert "not a regular file (folder, pipe or device)" in refused(*words)


@pytest.mark.parametrize(
    "words",
    [
        ("audit", "--line", "line.toml", "--ledger", "loop"),
        ("sim", "line.toml", "--dir", "loop"),
        ("plan", "loop", "--line", "line.toml"),
        ("check", "loop"),
        ("chart", "loop"),
        ("limits", "loop", "--metric", "dwell_s"),
    ],
    ids=" ".join,
)
def test_a_link_to_itself_is_no_internal_error(place: Path, words: tuple[str, ...]) -> None:
    (place / "loop").symlink_to("loop")
    ended = invoked(*words)
    assert ended.exit_code in range(1, 5)
    assert "internal error" not in ended.stderr
    assert "error: " in ended.stderr


@pytest.mark.parametrize("words", [("runs",), ("check", "x"), ("watch", "--web"), ("doctor",)])
def test_a_current_folder_that_was_removed_is_no_internal_error(
    place: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    (place / "gone").mkdir()
    monkeypatch.chdir(place / "gone")
    (place / "gone").rmdir()
    assert refused(*words) == (
        "error: the current folder was removed; change into another one (`cd`) and try again\n"
    )


def test_memory_that_is_refused_to_the_end_is_one_line_and_exit_code_4(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refused() -> None:
        raise MemoryError

    def ended(code: int) -> None:
        raise SystemExit(code)

    monkeypatch.setattr("jbclog.cli.app.app", refused)
    monkeypatch.setattr("jbclog.cli.app.make_usable", lambda: None)
    monkeypatch.setattr("os._exit", ended)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 4
    assert (
        capfd.readouterr().err
        == "jbclog: memory was refused; `jbclog recover` finishes the record\n"
    )
