"""The live view's page, served by a thread of this process from whatever a test calls a run.

``python tests/support virtual.watched_page PORT`` serves a made-up run to look at.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from jbclog.app.watch.batch_queue import BatchQueue
from jbclog.app.watch.server import Access, PageServer, listening
from jbclog.live import RunState
from support.records import live_states

TOLD_S = 60.0
Answer = RunState | Exception | Callable[[], RunState | None] | None


@dataclass
class Served:
    """A page at `address`. `answer` is what its source returns or raises."""

    answer: Answer
    port: int = 0
    queues: tuple[BatchQueue, ...] = ()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def source(self) -> RunState | None:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer() if callable(self.answer) else self.answer


@contextmanager
def page(
    answer: Answer,
    token: str | None = None,
    address: str = "127.0.0.1",
    path: Path = Path("none"),
    port: int = 0,
) -> Iterator[Served]:
    served = Served(answer)
    with listening("127.0.0.1", port) as opened:
        served.port = opened.getsockname()[1]
        running = PageServer(served.source, Access(address, token), path, lambda: served.queues)
        thread = threading.Thread(target=running.run, args=([opened],), daemon=True)
        thread.start()
        end = time.monotonic() + TOLD_S
        while not running.started:
            assert time.monotonic() < end
            time.sleep(0.01)
        try:
            yield served
        finally:
            running.should_exit = True
            thread.join(TOLD_S)


if __name__ == "__main__":
    PageServer(live_states.run, Access("127.0.0.1", None), Path("runs")).run(
        [listening("127.0.0.1", int(sys.argv[1]))]
    )
