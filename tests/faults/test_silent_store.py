"""A store at an address that never answers, or never ends to: one line within ten seconds. A server
that is slow only later has half a minute for each request.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.campaigns.awaited import INTERNAL_ERROR
from support.faults.s3_server import KEY, SECRET
from support.faults.silent_servers import LATER, SERVERS, SilentServer
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
LATER_S = 100.0
"""Two requests, of which the second one removes what the first may have made."""
HANGS_S = 180.0


def test_a_verb_of_a_store_answers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """However long it takes on a busy machine."""
    with SilentServer("silent", monkeypatch):
        _, wrong = outcome(VERBS["store check"], tmp_path)
    assert wrong is None


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("kind", "most_s"),
    [*((kind, MOST_S) for kind in SERVERS), *((kind, LATER_S) for kind in LATER)],
)
def test_every_verb_of_a_store_answers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: str, most_s: float
) -> None:
    """Within `most_s`, also if the server is slow only after its first answer."""
    with SilentServer(kind, monkeypatch):
        assert late_verbs(kind, tmp_path, most_s) == {}


def late_verbs(kind: str, folder: Path, most_s: float) -> dict[str, str]:
    """The verbs that took longer, or said anything but one line of an error."""
    (run,) = many_runs(folder / "runs", [0.0])
    late = {}
    for verb, words in {**VERBS, "publish": ["publish", str(run), URL]}.items():
        took, wrong = outcome(words, folder)
        print(f"{kind}, {verb}: {took:.1f} s")
        if wrong is not None or took > most_s:
            late[verb] = f"{took:.1f} s, {wrong}"
    return late


def outcome(words: list[str], cache: Path) -> tuple[float, str | None]:
    """How long a command took in seconds, and what it said if that is not one line of an error."""
    began = time.monotonic()
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "jbclog", *words],
            env=os.environ | {"XDG_CACHE_HOME": str(cache)},
            capture_output=True,
            text=True,
            timeout=HANGS_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return HANGS_S, "no answer"
    took, said = time.monotonic() - began, ended.stdout + ended.stderr
    is_right = (
        ended.returncode in (1, 2, 4)
        and said.count("\n") == 1
        and not any(word in said for word in (KEY, SECRET, INTERNAL_ERROR))
    )
    return took, None if is_right else f"{ended.returncode}: {said[:500]}"
