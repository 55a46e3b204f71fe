"""A publisher that is killed while it writes any of its files, and another one that repeats it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from jbclog.app.publish import publish
from jbclog.record.published import Tree
from support.records.many_runs import one_run

KILLED = """
import os, signal, sys
from pathlib import Path
from jbclog.app.publish import publish
from jbclog.record.published import Tree

run, table, after = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
put, count = Tree.put, iter(range(100))

def half(pieces):
    for piece in pieces:
        yield piece[: len(piece) // 2]
        os.kill(os.getpid(), signal.SIGKILL)

def killing(self, key, pieces):
    put(self, key, half(pieces) if next(count) == after else pieces)

Tree.put = killing
publish(run, Tree.at(table))
"""


def content(table: Path) -> dict[str, bytes]:
    """Every file of the tree but what a killed publisher was writing, which readers ignore."""
    files = (path for path in table.rglob("[!.]*") if path.is_file())
    return {path.relative_to(table).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return one_run(tmp_path_factory.mktemp("runs"), 0)


@pytest.mark.parametrize("after", range(7))
def test_killed_and_repeated_the_result_is_the_same(run: Path, tmp_path: Path, after: int) -> None:
    publish(run, Tree.at(tmp_path / "whole"))
    table = tmp_path / "plant"
    ended = subprocess.run([sys.executable, "-c", KILLED, run, table, str(after)], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert Tree.at(table).runs() == []
    whole = content(tmp_path / "whole")
    assert content(table).items() < whole.items()
    assert len(content(table)) == after
    publish(run, Tree.at(table))
    assert content(table) == whole


def test_two_processes_publish_one_run(run: Path, tmp_path: Path) -> None:
    publish(run, Tree.at(tmp_path / "whole"))
    program = shutil.which("jbclog", path=os.path.dirname(sys.executable))  # noqa: PTH120
    assert program is not None
    for number in range(3):
        table = tmp_path / f"plant-{number}"
        both = [subprocess.Popen([program, "publish", run, table]) for _ in range(2)]
        assert [one.wait() for one in both] == [0, 0]
        assert content(table) == content(tmp_path / "whole")
