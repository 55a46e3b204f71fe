"""The documentation's command blocks and snippets run: tutorials from their first block to their
last, on virtual stations.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from os import environ
from pathlib import Path

import pytest

from support import warm_command
from support.command import started, until
from support.product import SAMPLE_COLUMNS, load_line
from support.readers.texts import DOCS, FENCE, ROOT, Demo, blocks, text_of
from support.warm_start import connected

COMMAND = warm_command.__file__
INSTALLING = ("python3 -m", ".venv/bin/jupyter", "sudo ", "ls -l /dev/serial")
SHORTER = {
    "--duration 3m &": "--duration 60s 2>killed.err &",
    "sleep 20": (
        """until [ "$(grep -c 'sampled at' killed.err)" = 4 ]; do sleep 0.2; done; sleep 4"""
    ),
    "sleep 3\n": (
        "for i in {1..150}; do ! grep -q '[^ ]' runs/*/guard.jsonl 2>/dev/null || break; sleep 0.2;"
        " done; sleep 3\n"
    ),
    "--duration 3m": "--duration 3s",
    "--duration 1m": "--duration 3s",
    "/dev/serial/by-id/ADAPTER": "$PWD/virtual/dde-1",
    'ack "$RUN" EPISODE': (
        'ack "$RUN" "$(jbclog alarms "$RUN" 2>&1 | sed -n \'s/.* ack [^ ]* \\([^ ]*\\)'
        " --by.*/\\1/p')\""
    ),
    "3f2a-91bc-77de-0a12-5c08-b6e1": (
        '"$(jbclog check "$RUN" | sed -n \'s/.*(fingerprint \\(.*\\))$/\\1/p\')"'
    ),
}
"""What a test types in place of the page's words: shorter times, and what stands for a name of the
reader's.
"""


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like a clone, with `jbclog` on the path of its `bin`."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / "profiles").symlink_to(ROOT / "profiles")
    (folder / "bin").mkdir()
    program = folder / "bin" / "jbclog"
    program.write_text(
        f"#!{sys.executable} -IS\nimport"
        f" runpy\nrunpy.run_path({COMMAND!r})['main']({str(connected())!r})\n"
    )
    program.chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def bench(clone: Path) -> Iterator[Path]:
    """The first terminal of the tutorials: `jbclog sim profiles/lines/bench.toml`."""
    stations = started("sim", ROOT / "profiles/lines/bench.toml", "--dir", clone / "virtual")
    try:
        assert until((clone / "virtual/line.toml").exists)
        yield clone
    finally:
        stations.send_signal(signal.SIGINT)
        _, noted = stations.communicate(timeout=200)
        assert stations.returncode == 0, noted


def typed(page: str) -> str:
    """The commands of a page in order, but for those that install something and the first
    terminal's.
    """
    lines = "".join(blocks("sh", text_of(page))).splitlines()
    script = "\n".join(line for line in lines if not line.startswith((*INSTALLING, "jbclog sim ")))
    for words, shorter in SHORTER.items():
        script = script.replace(words, shorter)
    return script


def write_files(page: str, folder: Path) -> None:
    """The files that a page prints: TOML blocks whose first line is a comment with their name."""
    for block in blocks("toml", text_of(page)):
        name = re.match(r"# (\w+\.toml)\n", block)
        if name:
            (folder / name[1]).write_text(re.sub(r'"(90s|3m)"', '"3s"', block), encoding="utf-8")


def follow(
    page: str, folder: Path, bin_folder: Path
) -> tuple[list[str], subprocess.CompletedProcess[str]]:
    """Type the page's commands; the commands that ended with another code than 0, as "CODE VERB",
    and what was printed.
    """
    write_files(page, folder)
    script = "trap 'echo \"FAILED $? $BASH_COMMAND\" >&2' ERR\n" + typed(page)
    paths = {**environ, "PATH": f"{bin_folder}:{environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env=paths,
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    failed = re.findall(r"^FAILED (\d+) (?:\w+=\$\()?(?:jbclog )?(\S+)", done.stderr, re.MULTILINE)
    return [" ".join(one) for one in failed], done


# -- tutorials -------------------------------------------------------------------------------------


def test_the_first_run(bench: Path) -> None:
    failed, done = follow("tutorials/first-run.md", bench, bench / "bin")
    # three seconds show no tip at rest; the three minutes of the text do
    assert failed == ["1 run"], done.stderr
    assert "Line bench: 4 stations. No byte sent." in done.stdout
    assert "report.html\n" in done.stdout
    assert ": no differences (fingerprint " in done.stdout
    assert "nothing to recover\n" in done.stdout
    first, killed = sorted((bench / "runs").glob("*-bench-*"))
    assert killed.name in done.stdout
    assert (killed / "guard.jsonl").read_text().strip()
    assert not (first / "guard.jsonl").exists()


def test_the_first_station(bench: Path, tmp_path: Path) -> None:
    (tmp_path / "virtual").symlink_to(bench / "virtual")
    failed, done = follow("tutorials/first-station.md", tmp_path, bench / "bin")
    # of this machine's clock; of a tip still approaching
    assert set(failed) <= {"1 doctor", "1 run"}, done.stderr
    assert load_line(tmp_path / "line.toml").stations[0].family == "dde"
    assert "No byte sent." in done.stdout
    assert ": no differences (fingerprint " in done.stdout
    assert "already in stand" in done.stdout


def test_the_first_batch(bench: Path, tmp_path: Path) -> None:
    (tmp_path / "virtual").symlink_to(bench / "virtual")
    (tmp_path / "profiles").symlink_to(ROOT / "profiles")
    failed, done = follow("tutorials/first-batch.md", tmp_path, bench / "bin")
    assert set(failed) <= {"1 batch"}, done.stderr  # a tip may not be hot in 5 s
    runs = [run.name for run in (tmp_path / "runs").glob("*-bench-*")]
    # in the batch's table, and found by their tag
    assert [done.stdout.count(f"runs/{run}") for run in runs] == [2, 2, 2]


def test_signing_a_run(demo: Demo, clone: Path, tmp_path: Path) -> None:
    shutil.copytree(demo.place / "demo-runs", tmp_path / "demo-runs")
    failed, done = follow("tutorials/sign-a-run.md", tmp_path, clone / "bin")
    assert failed == ["1 alarms"], done.stderr  # before the alarm is acknowledged
    run = next((tmp_path / "demo-runs").iterdir())
    notes = (run / "annotations.jsonl").read_text()
    assert "limit set too low for this tip" in notes
    assert "SN-0012 was scrapped" in notes


def test_auditing_a_line(bench: Path) -> None:
    failed, done = follow("tutorials/audit-a-line.md", bench, bench / "bin")
    assert set(failed) <= {"1 audit"}, done.stderr
    assert (bench / "audit.html").exists()
    assert "tip-change" in done.stdout


# -- snippets --------------------------------------------------------------------------------------


SNIPPETS = {
    page.name: block
    for page in DOCS.rglob("*.md")
    for block in blocks("python", page.read_text(encoding="utf-8"))
}  # the last of each page


def test_there_are_no_other_snippets() -> None:
    # those of publish.md run in unit/analysis/test_published.py, the ten questions and the page of
    # SQL in test_ten_jobs.py
    assert set(SNIPPETS) == {
        "many-runs.md",
        "publish.md",
        "read-a-run.md",
        "ten-questions.md",
        "watch.md",
    }


def test_the_snippet_of_the_live_view_runs_on_a_demo(demo: Demo, tmp_path: Path) -> None:
    (tmp_path / "runs").symlink_to(demo.place / "demo-runs")
    command = [sys.executable, "-W", "error", "-u", "-c", SNIPPETS["watch.md"]]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as watching:
        assert watching.stdout is not None
        shown = [watching.stdout.readline().split()[:3] for _ in range(6)]
        watching.kill()
    assert sorted(place[0] for place in shown) == [
        "ale-1",
        "dde-1",
        "dde-1",
        "dde-2",
        "dde-2",
        "ucr-1",
    ]


def test_the_python_snippet_runs_on_a_demo(demo: Demo) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SNIPPETS["read-a-run.md"]],
        cwd=demo.place,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "REJECT ['dde-1', 'dde-2', 'ucr-1', 'ale-1']" in done.stdout
    assert "high-temperature alarm" in done.stdout
    assert re.search(r"^ +dispensed_mm +\d", done.stdout, re.MULTILINE)
    assert (demo.place / "ucr-1.png").read_bytes().startswith(b"\x89PNG")


def test_the_snippet_of_many_runs_runs_on_a_demo(demo: Demo) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SNIPPETS["many-runs.md"]],
        cwd=demo.place,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(rf"^0 +{demo.run.name} +\w+-1 +\d +high ", done.stdout, re.MULTILINE)
    assert re.search(rf"^{demo.run.name} +ale-1 +1 +[\d.]+$", done.stdout, re.MULTILINE)
    assert (demo.place / "recovery.png").read_bytes().startswith(b"\x89PNG")


def test_the_line_file_snippet_is_a_line_file(tmp_path: Path) -> None:
    write_files("how-to/connect.md", tmp_path)
    (station,) = load_line(tmp_path / "line.toml").stations
    assert (station.family, station.ports, station.baudrate, station.format, station.address) == (
        "dde",
        (1, 2),
        19200,
        "8N1",
        1,
    )


def test_every_toml_block_is_a_file_that_a_test_reads() -> None:
    """Each names its file in its first line, and stands on a page whose test above loads it."""
    loaded = {"how-to/connect.md", "tutorials/first-station.md", "tutorials/first-batch.md"}
    for page in DOCS.rglob("*.md"):
        for block in blocks("toml", page.read_text(encoding="utf-8")):
            assert page.relative_to(DOCS).as_posix() in loaded, page
            assert re.match(r"# \w+\.toml\n", block), page


def test_every_block_is_of_a_kind_that_a_test_knows() -> None:
    """`text` is printed, not typed; `yaml` is another program's file."""
    known = {"sh", "toml", "python", "sql", "text", "yaml", "{toctree}", "{admonition}"}
    kinds = {
        name.split()[0] if name else ""
        for page in DOCS.rglob("*.md")
        for name, _ in FENCE.findall(page.read_text("utf-8"))
    }
    assert kinds <= known


# -- what the pages repeat of the code -------------------------------------------------------------


def test_the_run_folder_is_as_described(demo: Demo) -> None:
    cells = re.findall(r"^\| (`[^|]+) \|", text_of("reference/run-folder.md"), re.MULTILINE)
    named = {name.rstrip("/") for cell in cells for name in re.findall(r"`([\w./]+)`", cell)}
    assert {path.name for path in demo.run.iterdir()} <= named


def test_the_columns_that_a_snippet_names_exist() -> None:
    snippets = "".join(blocks("python", text_of("how-to/read-a-run.md")))
    named = set(re.findall(r'"(\w+_c|power_permille|status|quality|time)"', snippets))
    assert named
    assert named <= set(SAMPLE_COLUMNS)
