"""Runs of schema 1, 0.1.0's: read with the names of today, by whoever reads them; their events are
hashed and numbered as they were; what they lack is null.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from jbclog.analysis.run import Run, open_run
from jbclog.app.publish import publish
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.record.chains import breaks
from jbclog.record.check import check
from jbclog.record.guard_actions import event_dicts
from jbclog.record.old_names import OLD_COLUMNS
from jbclog.record.parts import row_groups
from jbclog.record.published import Tree
from jbclog.record.schema import SCHEMAS
from support.readers.texts import ROOT
from support.records import few_rows
from support.records.release_corpus import HOME

SEALED = [
    *HOME.glob("*/sealed/*"),
    *(ROOT / "notebooks" / "data").glob("*/2026*"),
]
NEW_NAMES = {table: [*names.values()] for table, names in OLD_COLUMNS.items()}

every_run = pytest.mark.parametrize("stored", SEALED, ids=lambda path: path.name)
every_sealed_run = pytest.mark.parametrize("stored", SEALED, ids=lambda path: path.name)


@pytest.fixture
def folder(stored: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stored, tmp_path / stored.name))


@pytest.fixture
def run(folder: Path) -> Iterator[Run]:
    """Reading it says nothing: what it lacks is said in the documents."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield open_run(folder)


def test_there_are_some() -> None:
    assert len(SEALED) == 4
    for stored in SEALED:
        names = pq.read_schema(stored / "samples" / "part-0000.parquet").names
        assert {"set_c", "run", "seq"}.intersection(names) == {"set_c"}


@every_run
def test_its_columns_have_the_names_of_today(run: Run) -> None:
    for table in TABLES:
        rows = getattr(run, table)()
        assert [*rows] == SCHEMAS[table].names
        assert rows.empty or set(rows["run"]) == {run.name}
        kinds = {name: str(kind) for name, kind in rows.dtypes.items()}
        for name in SCHEMAS[table].names:
            expected = str(SCHEMAS[table].empty_table().to_pandas()[name].dtype)
            assert kinds[str(name)] == expected, name
    samples = run.samples()
    assert samples["setpoint_c"].notna().any()
    assert "°C" in set(run.settings()["uom"])
    assert samples["seq"].isna().all()


@every_run
def test_its_reasons_and_its_manifest_name_the_signals_of_today(run: Run) -> None:
    coded = [*run.groups("samples", ["station", "reasons"])]
    reasons = ";".join(text for rows in coded for text in rows["reasons"].to_pylist() if text)
    assert "set_c=" not in reasons.replace("setpoint_c=", "")
    by_columns = ";".join(run.samples(columns=["reasons"])["reasons"].dropna())
    assert reasons == by_columns
    for facts in run.stations:
        assert "set_c" not in facts.signals
        assert not any("set_c" in signals for signals in facts.due.values())
    ledger = run.manifest.ledger
    assert not any("set_c" in signals for ports in ledger.values() for signals in ports.values())


def test_a_reason_for_the_setpoint_is_renamed() -> None:
    """In the runs of 0.1.0 the link was lost."""
    found = [text for path in SEALED for text in open_run(path).samples()["reasons"].dropna()]
    assert any("setpoint_c=" in text for text in found)


@every_sealed_run
def test_check_finds_nothing(folder: Path) -> None:
    assert check(folder) == []


@every_sealed_run
def test_its_events_are_counted_and_hashed_as_they_were(folder: Path) -> None:
    (rows,) = row_groups(folder, "events")
    assert rows["seq"].to_pylist() == [*range(1, len(rows) + 1)]
    assert [*breaks(folder.name, event_dicts(rows), 1)] == []
    changed = few_rows.with_cell(rows, 2, "limit_value", 380.5)
    assert [number for number, _ in breaks(folder.name, event_dicts(changed), 1)] == [4]
    assert [*breaks(folder.name, event_dicts(rows), 2)] != []


@every_sealed_run
def test_it_is_not_published(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"schema 1.*nothing was published") as refused:
        publish(folder, Tree.at(tmp_path / "plant"))
    assert len(str(refused.value).splitlines()) == 1
    assert not (tmp_path / "plant").exists()
