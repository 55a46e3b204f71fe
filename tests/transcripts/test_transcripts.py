"""What each command says, sends and ends with, as a person sees it: `tests/transcripts/*.txt`.

``pytest tests/transcripts --accept`` writes the transcripts anew; the diff is what changed.
"""

from __future__ import annotations

import fcntl
import re
from pathlib import Path

import pytest

from jbclog.cli.front_page import COMMANDS
from support.transcripts.stage import Stage

HOME = Path(__file__).parent
FILES = sorted(HOME.glob("*.txt"))
CASE = "# "
"""Begins a case, with its title. A case reads:

given: what is there before; the names stand in `support/transcripts/given.py`
file NAME, then `| ` and each line of a file that is written
$ a command, then `< ` and each line that is typed
> what it sent, `  ` what it printed, `! ` what it noted (stderr), and `exit` with its code
"""


def cases(path: Path) -> list[str]:
    """The texts of the cases in a file, behind whatever stands above the first."""
    _, *texts = f"\n{path.read_text(encoding='utf-8')}".split(f"\n{CASE}")
    return [f"{CASE}{text}" for text in texts]


def title(case: str) -> str:
    return case.partition("\n")[0].removeprefix(CASE)


def played(case: str, stage: Stage) -> str:
    """The case as it comes now: what was given and typed, with what the commands did."""
    lines = case.splitlines()
    new: list[str] = []
    while lines:
        line = lines.pop(0)
        if not line.startswith((CASE, "given: ", "file ", "$ ")):
            continue
        new.append(line)
        following: list[str] = []
        while lines and lines[0][:2].rstrip() in ("|", "<"):
            following.append(lines.pop(0))
        new += following
        texts = [text[2:] for text in following]
        word, _, rest = line.partition(" ")
        if word == "given:":
            stage.give(rest)
        elif word == "file":
            stage.write(rest, texts)
        elif word == "$":
            new += stage.run(rest, texts)
    return "\n".join(new)


def accept(path: Path, before: str, after: str) -> None:
    """Write a case anew, beside other workers that do the same."""
    with path.open("r+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        texts = [after if text == before else text.rstrip() for text in cases(path)]
        head = path.read_text(encoding="utf-8").partition(CASE)[0]
        path.write_text(head + "\n\n".join(texts) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("path", "case"),
    [
        pytest.param(path, case, id=f"{path.stem}: {title(case)}")
        for path in FILES
        for case in cases(path)
    ],
)
def test_transcript(path: Path, case: str, stage: Stage, pytestconfig: pytest.Config) -> None:
    now = played(case, stage)
    if pytestconfig.getoption("--accept"):
        accept(path, case, now)
        return
    assert now.splitlines() == case.rstrip().splitlines()


TEXT = "\n".join(path.read_text(encoding="utf-8") for path in FILES)


def test_every_exit_code_is_in_a_transcript() -> None:
    reference = (HOME.parents[1] / "docs" / "reference" / "exit-codes.md").read_text("utf-8")
    codes = re.findall(r"^\| (\d+) \|", reference, re.MULTILINE)
    assert set(re.findall(r"^exit (\d+)$", TEXT, re.MULTILINE)) == set(codes)


def test_every_command_is_in_a_transcript() -> None:
    commands = {name for group in COMMANDS.values() for name in group}
    assert set(re.findall(r"^\$ jbclog ([a-z-]+)", TEXT, re.MULTILINE)) >= commands


def test_titles_are_unique() -> None:
    titles = [(path.stem, title(case)) for path in FILES for case in cases(path)]
    assert len(set(titles)) == len(titles) > 0
