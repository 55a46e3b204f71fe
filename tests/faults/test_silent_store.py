"""A store at an address that never answers, or never ends to: one line within a bounded time."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from jbclog.analysis.store import endpoint
from jbclog.core.errors import StoreError
from support.campaigns.awaited import INTERNAL_ERROR
from support.faults.s3_server import KEY, SECRET, Server
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
OF_THE_LIBRARY_S = 60.0  # its limit of a request, and those of trying again
PROXIES = [*endpoint.PROXIES, *(name.upper() for name in endpoint.PROXIES)]


def _silent(_: socket.socket) -> None:
    time.sleep(600)


def _a_byte_a_second(opened: socket.socket) -> None:
    for letter in b"HTTP/1.1 200 OK\r\nX: " + b"x" * 600:
        opened.sendall(bytes([letter]))
        time.sleep(1)


def _closes(opened: socket.socket) -> None:
    opened.close()


def _noise(opened: socket.socket) -> None:
    opened.sendall(b"\0\xff" * 10_000)


def _pages_without_end(opened: socket.socket) -> None:
    """Each list is said to go on, always at the same place."""
    body = (
        b'<?xml version="1.0"?><ListBucketResult><IsTruncated>true</IsTruncated>'
        b"<NextContinuationToken>x</NextContinuationToken></ListBucketResult>"
    )
    head = f"HTTP/1.1 200 OK\r\nContent-Length: {len(body)}\r\n\r\n".encode()
    while opened.recv(1 << 16):
        opened.sendall(head + body)


SERVERS: dict[str, Callable[[socket.socket], None]] = {
    "silent": _silent,
    "a byte a second": _a_byte_a_second,
    "closes": _closes,
    "noise": _noise,
    "lists without end": _pages_without_end,
}


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], int]]:
    """Start such a server; the environment names it. Never closed in a test's time."""
    listening: list[socket.socket] = []

    def started(kind: str) -> int:
        opened = socket.create_server(("127.0.0.1", 0))
        listening.append(opened)
        threading.Thread(target=_accept, args=(opened, SERVERS[kind]), daemon=True).start()
        port: int = opened.getsockname()[1]
        for name, value in Server(port).environment.items():
            monkeypatch.setenv(name, value)
        for name in PROXIES:
            monkeypatch.delenv(name, raising=False)
        return port

    yield started
    for one in listening:
        one.close()


def _accept(listening: socket.socket, answer: Callable[[socket.socket], None]) -> None:
    with suppress(OSError):
        while True:
            opened, _ = listening.accept()
            threading.Thread(target=_answered, args=(opened, answer), daemon=True).start()


def _answered(opened: socket.socket, answer: Callable[[socket.socket], None]) -> None:
    with suppress(OSError), opened:
        answer(opened)


def test_a_server_that_does_not_react_is_named_in_seconds(
    serving: Callable[[str], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoint, "ANSWERS_S", 0.3)
    port = serving("silent")
    for _ in range(2):  # it is asked again: a server may come back
        with pytest.raises(StoreError, match=f"port {port} .* does not answer"):
            endpoint.expect_reaction(URL)


@pytest.mark.parametrize("kind", ["closes", "noise"])
def test_any_reaction_is_the_library_s_to_judge(serving: Callable[[str], int], kind: str) -> None:
    serving(kind)
    endpoint.expect_reaction(URL)


@pytest.mark.parametrize(
    "url",
    ["", "http://", "http://127.0.0.1:99999", "127.0.0.1:9000", "ftp://127.0.0.1", "http://["],
)
def test_an_address_that_is_none_is_the_library_s_to_judge(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(endpoint.ENDPOINT, url)
    for name in PROXIES:
        monkeypatch.delenv(name, raising=False)
    endpoint.expect_reaction(URL)


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", SERVERS)
def test_every_verb_of_a_store_answers(
    serving: Callable[[str], int], tmp_path: Path, kind: str
) -> None:
    serving(kind)
    (run,) = many_runs(tmp_path / "runs", [0.0])
    wrong = {}
    for verb, words in {**VERBS, "publish": ["publish", str(run), URL]}.items():
        command = [sys.executable, "-m", "jbclog", *words]
        began = time.monotonic()
        try:
            ended = subprocess.run(
                command,
                env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
                capture_output=True,
                text=True,
                timeout=3 * OF_THE_LIBRARY_S,
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
            or took > (10.0 if kind == "silent" else OF_THE_LIBRARY_S)
            or KEY in said
            or SECRET in said
            or INTERNAL_ERROR in said
        ):
            wrong[verb] = f"{ended.returncode} in {took:.1f} s: {said[:500]}"
    assert wrong == {}
