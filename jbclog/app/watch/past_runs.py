"""The runs of a folder and their reports, for the page. Takes no lock: an open run is known by its
lock file alone.
"""

from __future__ import annotations

from functools import lru_cache
from io import BufferedReader
from pathlib import Path
from threading import Lock
from typing import Final

from jbclog.core.foreign.files import Kind, open_foreign
from jbclog.core.locks import NAME as LOCK
from jbclog.core.text import clean
from jbclog.live.follower import is_run
from jbclog.record.find_runs import Found, summary_of
from jbclog.record.folder import RUN_NAME
from jbclog.record.manifest import NAME as MANIFEST

MOST: Final = 100  # the newest ones
REPORT: Final = "report.html"
_one_at_a_time: Final = Lock()  # many who ask at once find what the first one has read


def past_runs(path: Path) -> list[dict[str, object]]:
    """Return the newest runs of the folder at `path`, or of the folder of the run at `path`, newest
    first. Raises OSError.
    """
    home = path.absolute().parent if is_run(path) else path
    names = sorted(
        (one.name for one in home.iterdir() if RUN_NAME.fullmatch(one.name)), reverse=True
    )[:MOST]
    with _one_at_a_time:
        return [
            {"name": name, "text": _text(home / name), "report": (home / name / REPORT).is_file()}
            for name in names
        ]


def open_report(path: Path, name: str) -> BufferedReader:
    """Open the page of run `name` beside or below `path`. Raises OSError, also if it has none."""
    home = path.absolute().parent if is_run(path) else path
    if not RUN_NAME.fullmatch(name) or (home / name).is_symlink():
        raise FileNotFoundError(name)
    return open_foreign(home / name / REPORT, Kind.OF_REPORT)


def _text(run: Path) -> str:
    if (run / LOCK).exists():
        return "open"
    try:
        manifest = (run / MANIFEST).lstat()
    except OSError:
        return "not readable"
    return _manifest_text(run, manifest.st_ino, manifest.st_mtime_ns, manifest.st_size)


@lru_cache(maxsize=2 * MOST)
def _manifest_text(run: Path, *_: int) -> str:
    """Return what the manifest says, which is read again once the file is another one."""
    found = summary_of(run)
    if not isinstance(found, Found):
        return "not readable"
    facts = [
        found.shown_state,
        found.verdict,
        found.order and f"order {found.order}",
        found.product,
    ]
    return clean(" · ".join(text for text in facts if text))
