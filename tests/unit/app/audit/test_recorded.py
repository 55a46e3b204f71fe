"""What is taken from the record of a run in progress, and what of it is too old or missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from jbclog.app.audit import survey
from jbclog.app.audit.questions import SurveyTarget
from jbclog.app.audit.records import observed_in
from jbclog.core.rows import (
    COLUMN,
    SAMPLE_COLUMNS,
    CounterRow,
    EventRow,
    SettingRow,
    Severity,
    StationFacts,
)
from jbclog.core.serial_line import LineFormat
from jbclog.maintenance.counter_totals.observed import Observation, Standing
from jbclog.protocol.commands.family import FAMILIES
from jbclog.record.conclude import conclude
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal import seal_journal
from jbclog.session.manual.contact import Target
from support.virtual.audit_bench import AUDIT, MakeBench, count, wanted
from support.virtual.manual import station_text

NOW = datetime(2026, 11, 21, 6, 17, tzinfo=UTC)
URL = "/dev/serial/by-id/usb-1"
WANTED = SurveyTarget(AUDIT, "hall", Target("ale-7", URL, FAMILIES["ale"], LineFormat(), 1, None))
FACTS = StationFacts("ale-1", URL, "ale", "ALE", "1.00a", ports=[1], tool_names={1: "T245"})


def at(minutes: float) -> int:
    """So many minutes before the audit, in microseconds."""
    return int((NOW - timedelta(minutes=minutes)).timestamp() * 1e6)


def counted(minutes: float, counter: str, value: float | None, raw: str = "") -> CounterRow:
    return CounterRow(at(minutes), "ale-1", 1, counter, value, "h", raw)


def sample(minutes: float, **columns: object) -> list[object]:
    told = {
        "time": at(minutes),
        "tick": 1,
        "station": "ale-1",
        "port": 1,
        "quality": "ok",
        "late_us": 0,
        "scan_us": 1,
    } | columns
    row: list[object] = [None] * len(SAMPLE_COLUMNS)
    for name, value in told.items():
        row[COLUMN[name]] = value
    return row


@pytest.fixture
def run(tmp_path: Path) -> Iterator[RunJournal]:
    """A run in progress that knows its station and has read nothing of it."""
    folder = tmp_path / "20261121T013000Z-hall-k7qd"
    folder.mkdir()
    write_manifest(folder, Manifest(folder.name, stations=[FACTS]))
    store = RunJournal(folder, seal_every_s=None)
    store.start()
    store.facts(FACTS)
    store.commit_now()
    yield store
    store.close()
    store.release()


@pytest.fixture
def seen(run: RunJournal) -> Callable[..., Observation]:
    def after(*rows: CounterRow, wanted: SurveyTarget = WANTED) -> Observation:
        for row in rows:
            run.counter(row)
        run.commit_now()
        return observed_in(run.folder, wanted, NOW)

    return after


def test_a_run_that_is_sealed_meanwhile_still_has_its_station(
    run: RunJournal, seen: Callable[..., Observation]
) -> None:
    seen(counted(9, "work_h", 412.0, "00412"))
    write_manifest(run.folder, Manifest(run.folder.name, stations=[FACTS]))
    run.close()
    seal_journal(run.folder)
    conclude(run.folder, read_manifest(run.folder), run.lock)
    (count,) = observed_in(run.folder, WANTED, NOW).counts
    assert count.value == 412.0


def test_the_newest_readings_are_taken_with_their_time(
    run: RunJournal, seen: Callable[..., Observation]
) -> None:
    found = seen(
        counted(9, "work_h", 811), counted(1, "work_h", 812), counted(2, "dispensed_mm", 4.5)
    )
    assert (found.station, found.line, found.seen, found.source) == (
        "ale-7",
        "hall",
        True,
        f"run:{run.folder}",
    )
    assert [(one.counter, one.value, one.standing) for one in found.counts] == [
        ("work_h", 812.0, Standing.OK),
        ("dispensed_mm", 4.5, Standing.OK),
    ]
    assert found.time == "2026-11-21T06:16:00.000+00:00"
    assert found.identity is not None
    assert (
        found.identity.family,
        found.identity.model,
        found.identity.software,
        found.tool_names,
    ) == (
        "ale",
        "ALE",
        "1.00a",
        {1: "T245"},
    )


def test_a_reading_that_failed_since_takes_nothing_from_the_one_before(
    seen: Callable[..., Observation],
) -> None:
    found = seen(
        counted(5, "work_h", 811),
        counted(1, "work_h", None, "<timeout>"),
        counted(1, "sleep_h", None, "<bcc>"),
    )
    assert count(found, "work_h").value == 811.0
    assert (count(found, "sleep_h").standing, count(found, "sleep_h").why) == (
        Standing.UNREAD,
        "bcc",
    )


def test_what_is_older_than_an_hour_is_not_taken_for_now(
    run: RunJournal, seen: Callable[..., Observation]
) -> None:
    found = seen(counted(61, "work_h", 811))
    assert (found.seen, found.counts) == (False, ())
    assert found.why.startswith(
        f"the run {run.folder} holds this station and has read none of its counters within the last"
        " hour;"
    )


def test_a_station_that_the_run_has_not_asked_yet_is_left_alone(
    run: RunJournal, seen: Callable[..., Observation]
) -> None:
    run.facts(replace(FACTS, model=None))
    assert "has not asked it yet; it was not read. Audit again in a minute" in seen().why
    elsewhere = replace(WANTED, target=replace(WANTED.target, url="/dev/another"))
    assert "has not asked it yet" in seen(wanted=elsewhere).why


def test_settings_errors_and_events_are_the_runs(
    run: RunJournal, seen: Callable[..., Observation]
) -> None:
    for setting, port, text in (
        ("sleep_delay", 1, "5"),
        ("feeder_mode", None, "program"),
        ("selected_temperature", 1, "350"),
    ):
        run.setting(
            SettingRow(at(50), "ale-1", port, None, setting, "", None, None, text, None, "read")
        )
    run.setting(
        SettingRow(at(40), "ale-1", 1, None, "sleep_delay", "min", "7", "7", "7", None, "confirmed")
    )
    run.sample(sample(3, port_error=1, station_error=1))  # no more "now"
    run.sample(sample(1, port_error=7, station_error=0))
    kinds = (("port.error", 30), ("port.error", 20), ("station.error", 10), ("port.error", 400))
    for kind, minutes in kinds:
        run.event(EventRow(at(minutes), kind, Severity.ERROR, "it happened", "ale-1", 1))
    run.event(EventRow(at(5), "tool.changed", Severity.INFO, "it happened", "ale-1", 1))
    since = (NOW - timedelta(hours=2)).isoformat()
    found = seen(counted(1, "work_h", 812), wanted=replace(WANTED, since=since))
    assert found.parameters == {"1.sleep_delay": "7", "feeder_mode": "program"}
    assert (found.errors.station, found.errors.ports) == ("ok", {1: "stopped: maximum power"})
    assert found.errors.events == {"port.error": 2, "station.error": 1}


def test_a_record_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    found = observed_in(tmp_path / "nothing", WANTED, NOW)
    assert not found.seen
    assert found.why.startswith(
        f"the run {tmp_path / 'nothing'} holds it, and its record cannot be read: "
    )


def test_what_goes_wrong_with_one_station_takes_no_other_with_it(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = bench(station_text("dde-1", "dde"), station_text("dde-2", "dde"))
    monkeypatch.setattr(
        survey, "run_that_holds", lambda url: None if url.endswith("2") else {}["no"]
    )
    found: list[Observation] = []
    survey.Survey(at_once=1, access=made.access).all(wanted(made), found.append)
    assert [one.seen for one in found] == [False, True]
    assert "internal error, KeyError: 'no'" in found[0].why


def test_a_run_that_began_behind_a_server_of_ports_meanwhile_has_the_station(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch, run: RunJournal
) -> None:
    """A server takes a second client, and no lock tells the two of each other: what was read beside
    a run is not believed.
    """
    made = bench(station_text("ale-7", "ale"))
    url = "socket://127.0.0.1:4001"
    made._by_url[url] = made.wires["ale-7"]  # the same station, behind a server
    looks = iter([None, run.folder])
    monkeypatch.setattr(survey, "run_that_holds", lambda _: next(looks))
    found: list[Observation] = []
    target = replace(made.target("ale-7"), url=url)
    survey.Survey(at_once=1, access=made.access).all(
        [SurveyTarget(AUDIT, "hall", target)], found.append
    )
    assert (found[0].seen, found[0].source) == (False, f"run:{run.folder}")
    assert made.wires["ale-7"].heard != []
