"""The reader of a segment that stands on the page of the run's folder, which was written from the
page alone.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.core.rows import TABLES
from jbclog.record.frames import MARK
from jbclog.record.journal_reader import Journal
from support.records.few_rows import begun, facts, hand_over

PAGE = Path(__file__).parents[3] / "docs/reference/run-folder.md"
LONGEST = 66


def page_reader(folder: Path) -> dict[str, Any]:
    (code,) = re.findall(r"```text\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code.count("\n") <= LONGEST
    file = folder / "read_segment.py"
    file.write_text(code, encoding="utf-8")
    return runpy.run_path(str(file))


def journal_of(folder: Path) -> Path:
    """A run that was left open after five commits."""
    journal = begun(folder)
    journal.facts(facts())
    for commit in range(5):
        hand_over(journal, range(commit * 40, (commit + 1) * 40))
        journal.commit_now()
    journal.close()
    journal.release()
    return journal.folder


def rows_of(run: Path) -> dict[str, dict[int, dict[str, Any]]]:
    """The rows of each table as jbclog reads them, by `seq`."""
    tables: dict[str, dict[int, dict[str, Any]]] = {}
    with Journal(run) as journal:
        for table in TABLES:
            found = [row for rows in journal.rows(table) for row in rows.to_pylist()]
            tables[table] = {row["seq"]: row for row in found}
    return tables


def plain(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name not in ("run", "seq")}


def assert_same(reader: dict[str, Any], run: Path) -> None:
    (segment,) = run.glob("live-*.journal")
    tables, _, _ = reader["read_segment"](segment)
    for table, rows in rows_of(run).items():
        read = tables.get(table, {})
        assert {seq: plain(row) for seq, row in read.items()} == {
            seq: plain(row) for seq, row in rows.items()
        }


def test_the_reader_of_the_page_reads_what_jbclog_reads(tmp_path: Path) -> None:
    reader = page_reader(tmp_path)
    run = journal_of(tmp_path / "runs")
    (segment,) = run.glob("live-*.journal")
    tables, stations, notes = reader["read_segment"](segment)
    assert [*stations] == ["a"]
    assert notes["run"] == run.name
    assert len(tables["samples"]) == 200
    assert_same(reader, run)


@settings(max_examples=25, deadline=None)
@given(where=st.floats(0, 0.999), bits=st.integers(1, 255))
def test_both_read_the_same_beside_damage(tmp_path_factory: Any, where: float, bits: int) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    reader = page_reader(folder)
    run = journal_of(folder / "runs")
    (segment,) = run.glob("live-*.journal")
    data = bytearray(segment.read_bytes())
    begin = data.index(MARK)  # the first commit has the schemas that the reader needs
    data[begin + int((len(data) - begin) * where)] ^= bits
    segment.write_bytes(data)
    assert_same(reader, run)
