"""The notebooks run from top to bottom on a recorded run, as they stand."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.readers.notebook_runs import NOTEBOOKS, Kernel, has_picture, kernel, shown
from support.records.sealed_run import samples, seal, station, table
from support.records.small_run import make_run

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")  # of the kernel's own making, not ours


@pytest.fixture(scope="module")
def of_all() -> Iterator[Kernel]:
    with kernel() as begun:
        yield begun


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("lab") / "demo-runs", 45)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(notebook: Path) -> None:
    data = json.loads(notebook.read_text("utf-8"))
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in data["cells"])
    import nbformat

    nbformat.validate(nbformat.reads(notebook.read_text("utf-8"), as_version=4))


def test_reading_a_run_finds_the_newest_and_its_alarm(of_all: Kernel, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("JBCLOG_RUN", raising=False)
    node = of_all.executed(NOTEBOOKS[0], run.parents[1])
    assert run.name in shown(node, "open")
    assert "REJECT" in shown(node, "open")
    assert "verified" in shown(node, "stations")
    assert "1 alarm counted; 0 allowed." in shown(node, "judged")
    assert "alarm.high" in shown(node, "flags")
    assert "390.0" in shown(node, "flags")
    assert "link.lost" in shown(node, "events")
    assert "disconnected" in shown(node, "quality")
    assert "recovery_p95_s" in shown(node, "count")
    assert "**Question:" in node.cells[0].source
    for cell in ("plotted", "around"):
        assert has_picture(node, cell), cell


def test_a_run_that_is_named_is_read_also_where_nothing_happened(
    of_all: Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet = seal(tmp_path, [station(rows=300)], table(samples(300)))
    monkeypatch.setenv("JBCLOG_RUN", str(quiet))
    node = of_all.executed(NOTEBOOKS[0], tmp_path)
    assert quiet.name in shown(node, "open")
    assert not next(one for one in node.cells if one.id == "around").outputs
    assert "dde-1" in shown(node, "count")


def test_a_notebook_finds_nothing_of_the_one_before(of_all: Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One kernel runs all notebooks here, which a user opens in one of its own."""
    import nbformat
    from nbclient.exceptions import CellExecutionError

    def executed(code: str) -> str:
        cells = [nbformat.v4.new_code_cell(code, id="only")]
        (tmp_path / "one.ipynb").write_text(nbformat.writes(nbformat.v4.new_notebook(cells=cells)))
        return shown(of_all.executed(tmp_path / "one.ipynb", tmp_path), "only")

    monkeypatch.setenv("JBCLOG_RUN", "a run")
    assert executed("import os; kept = os; print(os.environ['JBCLOG_RUN'], os.getcwd())") == f"a run {tmp_path}\n"
    monkeypatch.delenv("JBCLOG_RUN")
    assert executed("import os; print(os.getenv('JBCLOG_RUN'))") == "None\n"
    with pytest.raises(CellExecutionError, match="name 'kept' is not defined"):
        executed("kept")
