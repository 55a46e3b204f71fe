"""The runs of a folder and their reports, for the page. Takes no lock: an open run is recognized by
its lock file.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from functools import lru_cache
from io import BufferedReader
from pathlib import Path
from typing import Final

from jbclog.core.files import Kind, open_regular
from jbclog.core.locks import NAME as LOCK
from jbclog.core.text import clean, json_line, shortened
from jbclog.live.follower import is_run
from jbclog.record.find_runs import Found, summary_of
from jbclog.record.folder import RUN_NAME
from jbclog.record.manifest import NAME as MANIFEST

MOST: Final = 100  # the newest ones
MOST_TEXT: Final = 300  # characters of the manifest's texts, as in the table of `jbclog runs`
KEPT_S: Final = 1.0
REPORT: Final = "report.html"
NOT_READABLE: Final = "not readable"


class RunList:
    """The list of runs as JSON, cached for `KEPT_S`, so that frequent requests cause no work and
    block no thread.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reading = asyncio.Lock()
        self._text = ""
        self._until_s = 0.0

    async def text(self) -> str:
        """Raises OSError."""
        async with self._reading:
            if time.monotonic() >= self._until_s:
                self._text = json_line(await asyncio.to_thread(past_runs, self._path))
                self._until_s = time.monotonic() + KEPT_S
            return self._text


def past_runs(path: Path) -> list[dict[str, object]]:
    """Return the newest runs of the folder at `path`, or of the folder of the run at `path`, newest
    first. Raises `OSError`.
    """
    home = path.absolute().parent if is_run(path) else path
    names = sorted(
        (one.name for one in home.iterdir() if RUN_NAME.fullmatch(one.name)), reverse=True
    )[:MOST]
    return [_run(home / name) for name in names]


def _run(run: Path) -> dict[str, object]:
    text, has_report = NOT_READABLE, False
    with suppress(OSError):  # a folder that this user may not enter
        text, has_report = _text(run), (run / REPORT).is_file()
    return {"run": run.name, "text": text, "report": has_report}


def open_report(path: Path, name: str) -> BufferedReader:
    """Open the page of run `name` beside or below `path`. Raises `OSError`, also if it has none."""
    home = path.absolute().parent if is_run(path) else path
    if not RUN_NAME.fullmatch(name) or (home / name).is_symlink():
        raise FileNotFoundError(name)
    return open_regular(home / name / REPORT, Kind.OF_REPORT)


def _text(run: Path) -> str:
    if (run / LOCK).exists():
        return "open"
    manifest = (run / MANIFEST).lstat()
    return _manifest_text(run, manifest.st_ino, manifest.st_mtime_ns, manifest.st_size)


@lru_cache(maxsize=2 * MOST)
def _manifest_text(run: Path, *_: int) -> str:
    """Return the text of a run from its manifest, cached until the file is replaced."""
    found = summary_of(run)
    if not isinstance(found, Found):
        return NOT_READABLE
    facts = [
        found.shown_state,
        found.verdict,
        found.order and f"order {found.order}",
        found.product,
    ]
    return clean(" · ".join(shortened(text, MOST_TEXT) for text in facts if text))
