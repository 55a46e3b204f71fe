"""The notebooks on the recorded examples beside them: what they say is what was done to the virtual
stations.

That of reading a run runs from top to bottom on one that is recorded here.
"""

from __future__ import annotations

import json
import re
import tarfile
from collections.abc import Iterator
from datetime import date, timedelta
from pathlib import Path

import pytest

from support.fleets.audit_fleet import BEGIN
from support.fleets.counters import look
from support.product import add_to_counter_book, check_run, counted_in
from support.readers.notebook_runs import (
    HOME,
    NOTEBOOKS,
    Kernel,
    has_picture,
    kernel,
    run_here,
    shown,
)
from support.records import notebook_data
from support.records.sealed_run import samples, seal, station, table
from support.records.small_run import begin, make_run

DATA = HOME / "data"
FOLLOW, JOINTS, CAPABILITY, AUDIT = (
    next(HOME.glob(f"0{number}_*.ipynb")) for number in range(2, 6)
)
# of the kernel's own making, not ours
pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")


def unpack(packed: Path, folder: Path) -> None:
    with tarfile.open(packed) as opened:
        # Python before 3.11.4 has none
        opened.extraction_filter = getattr(tarfile, "data_filter", None)
        opened.extractall(folder)


@pytest.fixture(scope="module")
def of_all() -> Iterator[Kernel]:
    with kernel() as begun:
        yield begun


@pytest.fixture(autouse=True)
def _on_the_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("JBCLOG_RUN", raising=False)
    monkeypatch.delenv("JBCLOG_RUNS", raising=False)
    monkeypatch.delenv("JBCLOG_LEDGER", raising=False)
    monkeypatch.delenv("JBCLOG_TASKS", raising=False)


@pytest.mark.parametrize(
    "notebook", [FOLLOW, JOINTS, CAPABILITY, AUDIT], ids=lambda path: path.stem
)
def test_each_opens_with_its_question_and_ends_with_its_limitations(notebook: Path) -> None:
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    texts = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    assert re.search(r"\*\*Question: [^*]+\?\*\*", texts[0])
    assert texts[-1].startswith("## Limitations")


def test_following_an_alarm_shows_which_detector_reported_what(of_all: Kernel) -> None:
    node = of_all.executed(FOLLOW)
    found = shown(node, "findings")
    assert re.findall(r"incident (\d): detected by ([ABC and]+)", found) == [
        ("1", "A and B and C"),
        ("2", "C"),
        ("3", "A and B and C"),
        ("4", "B and C"),
        ("5", "A"),
    ]
    assert "the station's delay is 1.50 s" in found
    assert "an answer with the flags was lost meanwhile" in found
    assert "no sample is beyond 380 °C" in found
    story = shown(node, "story").split("incident ")
    assert "no event" in story[2]
    assert "link.lost" in story[3]
    assert has_picture(node, "overview")
    assert has_picture(node, "zoomed")


def test_joints_are_held_against_the_feeders_own_count(of_all: Kernel) -> None:
    node = of_all.executed(JOINTS)
    assert "18 joints with solder wire found, the feeder counted 19 feeds: +1." in shown(
        node, "feeder"
    )
    assert re.search(r"Two witnesses: feeder 19, heat (\d+|not known)\.", shown(node, "feeder"))
    assert "No readings from 79.5 s to 84.4 s" in shown(node, "feeder")
    # one was made in the gap
    assert re.search(r"^joints +NaN", shown(node, "metrics"), re.MULTILINE)
    assert re.search(r"^recovery_s +1\.\d", shown(node, "metrics"), re.MULTILINE)
    for cell in ("course", "laid", "scatter"):
        assert has_picture(node, cell), cell


def test_capability_is_given_where_it_means_something_and_refused_elsewhere(of_all: Kernel) -> None:
    node = of_all.executed(CAPABILITY)
    worn, steady = shown(node, "words").split("dde-2 port 1")
    assert "test 5: two of three points beyond two sigma on one side" in worn
    assert "their spread is that of the resolution" in steady
    slopes = [line.split() for line in shown(node, "slopes").splitlines()[1:]]
    drifts = {row[3]: (float(row[6]), float(row[7])) for row in slopes}
    assert drifts["T-0231"][0] > 0  # 0.05 s more of dwell were put in each day
    assert drifts["T-0198"][0] <= 0.0 <= drifts["T-0198"][1]
    indices = shown(node, "indices")
    assert re.search(r"dde-1 +1 +220 +NaN +NaN", indices)
    assert "Neighbouring values are alike" in indices
    index, bound = (
        float(text) for text in re.findall(r"dde-2 +1 +110 +([\d.]+) +([\d.]+)", indices)[0]
    )
    assert 1 < bound < index < 2
    for cell in ("charts", "room", "means"):
        assert has_picture(node, cell), cell


