"""A disk that accepts no more data: acknowledged rows stay, the recorder gets the error, the run
can still be sealed.

docs/reference/faults.md, F-23 to F-25. The limit is the system's own (RLIMIT_FSIZE), in a separate
process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from support import HERE as SUPPORT
from support.faults.small_disk import small_disk
from support.product import check_run, files_of_rows, read_manifest, recover_run
from support.records import few_rows

RECORDER = """
import json, resource, sys, time
from pathlib import Path
from support.records import few_rows
from support.product import RecordError, create_run, open_store, put

put("store.RESERVE_BYTES", {reserve})
told = []
store = open_store(create_run(Path({out!r}), "bench", 0.0), told.append, seal_every_s=None)
store.start()
if {limit}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
acknowledged = number = 0
while number < {rows}:
    few_rows.hand_over(store, range(number, number + 500))
    number += 500
    try:
        store.commit_now()
        acknowledged = number
    except RecordError:
        if {give_up}:
            break
store.close()
store.release()
print(json.dumps([str(store.folder), acknowledged, [str(error) for error in told]]))
"""


def recorded(
    out: Path, *, rows: int, limit: int = 0, reserve: int = 65536, give_up: bool = True
) -> tuple[Path, int, list[str]]:
    """Run a recorder in its own process; return its folder, the acknowledged rows and the failures
    it reported.
    """
    program = RECORDER.format(
        out=str(out), rows=rows, limit=limit, reserve=reserve, give_up=give_up
    )
    places = os.pathsep.join([str(SUPPORT.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": places}
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    folder, acknowledged, told = json.loads(done.stdout)
    return Path(folder), acknowledged, told


def test_files_that_may_not_grow_are_followed_by_new_ones(tmp_path: Path) -> None:
    """The store continues in a new file, and nothing is lost."""
    folder, acknowledged, told = recorded(tmp_path, rows=30_000, limit=300_000)
    assert acknowledged == 30_000
    assert told == []
    assert len(files_of_rows(folder)) > 2
    recover_run(folder)
    assert few_rows.sealed_numbers(folder) == list(range(30_000))
    assert check_run(folder) == []


def test_where_not_even_a_new_file_can_be_made_the_recorder_is_told_and_what_was_acknowledged_stays(
    tmp_path: Path,
) -> None:
    folder, acknowledged, told = recorded(tmp_path, rows=30_000, limit=20_000)
    assert len(told) == 1
    assert "the record is not whole" in told[0]
    recover_run(folder)
    assert few_rows.sealed_numbers(folder)[:acknowledged] == list(range(acknowledged))
    assert read_manifest(folder).exit_status == "lost"


@pytest.mark.campaign
@pytest.mark.parametrize("give_up", [True, False], ids=["ends", "goes-on"])
def test_a_full_disk(tmp_path: Path, give_up: bool, counted: Callable[..., None]) -> None:
    """A real disk of 3 MB, half of it reserved: acknowledged rows are there, with room to seal
    them.
    """
    with small_disk(tmp_path / "disk", "3m") as disk:
        folder, acknowledged, told = recorded(
            disk, rows=200_000, reserve=1_500_000, give_up=give_up
        )
        assert len(told) == 1
        assert "full" in told[0]
        assert 1000 < acknowledged < 200_000
        recover_run(folder)
        numbers = few_rows.sealed_numbers(folder)
        assert numbers[:acknowledged] == list(range(acknowledged))
        lost = read_manifest(folder).lost
        assert lost is not None
        counted(full_disks=1, acknowledged_rows=acknowledged, acknowledged_rows_lost=0)
