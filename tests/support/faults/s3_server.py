"""A real S3 server (moto's) in a process of its own, with a bucket."""

from __future__ import annotations

import os
import socket
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from support.forked import forked

BUCKET = "plant-runs"
KEY, SECRET = "AKIDOFATESTXYZ", "not-a-secret-but-never-printed"


@dataclass(frozen=True)
class Server:
    """A server that runs."""

    port: int

    @property
    def environment(self) -> dict[str, str]:
        """What a client needs."""
        return {
            "AWS_ACCESS_KEY_ID": KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET,
            "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.port}",
        }


@contextmanager
def serving(free_calls: float = float("inf")) -> Iterator[Server]:
    """Serve while a `with` lasts. After so many calls the server asks for credentials."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = (str(port), str(free_calls))
    process = forked(main, words, ("moto.server",), Path(os.devnull))
    try:
        _wait(port)
        request = urllib.request.Request(f"http://127.0.0.1:{port}/{BUCKET}", method="PUT")
        urllib.request.urlopen(request, timeout=10).close()
        yield Server(port)
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
    port, free_calls = words
    from moto import settings
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    settings.INITIAL_NO_AUTH_ACTION_COUNT = float(free_calls)
    serve = DomainDispatcherApplication(create_backend_app)
    make_server("127.0.0.1", int(port), serve, threaded=True).serve_forever()
