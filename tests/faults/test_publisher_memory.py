"""A publisher's memory does not grow with the rows of a run: a separate process commits many and
reports its use.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.records.many_runs import one_run

GROUP_ROWS = 32_768
MOST_MB = 480  # 419 to 430 of 3 million rows; with commits of a million 541 to 553
# more heaps of the C library would make it vary by chance
HEAPS = {"MALLOC_ARENA_MAX": "1"}
PROGRAM = """
import re, sys
from itertools import chain, repeat
from pathlib import Path
from jbclog.analysis.run import open_run
from jbclog.analysis.store.contents import rows_of, stamped
from jbclog.analysis.store.place import place_of
from jbclog.app.publish.commits import append, create_tables

run, store, groups = sys.argv[1], place_of(sys.argv[2]), int(sys.argv[3])
create_tables(store)
(piece,) = rows_of(open_run(Path(run)), "samples")
partition = {"line": "bench", "month": "2026-09"}
rows = lambda: stamped(repeat(piece, groups), "samples", "a run", "abc-1", partition)
appended = append(store, "samples", "abc-1", rows)
print(appended, re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
"""


@pytest.mark.parametrize(
    "groups", [90, *(pytest.param(groups, marks=pytest.mark.campaign) for groups in (180, 360))]
)
def test_memory_does_not_grow_with_the_rows(
    tmp_path: Path, groups: int, capsys: pytest.CaptureFixture[str]
) -> None:
    run = one_run(tmp_path / "runs", 0, rows=GROUP_ROWS)
    command = [sys.executable, "-c", PROGRAM, str(run), str(tmp_path / "store"), str(groups)]
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=True, env=os.environ | HEAPS
    )
    rows, peak_mb = (int(word) for word in ended.stdout.split())
    peak_mb //= 1024
    with capsys.disabled():
        print(f"\n{rows} rows: {peak_mb} MB")
    assert rows == groups * GROUP_ROWS
    assert peak_mb < MOST_MB
