"""A disk that fails at any single operation of the record, once or permanently: nothing wrong,
nothing lost without a message.

docs/reference/faults.md, F-23 to F-25. The failure is injected below the program, where the store
and Arrow call the system (`failing_disk.c`), under runs on a virtual clock and under recoveries
(`failing_run.py`). After each: the tools were ordered to stand, rows are as written, acknowledged
ones are all there, missing ones are reported, one recovery is enough, I1 to I9 hold, and the next
run beside it starts. `test_disk_run.py` has real disks that are full, read-only or gone.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from support import program
from support.faults import failing_run

SEED = random.randrange(1 << 32)
FAULTS = [("EIO", 0), ("EIO", 1), ("ENOSPC", 0), ("ENOSPC", 1)]
NAMES = ["one-error", "errors-from-then-on", "no-room-once", "no-room-from-then-on"]


def outcomes(
    library: Path, home: Path, scenario: str, fault: tuple[str, int], first: int, stride: int
) -> list[dict[str, object]]:
    """Return the outcomes of the failed operations FIRST, FIRST + STRIDE ..."""
    places = os.pathsep.join(
        [*(path for path in sys.path if path), os.environ.get("PYTHONPATH", "")]
    )
    command = [*program("faults.failing_run"), scenario, home, *fault, first, stride]
    environment = {**os.environ, "LD_PRELOAD": str(library), "PYTHONPATH": places}
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def assert_nothing_is_wrong(found: list[dict[str, object]]) -> int:
    """Return the number of failures; after the last one nothing was left to fail."""
    assert [one for one in found if one["wrong"]] == []
    assert found[-1]["fired"] == 0
    return sum(bool(one["fired"]) for one in found)


@pytest.mark.parametrize(
    ("scenario", "fault", "stride"),
    [("run", FAULTS[1], 140), ("recover", FAULTS[0], 100)],
    ids=["run", "recover"],
)
def test_some_things_fail(
    failing_library: Path, tmp_path: Path, scenario: str, fault: tuple[str, int], stride: int
) -> None:
    first = 1 + SEED % stride
    print(f"from operation {first} on each {stride}th")
    assert (
        assert_nothing_is_wrong(outcomes(failing_library, tmp_path, scenario, fault, first, stride))
        >= 2
    )


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize("fault", FAULTS, ids=NAMES)
@pytest.mark.parametrize("scenario", sorted(failing_run.SCENARIOS))
def test_each_thing_fails(
    failing_library: Path,
    tmp_path: Path,
    scenario: str,
    fault: tuple[str, int],
    part: int,
    counted: Callable[..., None],
) -> None:
    failures = assert_nothing_is_wrong(
        outcomes(failing_library, tmp_path, scenario, fault, 1 + part, 4)
    )
    assert failures >= 20
    counted(**{f"{scenario} {fault[0]} {'for good' if fault[1] else 'once'}": failures})