def test_the_audit_is_right_where_it_commits_itself(of_all: Kernel) -> None:
    node = of_all.executed(AUDIT)
    assert "damaged lines of the ledger: 0" in shown(node, "open")
    supposed = shown(node, "marks")
    # two resets of seven counters at two ports, and six roll-overs
    assert re.search(r"dde-1 +fell +fell +34\n", supposed)
    assert re.search(r"dde-2 +fell +fell +13\n", supposed)
    assert not re.search(r"ucr-1 ", supposed)
    due = shown(node, "due")
    assert re.search(r"ucr-1 +1 +Change the handpiece .* due ", due)
    assert re.search(
        r"Change the tip +\d+ to \d+ +fine +20\d\d-\d\d-\d\d +20\d\d-\d\d-\d\d +20\d\d-\d\d-\d\d",
        due,
    )
    # without a last service date
    assert len(re.findall(r"Verify the tip temperature +at least \d+ +overdue", due)) == 4
    truth = notebook_data.simulated()["ucr-1"]
    used_up = BEGIN + timedelta(
        hours=truth.when((1, "plugged_h"), 3200 + truth.true((1, "plugged_h"), truth.moments[0]))
    )
    begin, end = (
        date.fromisoformat(day) for day in re.findall(r"\d{4}-\d\d-\d\d", shown(node, "believed"))
    )
    assert begin <= used_up.date() <= end
    assert re.search(r"ucr-1( +\d+\.\d){4}", shown(node, "use"))
    for cell in ("course", "believed"):
        assert has_picture(node, cell), cell


def test_the_audits_odometers_hold_the_truth(tmp_path: Path) -> None:
    unpack(DATA / "counters.tar.xz", tmp_path)
    counted = counted_in(tmp_path / "counters.jsonl")
    for name, made in notebook_data.simulated().items():
        for key, (first_look, last_look, total) in counted["bench-3", name].items():
            first, last = made.moments[first_look], made.moments[last_look]
            assert made.true(key, last) - made.true(key, first) in total, (name, key)


@pytest.mark.parametrize("notebook", [FOLLOW, JOINTS], ids=lambda path: path.stem)
def test_a_run_in_which_nothing_happened_can_be_read(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = samples(100)
    columns["temperature_c"][:] = 350
    columns["power_permille"][:] = 80
    monkeypatch.setenv("JBCLOG_RUN", str(seal(tmp_path, [station(rows=100)], table(columns))))
    run_here(notebook)


def test_a_single_run_is_not_enough_and_breaks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seal(tmp_path, [station(rows=300)], table(samples(300)))
    monkeypatch.setenv("JBCLOG_RUNS", str(tmp_path))
    run_here(CAPABILITY)


def test_a_single_look_is_not_enough_and_breaks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_to_counter_book(tmp_path / "ledger.jsonl", [look(counts={(1, "work_h"): 412})])
    monkeypatch.setenv("JBCLOG_LEDGER", str(tmp_path / "ledger.jsonl"))
    run_here(AUDIT)


def test_the_examples_are_whole_records(tmp_path: Path) -> None:
    for packed in DATA.glob("*.tar.xz"):
        unpack(packed, tmp_path / packed.name)
    runs = [path.parent for home in (DATA, tmp_path) for path in home.glob("*/*/manifest.json")]
    assert len(runs) == 1 + 1 + 20
    assert [run.name for run in runs if check_run(run)] == []


# -- reading a run, and how notebooks are kept -----------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The newest sealed run; a newer one is still being recorded."""
    sealed = make_run(tmp_path_factory.mktemp("lab") / "demo-runs", 45)
    begin(sealed.parent, 45)
    return sealed


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(notebook: Path) -> None:
    data = json.loads(notebook.read_text("utf-8"))
    assert all(
        not cell.get("outputs") and cell.get("execution_count") is None for cell in data["cells"]
    )
    import nbformat

    nbformat.validate(nbformat.reads(notebook.read_text("utf-8"), as_version=4))


def test_reading_a_run_finds_the_newest_sealed_one_and_its_alarm(of_all: Kernel, run: Path) -> None:
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


def test_a_notebook_finds_nothing_of_the_one_before(
    of_all: Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One kernel runs all notebooks here, which a user opens in one of its own."""
    import nbformat
    from nbclient.exceptions import CellExecutionError

    def executed(code: str) -> str:
        cells = [nbformat.v4.new_code_cell(code, id="only")]
        (tmp_path / "one.ipynb").write_text(nbformat.writes(nbformat.v4.new_notebook(cells=cells)))
        return shown(of_all.executed(tmp_path / "one.ipynb", tmp_path), "only")

    monkeypatch.setenv("JBCLOG_RUN", "a run")
    assert (
        executed("import os; kept = os; print(os.environ['JBCLOG_RUN'], os.getcwd())")
        == f"a run {tmp_path}\n"
    )
    monkeypatch.delenv("JBCLOG_RUN")
    assert executed("import os; print(os.getenv('JBCLOG_RUN'))") == "None\n"
    with pytest.raises(CellExecutionError, match="name 'kept' is not defined"):
        executed("kept")
