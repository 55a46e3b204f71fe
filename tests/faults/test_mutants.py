"""The tool that makes mutants: those of the product can be loaded and are always the same; on
repositories of its own, what it measures, tries and reports, and that a signal ends its trials.
"""

from __future__ import annotations

import ast
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from support.campaigns import mutants
from support.command import until


@pytest.mark.parametrize(
    ("name", "package"),
    [(name, package) for name in ("safety", "layers") for package in mutants.SCOPES[name].packages],
)
def test_mutants_of_the_product_can_be_loaded_and_are_the_same_each_time(
    name: str, package: str
) -> None:
    scope = mutants.SCOPES[name]
    assert all((mutants.HERE / test).exists() for test in scope.tests)
    chosen = mutants.sample(mutants.HERE, scope, package)
    assert chosen == mutants.sample(mutants.HERE, scope, package)
    for file, _, _, node, which in random.Random(1).sample(chosen, 20):
        before = ast.unparse(ast.parse((mutants.HERE / file).read_text()))
        after = mutants.mutated(mutants.HERE / file, node, which)
        compile(after, file, "exec")
        assert ast.unparse(after) != before


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


def lay_out(place: Path, product: str, tests: str, folder: str = "guard") -> None:
    """A repository of its own, with the tool."""
    for name, text in {
        NAME: product,
        "jbclog/__init__.py": "",
        "jbclog/session/__init__.py": "",
        "jbclog/session/run/__init__.py": "",
        f"tests/unit/{folder}/test_code.py": tests,
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


def test_mutants_are_tried_where_they_are_made_and_those_that_nobody_notices_survive(
    tmp_path: Path,
) -> None:
    """Of `>` and `+`, and of what is done while the file is loaded. The lines are measured in two
    stretches, of which the first was killed.
    """
    place, work = tmp_path / "place", tmp_path / "work"
    lay_out(place, PRODUCT, TESTS)
    mine = {"cwd": place, "check": True, "timeout": 200, "capture_output": True}
    for words in (
        ["init", "-q"],
        ["add", "-A"],
        ["-c", "user.name=a", "-c", "user.email=b", "commit", "-qm", "x"],
    ):
        subprocess.run(["git", *words], **mine)
    tool = [sys.executable, "tests/support/campaigns/mutants.py"]
    subprocess.run([*tool, "cover", work], **mine)
    first, second = mutants.whole_rows(work / "cover.jsonl")
    (work / "cover.jsonl").write_text(json.dumps(first | {"took": [1.5, 1.5]}) + '\n{"test": "te')
    (work / "cover.json").unlink()
    (place / NAME).write_text("")  # of another commit, it would be
    subprocess.run([*tool, "cover", work], **mine)
    known = json.loads((work / "cover.json").read_text())
    assert known["took"].keys() == {first["test"], second["test"]}
    assert known["took"][first["test"]] == [1.5, 1.5]
    assert known["lines"][NAME]["2"] == [first["test"]]
    assert known["lines"][NAME]["7"] == [second["test"]]
    subprocess.run([*tool, "run", work, "session", "100"], **mine)
    rows = {tuple(row["mutant"][1:3]): row["outcome"] for row in mutants.rows_of(work, "session")}
    assert rows == {
        (2, "Sub"): "noticed",
        (2, "returns None"): "noticed",
        (7, "GtE"): "survived",
        (7, "returns None"): "noticed",
    } | {key: outcome for key, outcome in rows.items() if key[0] == 4}
    assert rows[4, "zero"] == "survived"
    assert rows[4, "plus 1"] == "noticed"  # the limit is 6 then
    told = subprocess.run([*tool, "report", work], text=True, **mine).stdout
    assert "session: 6, 6, 6, 4, 2, 0; 67% (30% to 90%)" in told


def test_another_repository_is_measured_with_packages_and_tests_of_a_scope(tmp_path: Path) -> None:
    place, work = tmp_path / "place", tmp_path / "work"
    lay_out(place, PRODUCT, TESTS, "session")
    mine: dict[str, Any] = {"check": True, "timeout": 200, "capture_output": True, "text": True}
    for words in (["init", "-q"], ["add", "-A"]):
        subprocess.run(["git", *words], cwd=place, **mine)
    name = ["-c", "user.name=a", "-c", "user.email=b"]
    subprocess.run(["git", *name, "commit", "-qm", "x"], cwd=place, **mine)
    tool = [sys.executable, mutants.HERE / "tests/support/campaigns/mutants.py"]
    subprocess.run([*tool, "cover", work, "layers", place], **mine)
    assert json.loads((work / "cover.json").read_text())["lines"].keys() == {NAME}
    said = subprocess.run([*tool, "report", work], **mine).stdout
    assert [line.split(":")[0] for line in said.splitlines()[1:]] == [
        *("protocol", "session", "record"),
    ]
    assert "session: 6, 6, 0, 0, 0, 0; -" in said


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
    product, test = "def double(number):\n    return number + number\n", "test_code.py::test_waits"
    work, waits = tmp_path / "work", tmp_path / "waits"
    lay_out(work / "tree", product, WAITING)
    known = {"took": {f"tests/unit/guard/{test}": [0.1, 0.1]}}
    lines = {NAME: {"2": [*known["took"]]}}
    (work / "cover.json").write_text(json.dumps(known | {"lines": lines}))
    program = work / "tree/tests/support/campaigns/mutants.py"
    command = [sys.executable, str(program), "run", str(work), "session", "100"]
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
