"""A sealed run and one that a crash left open, as a release writes them, kept as data: every later
jbclog has to read them.

``python tests/support records.release_corpus NAME`` makes them in tests/data/releases/NAME, with
`noted.json` beside them: what was in the tables that day. Made once for each release whose record
differs, and never made again. (That of 0.1.0 was made by this file with the package of 0.1.0.)
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as pq

from jbclog.record.run_journal import RunJournal
from support.records.small_run import begin, fill, make_run

HOME = Path(__file__).parents[2] / "data" / "releases"
TABLES = ("samples", "events", "settings", "counters")
SECONDS = 2.0
# of no use to anybody later, and of its own machine
LEFT_OUT = ("live.reserve", "live.lock")


def table_text(folder: Path, table: str) -> str:
    """A table's rows as text, read without the package."""
    rows = pq.read_table(folder / table).to_pylist()
    return json.dumps(rows, default=str, sort_keys=True)


def noted(folder: Path) -> dict[str, object]:
    texts = {table: table_text(folder, table) for table in TABLES}
    return {
        table: {"rows": len(json.loads(text)), "sha256": _sha256(text)}
        for table, text in texts.items()
    }


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _annotate(folder: Path) -> None:
    try:
        from jbclog.record.annotations import append
    except ImportError:  # 0.1.0 had none
        return
    append(
        folder,
        who="A. Rossi",
        what="SN-001 was scrapped",
        why="cracked joint",
        utc_s=1_790_000_100.0,
    )


def _left_open(home: Path) -> None:
    """What a kill leaves: a copy, while the recorder has everything open."""
    with tempfile.TemporaryDirectory() as aside:
        folder, _ = begin(Path(aside), SECONDS)
        store = RunJournal(folder)
        store.start()
        fill(store, SECONDS)
        store.commit_now()
        shutil.copytree(folder, home / folder.name, ignore=shutil.ignore_patterns(*LEFT_OUT))
        store.close()


def main(name: str) -> None:
    home = HOME / name
    home.mkdir(parents=True)
    run = make_run(home / "sealed", SECONDS)
    _annotate(run)
    _left_open(home / "open")
    (home / "noted.json").write_text(json.dumps(noted(run), indent=1) + "\n")


if __name__ == "__main__":
    main(sys.argv[1])
