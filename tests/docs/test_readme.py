"""What README.md says is true: its commands run, its snippets run, its tables are the code's, its links lead somewhere."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from command import jbclog, started, until
from newcomer import Demo
from readme import PROSE, ROOT, blocks, commands, headings, links, rows, section
from verbs import VERBS, calls, wrong

import jbclog as package
from jbclog.config.line import load_line
from jbclog.core.errors import Exit
from jbclog.core.locks import NAME as LOCK
from jbclog.core.rows import SAMPLE_COLUMNS
from jbclog.protocol.commands.family import FAMILIES
from jbclog.record.chains import short_head
from jbclog.record.manifest import manifest_sha256
from jbclog.record.parts import DAMAGE_NOTES, REMAINS
from jbclog.record.store import RESERVE

INSTALL = "python3 -m venv --without-pip .venv && python3 -m pip --python .venv install "


# -- the two commands -------------------------------------------------------------------------------------------------------


def test_the_first_two_commands_are_whole() -> None:
    demo, tests = section("Try it").split("```sh\n")[1:]
    assert demo.splitlines()[0] == INSTALL + ". && .venv/bin/jbclog demo"
    assert tests.splitlines()[0] == INSTALL + "-e '.[test]' && .venv/bin/pytest"


def test_what_they_install_exists() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {extra for block in commands() for extras in re.findall(r"\.\[([\w,]+)\]", block) for extra in extras.split(",")}
    assert named <= set(project["optional-dependencies"])
    assert project["scripts"] == {"jbclog": "jbclog.cli:main"}


def test_the_demo_says_what_happened_and_where_everything_is(demo: Demo) -> None:
    said = demo.said.stdout
    assert "dde-2 dropped out for three seconds and came back" in said
    assert "ucr-1 raised its high-temperature alarm" in said
    assert "would have ended with exit code 1" in said
    named = [line.split()[1] for line in said.splitlines() if re.match(r"(report|samples|events|manifest|run) ", line)]
    assert len(named) == 5
    assert all((demo.place / path).exists() for path in named)


# -- by hand ----------------------------------------------------------------------------------------------------------------


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A place that looks like a clone, with `jbclog` on the path of its `bin`."""
    (tmp_path / "profiles").symlink_to(ROOT / "profiles")
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "jbclog"
    program.write_text(f"#!{sys.executable}\nfrom jbclog.cli import main\nmain()\n")
    program.chmod(0o755)
    return tmp_path


def test_by_hand_with_two_terminals(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", f"{clone / 'bin'}:{os.environ['PATH']}")
    monkeypatch.chdir(clone)
    first, second = section("By hand, with two terminals").split("```sh\n")[1:]
    (arguments,) = calls(first.partition("```")[0])
    typed = second.partition("```")[0]
    assert "--duration 3m" in typed
    stations = started(*arguments)
    try:
        assert until(Path("virtual/line.toml").exists)
        script = "set -x\n" + typed.replace("--duration 3m", "--duration 3s")
        done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=200, check=False)
    finally:
        stations.send_signal(signal.SIGINT)
        told, noted = stations.communicate(timeout=200)
    assert (stations.returncode, told) == (0, "virtual/line.toml\n"), noted
    assert done.returncode == 0, done.stderr
    (run,) = Path("runs").iterdir()
    assert "Line bench: 4 stations. No byte was sent." in done.stdout
    assert done.stdout.splitlines()[-3:] == [
        f"{run}/report.html",
        f"{run}: everything agrees (head {short_head(manifest_sha256(run))})",
        f"{run.name}: finished already; nothing was changed.",
    ]
    assert "INCONCLUSIVE; exit code 1" in done.stderr  # three seconds show no tip at rest; the three minutes of the text do


# -- snippets ---------------------------------------------------------------------------------------------------------------


def test_the_python_snippet_runs_on_a_demo(demo: Demo) -> None:
    (snippet,) = blocks("python")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", snippet], cwd=demo.place, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "REJECT ['dde-1', 'dde-2', 'ucr-1', 'ale-1']" in done.stdout
    assert "high-temperature alarm" in done.stdout
    assert re.search(r"^dispensed_mm +\d", done.stdout, re.MULTILINE)
    assert (demo.place / "ucr-1.png").read_bytes().startswith(b"\x89PNG")


def test_the_line_file_snippet_is_a_line_file(tmp_path: Path) -> None:
    (text,) = blocks("toml")
    (tmp_path / "line.toml").write_text(text)
    (station,) = load_line(tmp_path / "line.toml").stations
    assert (station.family, station.ports, station.baudrate, station.format, station.address) == ("dde", (1, 2), 19200, "8N1", 1)


# -- tables -----------------------------------------------------------------------------------------------------------------


def test_the_exit_codes_are_the_codes() -> None:
    assert [int(code) for code, _ in rows("Exit codes")] == [code.value for code in Exit]


def test_the_families_are_those_that_are_driven() -> None:
    assert {name for cells in rows("Families") for name in re.findall(r"`(\w+)`", cells[0])} == set(FAMILIES)


def test_the_run_folder_is_as_told(demo: Demo) -> None:
    page = (ROOT / "docs" / "reference" / "run-folder.md").read_text(encoding="utf-8")
    told = {
        name.rstrip("/") for cell in re.findall(r"^\| (`.+?) \| ", page, re.MULTILINE) for name in re.findall(r"`([^`]+)`", cell)
    }
    other = {
        "live.sqlite",
        LOCK,
        RESERVE,
        DAMAGE_NOTES,
        REMAINS,
        "wire",
        "lease.json",
        "guard.lock",
        "guard.jsonl",
    }  # of a run that is open, and of one that was damaged
    assert told >= other
    assert told - other == {path.name for path in demo.run.iterdir()}


def test_the_columns_that_are_named_exist() -> None:
    brief = section("The run folder").partition("`samples` in brief, among others:")[2].partition("**A null means")[0]
    named = set(re.findall(r"`(\w+)`", brief))
    assert named
    assert named <= {*SAMPLE_COLUMNS, "ale"}


def test_verbs_and_options_exist() -> None:
    assert [fault for text in commands() for words in calls(text) if (fault := wrong(words))] == []


def test_every_verb_is_told() -> None:
    assert set(VERBS) == {words[0] for text in commands() for words in calls(text)} & set(VERBS)


def test_what_is_not_there_yet_is_not_there() -> None:
    missing = re.search(r"^Not there yet: (.+?)\n\n", section("Families"), re.MULTILINE | re.DOTALL)
    assert missing
    assert not {*re.findall(r"`(\w+)`", missing[1])} & set(VERBS)


# -- links ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("link", [link for link in links() if "://" not in link])
def test_a_link_leads_somewhere(link: str) -> None:
    path, _, anchor = link.partition("#")
    assert not anchor or anchor in headings()
    assert (ROOT / path).exists()


def test_paths_in_the_prose_exist() -> None:
    named = re.findall(r"`((?:tests|profiles|jbclog|notebooks|\.ci)/[\w./-]+)`", PROSE)
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_pictures_are_small() -> None:
    report, audit = (ROOT / link for link in links() if link.endswith(".png"))
    assert report.stat().st_size < 300_000 > audit.stat().st_size


def test_the_version_has_its_place_in_the_changelog() -> None:
    assert f"\n## [{package.__version__}] - 20" in (ROOT / "CHANGELOG.md").read_text()
    assert jbclog("--version").stdout == f"jbclog {package.__version__}\n"
