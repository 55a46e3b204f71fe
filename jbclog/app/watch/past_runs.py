"""The runs of a folder and their reports, for the page. Takes no lock: an open run is known by its
lock file alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.locks import NAME as LOCK
from jbclog.core.text import clean
from jbclog.live.follower import is_run
from jbclog.record.find_runs import Found, summary_of
from jbclog.record.folder import RUN_NAME

MOST: Final = 100  # the newest ones
REPORT: Final = "report.html"


def past_runs(path: Path) -> list[dict[str, object]]:
    """Return the newest runs of the folder at `path`, or of the folder of the run at `path`, newest
    first. Raises OSError.
    """
    home = path.absolute().parent if is_run(path) else path
    names = sorted(
        (one.name for one in home.iterdir() if RUN_NAME.fullmatch(one.name)), reverse=True
    )[:MOST]
    return [
        {"name": name, "text": _text(home / name), "report": (home / name / REPORT).is_file()}
        for name in names
    ]


def report_of(path: Path, name: str) -> bytes:
    """Return the page of run `name` beside or below `path`. Raises OSError, also if it has none."""
    home = path.absolute().parent if is_run(path) else path
    if not RUN_NAME.fullmatch(name) or (home / name).is_symlink():
        raise FileNotFoundError(name)
    return read_foreign(home / name / REPORT, Kind.OF_REPORT)


def _text(run: Path) -> str:
    if (run / LOCK).exists():
        return "open"
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
