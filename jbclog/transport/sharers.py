"""Other programs that have a run's ports open: they read what was meant for it, and no lock keeps them out (a lock only asks).

Looking through all that is open on a machine takes tens of milliseconds, so that it is done in a thread.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

from jbclog.transport.holder import in_words, is_behind, openers_of


class Sharers:
    """Looks who shares the devices `urls` with this program; each is told once."""

    def __init__(self, urls: Iterable[str]) -> None:
        self._devices = [url for url in urls if Path(url).is_absolute()]
        self._known: set[tuple[str, int]] = set()
        self._found: list[tuple[str, str]] = []
        self._thread: threading.Thread | None = None

    def look(self) -> None:
        """Begin to look, unless a look is still going on."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._look, name="sharers", daemon=True)
            self._thread.start()

    def news(self) -> Iterator[tuple[str, str]]:
        """Devices and the programs that share them, that have not been told yet."""
        while self._found:
            yield self._found.pop(0)

    def _look(self) -> None:
        for device, process in sorted(openers_of(self._devices) - self._known):
            self._known.add((device, process))
            if not is_behind(device, process):
                self._found.append((device, in_words(process)))
