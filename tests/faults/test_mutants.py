"""The tool that makes mutants: those of the product can be loaded and are always the same; on
repositories of its own, what it measures, tries and reports, and that a signal ends its trials.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from support.campaigns import mutants
from support.command import until


@pytest.mark.parametrize("package", mutants.PACKAGES)
def test_mutants_of_the_product_can_be_loaded_and_are_known_apart(package: str) -> None:
    assert all((mutants.HERE / test).exists() for test in mutants.PACKAGES[package].tests)
    every = mutants.everything(mutants.HERE, package)
    assert len({mutant.identity for mutant in every}) == len(every)
    for mutant in every[:20]:
        text = (mutants.HERE / mutant.file).read_text()
        after = mutants.mutated(text, mutant.node, mutant.change)
        compile(after, mutant.file, "exec")
        assert ast.unparse(after) != ast.unparse(ast.parse(text))


NAME = "jbclog/session/run/code.py"
PRODUCT = (
    "def double(number):\n    return number + number\n\nLIMIT = double(2)\n\ndef is_over(number):\n"
    "    return number > LIMIT\n"
)
TESTS = """
from jbclog.session.run.code import double, is_over

def test_double():
    assert double(3) == 6

def test_over():
    assert is_over(5)
"""


def lay_out(place: Path, product: str, tests: str) -> list[str]:
    """A repository of its own, with the tool; the command that tries mutants of it."""
    for name, text in {
        NAME: product,
        "jbclog/__init__.py": "",
        "jbclog/session/__init__.py": "",
        "jbclog/session/run/__init__.py": "",
        "tests/unit/session/test_code.py": tests,
        "tests/support/campaigns/mutants.py": (
            (mutants.HERE / "tests/support/campaigns/mutants.py").read_text()
        ),
        "pyproject.toml": (
            '[tool.pytest.ini_options]\naddopts = ["--import-mode=importlib"]\nmarkers ='
            ' ["campaign"]\n'
        ),
    }.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text)
    commit(place)
    tool = str(place / "tests/support/campaigns/mutants.py")
    return [sys.executable, tool, "--package", "session", "--work", str(place.with_name("work"))]


def commit(place: Path) -> None:
    for words in (
        ["init", "-q"],
        ["add", "-A"],
        ["-c", "user.name=a", "-c", "user.email=b", "commit", "-qm", "x"],
    ):
        subprocess.run(["git", *words], cwd=place, check=True)


def test_mutants_are_tried_where_they_are_made_and_those_that_nobody_notices_survive(
    tmp_path: Path,
) -> None:
    """Of `>` and `+`, and of what is done while the file is loaded. The first stretch was killed
    while lines were measured and while outcomes were kept.
    """
    place, work = tmp_path / "place", tmp_path / "work"
    command = lay_out(place, PRODUCT, TESTS)
    mine: dict[str, Any] = {"cwd": place, "timeout": 200, "capture_output": True, "text": True}
    subprocess.run(command, check=True, **mine)
    data = place / "tests/data/mutants/session.csv"
    whole = mutants.rows_in(data.read_text())
    outcomes = {identity[1:]: outcome for identity, (outcome, _) in whole.items()}
    assert outcomes == {
        ("double", "Sub", "1"): "noticed",
        ("double", "returns None", "1"): "noticed",
        ("is_over", "GtE", "1"): "survived",
        ("is_over", "returns None", "1"): "noticed",
        ("LIMIT", "plus 1", "1"): "noticed",  # the limit is 6 then
        ("LIMIT", "zero", "1"): "survived",
    }
    noticed_by = whole[NAME, "double", "Sub", "1"][1]
    assert noticed_by == "tests/unit/session/test_code.py::test_double"
    first, _ = (work / "cover.jsonl").read_text().splitlines()
    (work / "cover.jsonl").write_text(first.replace("test_code", "test_kept") + '\n{"test": "te')
    *some, _, _ = data.read_text().splitlines(keepends=True)
    data.write_text("".join(some))
    subprocess.run(command, check=True, **mine)
    assert mutants.rows_in(data.read_text()) == whole
    assert "test_kept" in (work / "cover.jsonl").read_text()
    commit(place)
    weaker = TESTS.replace("double(3) == 6", "double(3) is not None")
    (place / "tests/unit/session/test_code.py").write_text(weaker)
    subprocess.run([*command, "--again", "all"], check=True, **mine)
    told = subprocess.run([*command, "--report"], check=False, **mine)
    assert told.returncode == 1
    assert "| session | 6 | 6 | 6 | 3 | 3 | 0 | 50% (19% to 81%) |" in told.stdout
    assert f"survived: {NAME} double Sub 1, was noticed by {noticed_by}" in told.stdout


WAITING = """
import os, subprocess, sys
from jbclog.session.run.code import double

WAIT = "import os, sys, time; print(os.getpid(), file=open(sys.argv[1], 'w')); time.sleep(300)"

def test_waits():
    if double(1) != 2:
        subprocess.run([sys.executable, "-c", WAIT, os.environ["WAITS"]])
"""


def is_there(pid: str) -> bool:
    """Whether a process runs; one that has ended may wait for its parent."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def test_a_signal_ends_the_trial_as_well_and_puts_its_file_back(tmp_path: Path) -> None:
    product = "def double(number):\n    return number + number\n"
    place, work, waits = tmp_path / "place", tmp_path / "work", tmp_path / "waits"
    command = lay_out(place, product, WAITING)
    with subprocess.Popen(
        command,
        env=os.environ | {"WAITS": str(waits)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as tool:
        try:
            assert until(lambda: waits.exists() and waits.read_text().endswith("\n"))
            assert (work / "tree" / NAME).read_text() != product
            other = subprocess.run(command, capture_output=True, text=True, check=False)
            assert f"another process works in {work}" in other.stderr
            tool.terminate()
            _, said = tool.communicate(timeout=60)
        finally:
            tool.kill()
    assert (tool.returncode, "ended by SIGTERM" in said) == (1, True)
    assert until(lambda: not is_there(waits.read_text().strip()), 10)
    assert (work / "tree" / NAME).read_text() == product
