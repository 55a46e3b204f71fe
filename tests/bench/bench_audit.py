"""How long an audit of 100 virtual stations takes, eight links at a time, and how much of that is
transmission time.

The links are paced at 19200 8N1. Each station has two ports and answers after a millisecond. There
are two baselines: the time that the same bytes need on eight such links in parallel, and a bare
pyserial program that asks the same stations as often, eight at a time, and ignores the answers.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import bare
from common import (
    LINE,
    Bench,
    Claim,
    at_least,
    at_most,
    in_own_process,
    is_short,
    judge,
    show,
    virtual_stations,
)

from jbclog.app.audit.survey import AT_ONCE

LIMIT_S = 60.0
TURNAROUND_MS = 1.0


def main() -> int:
    count = 32 if is_short(__doc__) else 100
    with virtual_stations(count, ports="[1, 2]", turnaround_ms=TURNAROUND_MS, log=True) as stations:
        took, code, told = audited(stations)
        sizes = sizes_of(stations.wire_log)
        plain = in_own_process(bare_audit, stations.ports, len(sizes) // count)
    exchanges, characters = len(sizes), sum(sizes)
    least_s = (LINE.seconds(characters) + exchanges * TURNAROUND_MS / 1000) / AT_ONCE
    rows = [
        ["jbclog audit", count, exchanges, characters, took],
        ["bare pyserial threads", count, len(sizes) // count * count, "-", plain],
        ["the wires alone", count, exchanges, characters, least_s],
    ]
    show(
        f"{count} stations, {AT_ONCE} at a time", ("", "stations", "exchanges", "bytes", "s"), rows
    )
    seen = sum(bool(one["seen"]) for one in told["stations"])  # type: ignore[attr-defined]  # a list of objects
    return judge(
        [
            Claim(
                "every station was read, and the audit is fine",
                seen == count and code == 0,
                f"{seen} of {count}, exit code {code}",
            ),
            at_most(f"{count} stations", took, LIMIT_S * count / 100, " s"),
            at_most("time, of a bare pyserial program's for as many exchanges", took / plain, 1.5),
            at_least("time, of what the same bytes take on the wires", took / least_s, 1.0),
        ]
    )


def audited(stations: Bench) -> tuple[float, int, dict[str, object]]:
    """Return the seconds from call to end, the exit code and the output."""
    words = [
        "audit",
        "--line",
        str(stations.line),
        "--ledger",
        str(stations.folder / "counters.jsonl"),
        "--json",
    ]
    command = [sys.executable, "-c", "from jbclog.cli import main; main()", *words]
    begun = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return time.monotonic() - begun, done.returncode, json.loads(done.stdout)


def bare_audit(ports: list[str], exchanges: int) -> float:
    """Return the seconds for that many exchanges with each station."""
    begun = time.monotonic()
    with ThreadPoolExecutor(AT_ONCE) as threads:
        list(threads.map(partial(_ask, exchanges=exchanges), ports))
    return time.monotonic() - begun


def _ask(url: str, exchanges: int) -> None:
    question = bare.frames()[0]
    with bare.opened(url) as port:
        for _ in range(exchanges):
            bare.ask(port, question)


def sizes_of(wire_log: Path) -> list[int]:
    """Return the characters of each question with its answer, from the stations' logs."""
    sizes: list[int] = []
    for line in wire_log.read_text().splitlines():
        one = json.loads(line)
        if one["kind"] == "question":
            sizes.append(len(one["hex"]) // 2)
        elif one["kind"] == "answer":
            sizes[-1] += len(one["hex"]) // 2
    return sizes


if __name__ == "__main__":
    sys.exit(main())
