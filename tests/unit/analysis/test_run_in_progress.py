"""A run in progress: its accounting, metrics and gaps are those of what is committed, and say until
when.
"""

from __future__ import annotations

import pandas as pd
import pytest

import jbclog
from jbclog.record.ledger import ledger_of
from jbclog.record.run_journal import RunJournal
from support.records import small_run
from support.records.few_rows import vanish

SECONDS = 40.0
TABLES = ("accounting", "metrics", "gaps")


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    return jbclog.open_run(small_run.make_run(tmp_path_factory.mktemp("sealed"), SECONDS))


@pytest.fixture(scope="module")
def in_progress(tmp_path_factory: pytest.TempPathFactory) -> jbclog.Run:
    """A run with the same rows, committed and not sealed."""
    out = tmp_path_factory.mktemp("open")
    folder, _ = small_run.begin(out, SECONDS)
    store = RunJournal(folder)
    store.start()
    small_run.fill(store, SECONDS)
    store.commit_now()
    vanish(store)
    return jbclog.open_run(folder)


@pytest.mark.parametrize("name", TABLES)
def test_the_rows_are_those_that_the_sealed_run_has(
    sealed: jbclog.Run, in_progress: jbclog.Run, name: str
) -> None:
    assert not in_progress.manifest.is_sealed
    rows = getattr(in_progress, name)().drop(columns="run")
    assert len(rows) > 0
    expected = getattr(sealed, name)().drop(columns="run")
    if name == "samples":  # of a part they are sorted by port
        expected = expected.sort_values("seq", ignore_index=True)
    pd.testing.assert_frame_equal(rows, expected)


@pytest.mark.parametrize("name", TABLES)
def test_they_say_until_when(sealed: jbclog.Run, in_progress: jbclog.Run, name: str) -> None:
    until = in_progress.samples(columns=["time"])["time"].max()
    assert getattr(in_progress, name)().attrs == {"until": until}
    assert getattr(sealed, name)().attrs == {}


def test_so_do_those_of_many_runs(in_progress: jbclog.Run) -> None:
    runs = jbclog.open_runs(in_progress.folder.parent)
    until = in_progress.accounting().attrs["until"]
    assert runs.accounting("dde-1").attrs == {"until": {in_progress.name: until}}
    assert runs.events().attrs == {}


def test_the_accounting_is_the_ledger_as_rows(sealed: jbclog.Run) -> None:
    rows = sealed.accounting()
    reasons = rows.columns[rows.columns.get_loc("obtained") + 1 :]
    assert (rows["due"] == rows["obtained"] + rows[list(reasons)].sum(axis=1)).all()
    ledger = ledger_of(sealed.folder, sealed.stations)
    counts = ledger["ale-1"]["1"]["temperature_c"]
    mine = sealed.accounting("ale-1", 1).set_index("signal").loc["temperature_c"]
    assert (mine["due"], mine["obtained"]) == (counts["due"], counts["ok"])
    assert mine["disconnected"] == counts["disconnected"] == 30
    listed = {
        (name, port, s) for name, ports in ledger.items() for port in ports for s in ports[port]
    }
    found = zip(rows["station"], rows["port"].astype("str"), rows["signal"], strict=True)
    assert set(found) == listed
