"""`jbclog watch --web` and hostile clients: a thousand connections of each kind neither fill memory
nor delay answers to others.
"""

from __future__ import annotations

import http.client
import os
import re
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from support.campaigns.awaited import INTERNAL_ERROR
from support.command import until
from support.records.live_rows import Recording

ANSWERS_S = 5.0
MEMORY = 500  # MB
ATTACKED_S = 45.0
LARGE = 200 << 20


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    ended = Recording(tmp_path)
    ended.finalize()
    (ended.folder / "report.html").write_bytes(b"x" * LARGE)
    going = Recording(tmp_path, began_us=ended.began_us + 60_000_000)
    going.rows(600)
    going.commit()
    yield ended
    going.abandon()


@pytest.fixture
def server(tmp_path: Path, recording: Recording) -> Iterator[tuple[subprocess.Popen[str], int]]:
    command = [sys.executable, "-m", "jbclog", "watch", str(tmp_path), "--web", "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            found = re.search(r"http://127\.0\.0\.1:(\d+)/", process.stderr.readline())
            assert found is not None
            yield process, int(found[1])
        finally:
            process.kill()


def attacks(run: str, port: int) -> dict[str, bytes]:
    """What each client sends; then it sends nothing more and reads nothing."""

    def get(path: str, more: str = "") -> bytes:
        return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{more}\r\n".encode()

    return {
        "silence": b"",
        "half a request": b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n",
        "headers without end": b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 20_000,
        "a long line": b"GET /" + b"x" * 200_000,
        "streams": get("/events"),
        "reports": get(f"/runs/{run}"),
        "hours": get("/hour?port=dde-1%201") * 50,
        "lists of runs": get("/runs") * 50,
        "half a body": get("/", "Content-Length: 1000000\r\n"),
        "heads of streams": get("/events").replace(b"GET", b"HEAD", 1),
        "a websocket": get("/events", "Connection: Upgrade\r\nUpgrade: websocket\r\n"),
    }


def answer_s(port: int) -> float | None:
    """Return the seconds until the page arrives; None if it is refused."""
    began = time.monotonic()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10 * ANSWERS_S)
    try:
        connection.request("GET", "/")
        answer = connection.getresponse()
        return time.monotonic() - began if answer.status == 200 and answer.read() else None
    except (OSError, http.client.HTTPException):
        return None
    finally:
        connection.close()


def resident_mb(pid: int) -> int:
    text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(re.findall(r"VmHWM:\s+(\d+)", text)[0]) // 1024


def attacked(stack: ExitStack, port: int, sent: bytes) -> None:
    made = stack.enter_context(socket.socket())
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.setblocking(False)
    with suppress(OSError):
        made.connect(("127.0.0.1", port))
    made.settimeout(0.05)
    with suppress(OSError):
        made.sendall(sent)


def withstands(
    server: tuple[subprocess.Popen[str], int], sent: bytes, number: int, seconds: float
) -> str:
    """Attack the page from that many connections and hold them that long; return what the page did
    meanwhile.
    """
    process, port = server
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, hard), hard))
    answers: list[float | None] = []
    try:
        with ExitStack() as clients:
            for at in range(number):
                attacked(clients, port, sent)
                if at % 100 == 99:
                    answers.append(answer_s(port))
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                answers.append(answer_s(port))
                time.sleep(0.5)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    memory, took = resident_mb(process.pid), [one for one in answers if one is not None]
    assert until(lambda: answer_s(port) is not None), "the attack keeps nothing for ever"
    assert max(took) < ANSWERS_S
    assert len(took) > len(answers) / 2
    assert memory < MEMORY
    assert process.poll() is None
    process.terminate()
    _, heard = process.communicate(timeout=60)
    assert "Traceback" not in heard
    assert INTERNAL_ERROR not in heard
    return f"{len(answers)} asked, {len(took)} answered, {max(took):.1f} s, {memory} MB"


@pytest.mark.campaign
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", attacks("", 0))
def test_a_thousand_connections(
    server: tuple[subprocess.Popen[str], int], recording: Recording, kind: str
) -> None:
    sent = attacks(recording.folder.name, server[1])[kind]
    print(f"{kind}: {withstands(server, sent, 1000, ATTACKED_S)}")


def asks(port: int, path: str, end_s: float) -> int:
    """Ask again after each answer; return the number of answers."""
    answers = 0
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
        while time.monotonic() < end_s:
            connection.request("GET", path)
            answers += connection.getresponse().read() != b""
    return answers


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.campaign
@pytest.mark.timeout(300)
@pytest.mark.parametrize("path", ["/hour?port=dde-1%201", "/runs"])
def test_who_asks_without_pause_keeps_the_page_from_nobody(
    server: tuple[subprocess.Popen[str], int],
    tmp_path: Path,
    path: str,
    counted: Callable[..., None],
) -> None:
    process, port = server
    for number in range(3000):
        (tmp_path / f"20200101T00{number // 60:02d}{number % 60:02d}Z-bench-aaaa").mkdir()
    began, used, seconds = time.monotonic(), cpu_s(process.pid), 10.0
    with ThreadPoolExecutor(20) as pool:
        asked = [pool.submit(asks, port, path, began + seconds) for _ in range(20)]
        answers = []
        while time.monotonic() < began + seconds:
            answers.append(answer_s(port))
            time.sleep(0.5)
        count = sum(one.result() for one in asked)
    took = [one for one in answers if one is not None]
    used = (cpu_s(process.pid) - used) / (time.monotonic() - began)
    counted(answers_without_pause=count)
    print(f"{path}: {count} asked, {used:.2f} cores, page within {max(took):.2f} s")
    assert count > 0
    assert len(took) == len(answers)
    assert max(took) < ANSWERS_S
    assert used < 1.3
    assert resident_mb(process.pid) < MEMORY


@pytest.mark.parametrize("kind", ["silence", "reports"])
def test_a_slice_of_that(
    server: tuple[subprocess.Popen[str], int], recording: Recording, kind: str
) -> None:
    withstands(server, attacks(recording.folder.name, server[1])[kind], 300, 8.0)
