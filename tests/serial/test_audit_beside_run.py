"""A run that starts while an audit has its port, and an audit that starts while a run has it: one
of them gets the port, and both report it.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from support.command import (
    RECIPE,
    WireLog,
    expect_terminated,
    is_sampling,
    jbclog,
    started,
    until,
)
from support.invoked import invoked
from support.product import (
    Observation,
    Port,
    PortAccess,
    SimProcess,
    SurveyTarget,
    open_for_survey,
    patch,
    read_counter_book,
)

pytestmark = pytest.mark.usefixtures("patient")

SOURCE = """[line]
name = "bench"
[[station]]
name = "ucr-1"
url = "ucr-1"
family = "ucr"
[station.sim]
wire = false
tool = 9
"""


class Bench:
    """One virtual station on a real pseudo-terminal, and the log of its questions."""

    def __init__(self, folder: Path, stations: SimProcess) -> None:
        self.folder, self.line, self.log = (
            folder,
            stations.line_path,
            WireLog(folder / "wire.jsonl"),
        )

    def run(self) -> tuple[str | Path, ...]:
        return ("run", RECIPE, "--line", self.line, "--out", self.folder / "runs", "-d", "600s")

    def audit(self) -> tuple[int, str]:
        ledger = self.folder / "counters.jsonl"
        ended = invoked("audit", "--line", self.line, "--ledger", ledger, "--json")
        assert json.loads(ended.stdout)["exit_code"] == ended.exit_code
        return ended.exit_code, ended.stderr

    @property
    def seen(self) -> Observation:
        return read_counter_book(self.folder / "counters.jsonl").observations[-1]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    (tmp_path / "source.toml").write_text(SOURCE, encoding="utf-8")
    with SimProcess(
        tmp_path / "source.toml", tmp_path / "bench", log=tmp_path / "wire.jsonl"
    ) as stations:
        yield Bench(tmp_path, stations)


def when_open(monkeypatch: pytest.MonkeyPatch, act: Callable[[], None]) -> None:
    """Call `act` when the audit has opened the port, before its first question."""
    real = open_for_survey

    def opened(wanted: SurveyTarget, access: PortAccess) -> Port:
        port = real(wanted, access)
        act()
        return port

    patch(monkeypatch, "survey._open", opened)


def test_the_audit_was_first(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is refused, names the process that has the port, and sends nothing; the audit reads
    everything.
    """
    runs: list[subprocess.CompletedProcess[str]] = []
    when_open(monkeypatch, lambda: runs.append(jbclog(*bench.run())))
    code, notes = bench.audit()
    (run,) = runs
    assert (run.returncode, "is in use by process" in run.stderr) == (3, True), run.stderr
    assert "no tool was touched" in run.stderr
    assert (code, notes, bench.seen.source) == (0, "", "wire")
    assert bench.log.writes("ucr-1") == []


def test_the_run_was_first(bench: Bench) -> None:
    """The run continues undisturbed. The audit takes the readings in its record, or reports that
    there are none yet.
    """
    run = started(*bench.run())
    try:
        assert until(lambda: bench.log.path.exists() and len(bench.log.questions("ucr-1")) > 0)
        code, notes = bench.audit()
        assert bench.seen.source.startswith("run:")
        if not bench.seen.seen:
            assert code == 3
            assert "it was not read. Audit again in a minute" in notes
        assert until(lambda: is_sampling(bench.folder / "runs"))
        assert bench.audit() == (0, "")
        assert (bench.seen.seen, bench.seen.source.startswith("run:")) == (True, True)
        expect_terminated(run)
    finally:
        run.kill()
        run.communicate(timeout=200)
    assert (bench.audit()[0], bench.seen.source) == (0, "wire")
