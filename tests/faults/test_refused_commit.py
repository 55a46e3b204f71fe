"""Memory that is refused to the journal at each request of a commit: every row is stored, once,
and the chain holds.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from jbclog.record.chains import COLUMNS, breaks
from jbclog.record.row_batches import BARE

SUPPORT = Path(__file__).parents[1]


@pytest.mark.parametrize("many", [1, 100])
def test_nothing_that_was_handed_over_is_lost_or_stored_twice(tmp_path: Path, many: int) -> None:
    """At each request of a commit in turn (`support/faults/refused_commit.py`)."""
    pytest.importorskip("_testcapi")
    command = [
        sys.executable,
        "-c",
        (
            "import sys; sys.path[:0] = [sys.argv.pop(1)]; import support.faults.refused_commit as"
            " r; r.main_of(sys.argv)"
        ),
    ]
    done = subprocess.run(
        [*command, str(SUPPORT), str(tmp_path), str(many), "1"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    commits, tables = told["commits"], told["tables"]
    assert told["met"] >= 100
    assert told["unreported"] == 0
    assert told["outages"] == commits - 1
    for table, column in (("samples", "tick"), ("settings", "setting"), ("counters", "value")):
        place = BARE[table].names.index(column)
        numbers = [
            row[place] if table != "settings" else int(row[place].rpartition("_")[2])
            for row in tables[table]
        ]
        assert numbers == list(range(commits)), table
    events = [dict(zip(COLUMNS, row, strict=True)) for row in tables["events"]]
    assert list(breaks(told["run"], events)) == []
    assert [event["code"] for event in events if event["kind"] == "test.event"] == list(
        range(commits)
    )
