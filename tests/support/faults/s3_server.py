"""A real S3 server (moto's) in a process of its own.

It has conditional writes. With ``ignore`` it takes no notice of `If-None-Match`, with ``refuse`` it
answers 501 to it, as servers without conditional writes do. `Server` starts one, with a bucket.
"""

from __future__ import annotations

import os
import signal
import socket
import time
import urllib.request
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from support.forked import forked

BUCKET = "plant-runs"
KEY, SECRET = "AKIDOFATESTXYZ", "not-a-secret-but-never-printed"
CONDITION = "HTTP_IF_NONE_MATCH"


@dataclass(frozen=True)
class Server:
    """A server that runs. While it is stopped, its connections are refused; it has its objects when
    it starts again.
    """

    port: int
    process: BaseProcess | None = None

    def stop(self) -> None:
        self._signal(signal.SIGUSR1)
        while self._answers():
            time.sleep(0.02)

    def start(self) -> None:
        self._signal(signal.SIGUSR2)
        _wait(self.port)

    def _signal(self, number: signal.Signals) -> None:
        assert self.process is not None
        assert self.process.pid is not None
        os.kill(self.process.pid, number)

    def _answers(self) -> bool:
        with socket.socket() as one:
            return one.connect_ex(("127.0.0.1", self.port)) == 0

    @property
    def environment(self) -> dict[str, str]:
        """What a client needs, as the library takes it."""
        return {
            "AWS_ACCESS_KEY_ID": KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET,
            "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.port}",
            "AWS_ALLOW_HTTP": "true",
        }

    def names(self) -> list[str]:
        """The objects in the bucket."""
        import boto3  # type: ignore[import-untyped]  # ships no types

        told = dict(zip(("aws_access_key_id", "aws_secret_access_key"), (KEY, SECRET), strict=True))
        client = boto3.client(
            "s3", endpoint_url=f"http://127.0.0.1:{self.port}", region_name="us-east-1", **told
        )
        pages = client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET)
        return [one["Key"] for page in pages for one in page.get("Contents", ())]


@contextmanager
def serving(how: str = "", free_calls: float = float("inf")) -> Iterator[Server]:
    """Serve while a `with` lasts. After so many calls it asks for credentials."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = (str(port), how, str(free_calls))
    process = forked(main, words, ("moto.server",), Path(os.devnull))
    try:
        _wait(port)
        request = urllib.request.Request(f"http://127.0.0.1:{port}/{BUCKET}", method="PUT")
        urllib.request.urlopen(request, timeout=10).close()
        yield Server(port, process)
    finally:
        process.terminate()
        process.join(20)


def _wait(port: int) -> None:
    for _ in range(400):
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/moto-api/", timeout=5).close()
            return
        except OSError:
            time.sleep(0.05)
    raise TimeoutError("the S3 server does not answer")


def main(words: Sequence[str]) -> None:
    port, how, free_calls = words
    from moto import settings
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    settings.INITIAL_NO_AUTH_ACTION_COUNT = float(free_calls)
    serve = DomainDispatcherApplication(create_backend_app)
    one_by_one = Lock()  # moto looks whether an object is there, and writes it, in two steps

    def without(environment: dict[str, Any], start: Callable[..., object]) -> Iterable[bytes]:
        condition = environment.pop(CONDITION, None) if how else None
        if condition and how == "refuse":
            start("501 Not Implemented", [("Content-Type", "application/xml")])
            return [
                b"<?xml"
                b" version='1.0'?><Error>"
                b"<Code>NotImplemented</Code><Message>If-None-Match</Message></Error>"
            ]
        with one_by_one if CONDITION in environment else nullcontext():
            answer: Iterable[bytes] = serve(environment, start)
            return answer

    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGUSR1, signal.SIGUSR2))
    while True:
        listening = make_server("127.0.0.1", int(port), without, threaded=True)
        Thread(target=listening.serve_forever, daemon=True).start()
        signal.sigwait([signal.SIGUSR1])
        listening.shutdown()
        listening.server_close()
        signal.sigwait([signal.SIGUSR2])
