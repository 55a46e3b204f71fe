"""Errors that runs saw are counted once, whatever runs and audits there are; tips that were
verified count as done.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from shutil import copytree

import pytest
from pyarrow import ArrowException

from jbclog.app.audit import records
from jbclog.app.audit.records import LAG, PastRuns, past_runs
from jbclog.core.errors import RecordError
from jbclog.core.rows import EventRow, Severity, StationFacts
from jbclog.maintenance.counter_totals.observed import Errors, Observation
from jbclog.maintenance.station_errors import counted_until
from jbclog.record.conclude import conclude
from jbclog.record.manifest import (
    LineFile,
    Manifest,
    write_manifest,
)
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal import seal_journal

NOW = datetime(2026, 11, 21, 6, 0, tzinfo=UTC)
FACTS = [
    StationFacts(name, f"/dev/{name}", "dde", "DDE", "1", ports=[1], tool_names={})
    for name in ("dde-1", "dde-2")
]
PLACE = ("hall", "dde-1")


def iso(hours: float) -> str:
    """So many hours after `NOW`, as the ledger has it."""
    return (NOW + timedelta(hours=hours)).isoformat(timespec="milliseconds")


@dataclass(eq=False)
class Recorded:
    """A run that begins at `begin`; events at hours after `NOW`."""

    folder: Path
    manifest: Manifest
    store: RunJournal

    def say(
        self,
        *events: tuple[float, str],
        station: str = "dde-1",
        severity: Severity = Severity.ERROR,
    ) -> None:
        for hours, kind in events:
            time = int((NOW + timedelta(hours=hours)).timestamp() * 1e6)
            self.store.event(EventRow(time, kind, severity, "it happened", station, 1))
        self.store.commit_now()

    def crash(self) -> None:
        """It ends, and nobody seals it."""
        self.store.close()
        self.store.release()
        GO_ON.remove(self)

    def end(self, hours: float) -> None:
        """It ends, and is sealed."""
        self.store.close()
        self.manifest.stop, self.manifest.exit_status = iso(hours), "success"
        seal_journal(self.folder)
        conclude(self.folder, self.manifest, self.store.lock)
        GO_ON.remove(self)


GO_ON: list[Recorded] = []


@pytest.fixture(autouse=True)
def _let_go() -> Iterator[None]:
    """A run that goes on is seen by all tests of this process: at the end of each, none does."""
    yield
    for one in GO_ON:
        one.store.close()
        one.store.release()
    GO_ON.clear()


def run(out: Path, begin: float, line: str = "hall") -> Recorded:
    folder = out / f"{(NOW + timedelta(hours=begin)).strftime('%Y%m%dT%H%M%SZ')}-{line}-abcd"
    folder.mkdir(parents=True)
    manifest = Manifest(
        folder.name, start=iso(begin), line=LineFile(line, "line.toml", "0" * 64), stations=FACTS
    )
    write_manifest(folder, manifest)
    store = RunJournal(folder, seal_every_s=None)
    store.start()
    GO_ON.append(Recorded(folder, manifest, store))
    return GO_ON[-1]


def look(hours: float, source: str = "wire", **errors: object) -> Observation:
    told = Errors(**errors)  # type: ignore[arg-type]  # test helper
    return Observation(
        iso(hours), iso(hours), *PLACE, "/dev/dde-1", True, source=source, errors=told
    )


@dataclass
class Ledger:
    """Looks at one station, each counting from where those before ended."""

    out: Path
    looks: list[Observation]

    def audit(self, hours: float, source: str = "wire", **errors: object) -> dict[str, int] | None:
        since = counted_until(self.looks, iso(hours))
        past = past_runs(self.out, {} if since is None else {PLACE: since}, iso(hours))
        assert past.trouble == []
        self.looks.append(past.with_errors(look(hours, source, **errors)))
        return self.looks[-1].errors.events


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    (tmp_path / "runs").mkdir()
    return Ledger(tmp_path / "runs", [look(-24)])


def test_an_error_of_a_run_counts_once(ledger: Ledger) -> None:
    one = run(ledger.out, -5)
    one.say((-4, "port.error"), (-3, "port.error"), (-3, "station.error"), (-2, "alarm.high"))
    one.say((-3, "port.state"), severity=Severity.WARNING)
    one.say((-3, "port.error"), station="dde-2")
    one.end(-1)
    assert ledger.audit(0) == {"alarm.high": 1, "port.error": 2, "station.error": 1}
    assert ledger.audit(0.01) is None  # no run since: nobody can tell
    assert ledger.audit(24) is None


def test_an_error_of_a_run_with_copies_counts_once(ledger: Ledger) -> None:
    """A backup, or a way to make a station look bad."""
    one = run(ledger.out, -5)
    one.say((-4, "port.error"), (-3, "port.error"))
    one.end(-1)
    for name in ("0 copy", f"{one.folder.name}-copy", one.folder.name.replace("abcd", "aaaa")):
        copytree(one.folder, ledger.out / name)
    assert ledger.audit(0) == {"port.error": 2}


def test_a_copy_with_another_manifest_is_a_trouble(ledger: Ledger) -> None:
    """As one that was made while the run was open."""
    one = run(ledger.out, -5)
    one.say((-4, "port.error"))
    copy = copytree(one.folder, ledger.out / "0 copy")
    one.say((-3, "port.error"))
    one.end(-1)
    past = past_runs(ledger.out, {PLACE: iso(-24)}, iso(0))
    assert past.events[PLACE] == {"port.error": 2}
    assert past.trouble == [
        f"{copy} has the same run as {one.folder.name} (another manifest); only"
        f" {one.folder.name} counts"
    ]


def test_a_run_over_several_audits_counts_part_by_part(ledger: Ledger) -> None:
    one = run(ledger.out, -30)
    one.say((-29, "port.error"), (-20, "port.error"))
    assert ledger.audit(0) == {"port.error": 1}  # the first was before the look a day ago
    # half the lag before the audit, told afterwards
    one.say((-LAG.total_seconds() / 7200, "station.error"), (1, "port.error"))
    assert ledger.audit(24) == {"port.error": 1, "station.error": 1}
    assert ledger.audit(48) == {}
    one.say((49, "port.error"))
    one.end(50)
    assert ledger.audit(72) == {"port.error": 1}
    assert ledger.audit(96) is None


def test_a_run_that_crashed_before_is_no_record_of_what_came_then(ledger: Ledger) -> None:
    """Nobody recovered it, so it has no end: it is no witness of a day without errors."""
    one = run(ledger.out, -30)
    one.say((-29, "port.error"))
    one.crash()
    assert ledger.audit(0) is None


def test_a_run_that_crashed_counts_as_far_as_it_goes(ledger: Ledger) -> None:
    one = run(ledger.out, -30)
    one.say((-29, "port.error"), (-20, "port.error"))
    one.crash()
    assert ledger.audit(0) == {"port.error": 1}
    assert ledger.audit(24) is None


def test_runs_of_other_lines_and_of_before_are_none_of_it(ledger: Ledger) -> None:
    for one, end in ((run(ledger.out, -4, "other"), -1), (run(ledger.out, -60), -50)):
        one.say((-3, "port.error"))
        one.end(end)
    assert ledger.audit(0) is None


def test_the_run_that_has_the_station_counts_once_whether_it_is_of_the_folder_or_not(
    ledger: Ledger,
) -> None:
    one = run(ledger.out, -4)
    one.say((-3, "port.error"))
    assert ledger.audit(0, f"run:{one.folder}", events={"port.error": 1}) == {"port.error": 1}
    one.end(0.5)
    assert ledger.audit(1, "run:/elsewhere/run", events={"port.error": 4}) == {"port.error": 4}


def test_the_first_look_and_one_that_saw_nothing_count_nothing(ledger: Ledger) -> None:
    one = run(ledger.out, -5)
    one.say((-4, "port.error"))
    one.end(-1)
    ledger.looks.clear()
    assert ledger.audit(0) is None
    unseen = replace(look(1), seen=False)
    assert past_runs(ledger.out, {PLACE: iso(-24)}, iso(1)).with_errors(unseen) == unseen


def test_a_clock_set_back_counts_nothing_twice_and_one_that_was_years_ahead_does_not_blind(
    ledger: Ledger,
) -> None:
    one = run(ledger.out, -5)
    one.say((-4, "port.error"))
    assert ledger.audit(0) == {"port.error": 1}
    assert not ledger.audit(-1)
    one.say((1, "port.error"))
    assert ledger.audit(2) == {"port.error": 1}
    ledger.audit(24 * 3650)
    one.say((3, "station.error"))
    assert ledger.audit(24) == {"station.error": 1}


def test_a_folder_that_is_not_there_leaves_its_errors_to_the_next_audit(ledger: Ledger) -> None:
    one = run(ledger.out, -5)
    one.say((-4, "port.error"))
    gone = past_runs(ledger.out / "gone", {PLACE: iso(-24)}, iso(0))
    assert (
        "no such folder; errors since the last audit are not counted now; the next audit counts"
        " them" in gone.trouble[0]
    )
    ledger.looks.append(gone.with_errors(look(0)))
    assert ledger.audit(1) == {"port.error": 1}


def test_a_run_that_cannot_be_read_is_told_and_takes_no_other_with_it(ledger: Ledger) -> None:
    one = run(ledger.out, -5)
    one.say((-4, "port.error"))
    (run(ledger.out, -4).folder / "manifest.json").write_text("{", encoding="utf-8")
    past = past_runs(ledger.out, {PLACE: iso(-24)}, iso(0))
    assert ["its manifest cannot be read" in text for text in past.trouble] == [True]
    assert past.events[PLACE] == {"port.error": 1}


@pytest.mark.parametrize("error", [RecordError("malformed"), ArrowException("odd")])
def test_nor_does_one_whose_journal_cannot_be_read(
    ledger: Ledger, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    run(ledger.out, -5).say((-4, "port.error"))

    def refused(*_: object) -> None:
        raise error

    monkeypatch.setattr(records, "error_events", refused)
    (text,) = past_runs(ledger.out, {PLACE: iso(-24)}, iso(0)).trouble
    assert text.endswith(f"its errors cannot be read: {error}")


def test_without_a_folder_nothing_changes() -> None:
    seen = look(0, events={"port.error": 1})
    assert PastRuns().with_errors(seen) == seen
