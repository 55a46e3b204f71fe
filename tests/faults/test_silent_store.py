"""A store at an address that never answers, or never ends to: one line within ten seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.campaigns.awaited import INTERNAL_ERROR
from support.faults.s3_server import KEY, SECRET
from support.faults.silent_servers import SERVERS, SilentServer
from support.records.many_runs import many_runs

URL = "s3://plant-runs/soldering"
VERBS = {
    "runs": ["runs", URL],
    "trend": ["trend", URL],
    "chart": ["chart", URL, "--metric", "idle_error_c"],
    "compare": [
        "compare",
        f"{URL}/20260101T000000Z-bench-aaaa",
        f"{URL}/20260102T000000Z-bench-aaaa",
    ],
    "where-used": ["where-used", URL, "--station", "dde-1", "--since", "2026-01-01"],
    "store check": ["store", "check", URL],
    "store compact": ["store", "compact", URL],
    "store vacuum": ["store", "vacuum", URL],
}
MOST_S = 10.0
"""Half of it is the limit for an answer; the libraries are loaded twice."""
HANGS_S = 180.0


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", SERVERS)
def test_every_verb_of_a_store_answers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: str
) -> None:
    (run,) = many_runs(tmp_path / "runs", [0.0])
    wrong = {}
    with SilentServer(kind, monkeypatch):
        for verb, words in {**VERBS, "publish": ["publish", str(run), URL]}.items():
            command = [sys.executable, "-m", "jbclog", *words]
            began = time.monotonic()
            try:
                ended = subprocess.run(
                    command,
                    env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
                    capture_output=True,
                    text=True,
                    timeout=HANGS_S,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                wrong[verb] = "no answer"
                continue
            took, said = time.monotonic() - began, ended.stdout + ended.stderr
            print(f"{kind}, {verb}: {took:.1f} s, {said.strip()}")
            if (
                ended.returncode not in (1, 2, 4)
                or said.count("\n") != 1
                or took > MOST_S
                or KEY in said
                or SECRET in said
                or INTERNAL_ERROR in said
            ):
                wrong[verb] = f"{ended.returncode} in {took:.1f} s: {said[:500]}"
    assert wrong == {}
