"""Many stations: eight serial lines at a time, each station read once, and 100 within a minute."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from support.invoked import invoked
from support.product import AT_ONCE, SimProcess, read_counter_book

STATION = (
    '[[station]]\nname = "d-{0}"\nurl = "d-{0}"\nfamily = "dde"\n[station.sim]\nwire ='
    " {1}\nturnaround_ms = 1.0\n"
)
LIMIT_S = 60.0


@pytest.mark.usefixtures("patient")  # the log shows a question when the station reads it
@pytest.mark.parametrize(
    ("count", "wire"),
    [
        (12, "false"),
        pytest.param(100, "true", marks=[pytest.mark.campaign, pytest.mark.timeout(240)]),
    ],
)
def test_eight_wires_at_a_time(tmp_path: Path, count: int, wire: str) -> None:
    source, ledger, log = (
        tmp_path / "source.toml",
        tmp_path / "counters.jsonl",
        tmp_path / "wire.jsonl",
    )
    source.write_text(
        '[line]\nname = "hall"\n' + "".join(STATION.format(one, wire) for one in range(count)),
        encoding="utf-8",
    )
    with SimProcess(source, tmp_path / "served", log=log) as stations:
        begun = time.monotonic()
        ended = invoked("audit", "--line", stations.line_path, "--ledger", ledger)
        took = time.monotonic() - begun
    assert ended.exit_code == 0, ended.stderr
    assert took < LIMIT_S
    assert {one.station for one in read_counter_book(ledger).observations if one.seen} == {
        f"d-{one}" for one in range(count)
    }
    assert 2 <= most_at_once(log) <= AT_ONCE


def most_at_once(log: Path) -> int:
    """Return the largest number of stations that were read at the same time, each from its first
    question to its last.
    """
    spans: dict[str, list[float]] = {}
    for line in log.read_text(encoding="ascii").splitlines():
        one = json.loads(line)
        spans.setdefault(one["station"], []).append(one["t"])
    ends = sorted(
        [(times[0], 1) for times in spans.values()] + [(times[-1], -1) for times in spans.values()]
    )
    now = most = 0
    for _, step in ends:
        now += step
        most = max(most, now)
    return most
