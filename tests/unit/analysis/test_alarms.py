"""Alarm episodes of a run in its folder: sealed, open, cut off; what the recorder told held against
the record; acknowledging.
"""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.alarms.state_machine import Detector
from jbclog.analysis.derived_schemas import ALARMS_SCHEMA
from jbclog.analysis.run import open_run
from jbclog.record.annotations import append, read
from support.invoked import invoked
from support.records import small_run
from support.records.alarm_series import STATION, Series, being_recorded, random_series, recorded
from support.records.sealed_run import alarm, samples, seal, station, table
from support.virtual.manual import Ended
from support.virtual.recorded_run import run_in
from support.virtual.virtual_run import RECIPE, line_text


def jbclog(*words: str | Path) -> Ended:
    ended = invoked(*words)
    return Ended(ended.exit_code, ended.stdout, ended.stderr)


HOT = "\n[[station.sim.fault]]\nkind = 'overheat'\nat_s = {at_s}\nfor_s = {for_s}\nby_c = {by_c}\n"


def run_of(
    home: Path, sim: str, recipe: str = RECIPE, duration_s: float = 40.0, rate: str | None = None
) -> Path:
    line = line_text("joints_per_minute = 0\n" + sim, "ports = [1]")
    return run_in(home, line, recipe, duration_s, rate=rate)


@pytest.fixture(scope="module")
def hot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two alarms on a real grid; nothing acknowledged."""
    sim = HOT.format(at_s=12, for_s=6, by_c=20) + HOT.format(at_s=28, for_s=3, by_c=20)
    return run_of(tmp_path_factory.mktemp("hot"), sim)


def test_a_run_as_it_is_recorded(hot: Path) -> None:
    found = open_run(hot).alarm_findings()
    assert [[len(one.by[detector]) for detector in Detector] for one in found.incidents] == [
        [1, 1, 1],
        [1, 1, 1],
    ]
    assert found.findings() == []
    events = open_run(hot).events()
    raised = events[events["kind"] == "alarm.episode.raised"]
    assert list(raised["raw"]) == [one.by[Detector.SAMPLES][0].id for one in found.incidents]
    assert list(raised["severity"]) == ["warning", "warning"]


def test_the_table_has_its_columns_and_their_types(hot: Path) -> None:
    table = open_run(hot).alarms(witnesses=True)
    assert list(table.columns) == ALARMS_SCHEMA.names
    assert len(table) == 6
    assert str(table["start"].dtype) == "datetime64[us, UTC]"
    assert table["seconds"].dtype == "float64"
    assert (table["start_earliest"] <= table["start"]).all()
    assert table["acknowledged_by"].isna().all()


def test_a_run_without_alarms_has_the_same_columns(tmp_path: Path) -> None:
    none = open_run(recorded(Series().add(350, times=20), tmp_path / "none"))
    some = open_run(recorded(Series().add(350, times=20).add(395, times=20), tmp_path / "some"))
    for witnesses, count in ((False, 1), (True, 2)):
        rows, no_rows = (run.alarms(witnesses=witnesses) for run in (some, none))
        assert (len(no_rows), len(rows)) == (0, count)
        assert list(no_rows.dtypes.items()) == list(rows.dtypes.items())


@pytest.mark.parametrize("rate", ["0.5", "10", "max"])
def test_at_any_rate_the_record_gives_what_the_recorder_logged(tmp_path: Path, rate: str) -> None:
    sim = (
        HOT.format(at_s=12, for_s=9, by_c=25)
        + "\n[[station.sim.fault]]\nkind = 'dropout'\nat_s = 16\nfor_s = 2\n"
    )
    recipe = RECIPE + 'on_difference = "continue"\n'
    found = open_run(
        run_of(tmp_path, sim, recipe, rate=rate if rate == "max" else float(rate))
    ).alarm_findings()  # type: ignore[arg-type]
    assert sum(len(one.by[Detector.SAMPLES]) for one in found.incidents) == 1
    assert found.live == []


@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(4, 12))]
)
def test_random_series_through_a_real_record(tmp_path: Path, seed: int) -> None:
    assert open_run(recorded(random_series(seed, 400), tmp_path)).alarm_findings().live == []


@pytest.mark.parametrize("seconds", [-7200.0, -0.8, 0.8, 7200.0])
def test_a_clock_that_is_stepped_changes_nothing(tmp_path: Path, seconds: float) -> None:
    """A limit is changed just before the step and just behind it; an alarm is pending over it."""
    series = (
        Series()
        .add(350, times=20)
        .change("alarm_high_limit", "360 °C")
        .add(365, times=3)
        .step_clock(seconds)
    )
    series.add(365, times=30).change("alarm_high_limit", "370 °C").add(350, times=30).add(
        365, times=20
    ).add(375, times=20)
    found = open_run(recorded(series, tmp_path)).alarm_findings()
    samples = [one for incident in found.incidents for one in incident.by[Detector.SAMPLES]]
    samples.sort(key=lambda one: one.limit_c or 0)
    assert [(one.limit_c, one.seconds) for one in samples] == [(360, 3.3), (370, None)]
    assert found.live == []


@pytest.mark.parametrize("seconds", [-7200.0, -0.8, 0.8, 7200.0])
def test_nor_one_that_was_stepped_before_the_first_row(tmp_path: Path, seconds: float) -> None:
    series = (
        Series()
        .step_clock(seconds)
        .add(350, times=20)
        .add(365, times=10)
        .change("alarm_high_limit", "360 °C")
    )
    series.add(365, times=30).step_clock(-seconds).add(350, times=30).change(
        "alarm_high_limit", "370 °C"
    ).add(365, times=20)
    found = open_run(recorded(series, tmp_path)).alarm_findings()
    (one,) = (one for incident in found.incidents for one in incident.by[Detector.SAMPLES])
    assert (one.limit_c, one.seconds) == (360, 3.0)
    assert found.live == []


def test_a_run_that_is_open_or_was_cut_off(tmp_path: Path) -> None:
    series = Series().add(350, times=20).add(395, times=20)
    with being_recorded(series, tmp_path) as (folder, _):
        table = open_run(folder).alarms(witnesses=True)
    assert list(table["state"]) == ["active", "active"]
    # the recorder is gone, nothing is sealed
    again = open_run(folder).alarms(witnesses=True)
    assert list(again["episode"]) == list(table["episode"])


def test_an_episode_that_the_recorder_did_not_log_is_a_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jbclog.analysis.alarms.live.LiveAlarms._emit_all", lambda *_: None)
    series = Series().add(350, times=20).add(395, times=20)
    (told,) = open_run(recorded(series, tmp_path)).alarm_findings().live
    assert told.endswith("raised by the record, but the recorder logged no such event.")


def test_a_fault_of_the_evaluation_does_not_end_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("made up")

    monkeypatch.setattr("jbclog.analysis.alarms.port_watch.PortWatch._evaluate", broken)
    folder = recorded(Series().add(350, times=20), tmp_path)
    events = open_run(folder).events()
    (text,) = events[events["kind"] == "alarm.episode.failed"]["text"]
    assert "ZeroDivisionError: made up" in text
    assert len(open_run(folder).samples()) == 20


def test_a_record_from_before_there_were_episodes(tmp_path: Path) -> None:
    """Its facts have no rules: nobody evaluated, so nothing is missing. Its delay was not read: no
    alarm on samples.
    """
    found = open_run(small_run.make_run(tmp_path)).alarm_findings()
    assert [len(one.by[Detector.STATION]) for one in found.incidents] == [1]
    assert found.live == []


# -- acknowledging ---------------------------------------------------------------------------------


def test_alarms_on_the_command_line(hot: Path) -> None:
    shown = jbclog("alarms", hot)
    assert shown.code == 1
    assert "high temperature, limit 380 °C; A B C; cleared" in shown.out
    assert f"jbclog alarms ack {hot} B-high-dde-1-p1-" in shown.err
    facts = json.loads(jbclog("alarms", hot, "--json").out)
    assert len(facts["alarms"]) == 6
    assert facts["figures"][0]["station"] == STATION
    assert len(facts["not_acknowledged"]) == 2


def test_acknowledging_with_a_name_and_a_reason(tmp_path: Path) -> None:
    folder = run_of(tmp_path, HOT.format(at_s=12, for_s=6, by_c=20), duration_s=25)
    (name,) = json.loads(jbclog("alarms", folder, "--json").out)["not_acknowledged"]
    done = jbclog(
        "alarms", "ack", folder, name, "--by", "A. Rossi", "--reason", "hot air near the tip"
    )
    assert (done.code, done.err) == (0, "")
    assert [(one.kind, one.who, one.what, one.why) for one in read(folder).said] == [
        ("alarm.acknowledged", "A. Rossi", name, "hot air near the tip")
    ]
    table = open_run(folder).alarms(witnesses=True)
    assert list(table["acknowledged_by"]) == ["A. Rossi"] * 3  # the whole incident
    assert pd.notna(table["acknowledged_at"]).all()
    shown = jbclog("alarms", folder)
    assert (shown.code, shown.err) == (0, "")
    assert "Acknowledged by A. Rossi at " in shown.out
    assert "; one in " not in shown.out  # one alarm gives no mean time between alarms
    assert "; 1 acknowledged, 50 % within " in shown.out
    facts = json.loads(jbclog("alarms", folder, "--json").out)["figures"]
    waited = open_run(folder).alarms(witnesses=True).set_index("detector").loc["B"]
    seconds = (waited["acknowledged_at"] - waited["raised"]).total_seconds()
    assert {one["detector"]: one["ack_p50"]["n"] for one in facts} == {"A": 1, "B": 1, "C": 1}
    assert next(
        one["ack_p95"]["value"] for one in facts if one["detector"] == "B"
    ) == pytest.approx(seconds, abs=0.01)
    again = jbclog("alarms", "ack", folder, name.replace("B-", "C-"), "--by", "B", "--reason", "C")
    assert again.code == 2
    assert jbclog("check", folder).code == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("ack", "RUN", "B-high-x", "--by", "A", "--reason", "B"), "has no such episode"),
        (
            ("ack", "RUN", "B-high-x", "--by", "A"),
            "alarms ack: --reason TEXT is required; nothing was added",
        ),
        (
            ("ack", "RUN", "B-high-x", "--by", " ", "--reason", "B"),
            "alarms ack: --by WHO is required; nothing was added",
        ),
        (("ack", "RUN", "--by", "A", "--reason", "B"), "give RUN, or ack RUN EPISODE"),
        (("RUN", "RUN"), "give RUN, or ack RUN EPISODE"),
        (("RUN", "--by", "A"), "belong to `alarms ack"),
        (("nowhere",), "no such folder"),
    ],
)
def test_wrong_usage(hot: Path, words: tuple[str, ...], said: str) -> None:
    ended = jbclog("alarms", *(str(hot) if word == "RUN" else word for word in words))
    assert ended.code == 2
    assert said in ended.err
    assert read(hot).said == []


def test_other_annotations_acknowledge_nothing(tmp_path: Path) -> None:
    folder = recorded(Series().add(350, times=20).add(395, times=20), tmp_path)
    name = open_run(folder).alarm_findings().incidents[0].name
    append(folder, who="A", what=name, why="B")
    found = open_run(folder).alarm_findings()
    assert found.is_waiting(found.incidents[0])


def test_what_was_acknowledged_and_is_not_in_the_record_is_a_finding(tmp_path: Path) -> None:
    folder = recorded(Series().add(350, times=20), tmp_path)
    append(folder, who="A", what="B-high-dde-1-p1-x", why="B", kind="alarm.acknowledged")
    said = "B-high-dde-1-p1-x: acknowledged by A, but the record gives no such episode."
    assert open_run(folder).alarm_findings().findings() == [said]
    assert said in jbclog("alarms", folder).out


def test_changed_acknowledgements_are_reported(tmp_path: Path) -> None:
    folder = recorded(Series().add(350, times=20).add(395, times=20), tmp_path)
    name = open_run(folder).alarm_findings().incidents[0].name
    append(folder, who="A. Rossi", what=name, why="B", kind="alarm.acknowledged")
    path = folder / "annotations.jsonl"
    path.write_text(
        path.read_text(encoding="utf-8").replace("A. Rossi", "B. Rossi"), encoding="utf-8"
    )
    shown = jbclog("alarms", folder)
    assert shown.code == 1  # it counts for nothing
    assert "annotations.jsonl: line 1 is no annotation, or was changed" in shown.err
    assert "Not acknowledged." in shown.out


def test_an_open_run_is_shown_and_not_acknowledged(tmp_path: Path) -> None:
    series = Series().add(350, times=20).add(395, times=20)
    with being_recorded(series, tmp_path) as (folder, _):
        assert "; active" in jbclog("alarms", folder).out
        name = open_run(folder).alarm_findings().incidents[0].name
        refused = jbclog("alarms", "ack", folder, name, "--by", "A", "--reason", "B")
    assert refused.code == 4
    assert "is not sealed" in refused.err


@pytest.mark.parametrize("kind", ["alarm.high", "setting.changed", "clock.step"])
def test_events_of_an_unknown_severity_count_like_others(tmp_path: Path, kind: str) -> None:
    """As of a newer jbclog, or of a forged part; it was an internal error."""
    found = []
    for severity in ("warning", "grave"):
        told = alarm(26)._replace(kind=kind, severity=severity)  # type: ignore[arg-type]
        run = seal(tmp_path / severity, [station(rows=600)], table(samples(600)), [told])
        found.append(open_run(run).alarms(witnesses=True).drop(columns="episode"))
    pd.testing.assert_frame_equal(*found)


def test_each_alarm_is_one_row_of_the_detector_that_describes_it(hot: Path) -> None:
    run = open_run(hot)
    alarms, every = run.alarms(), run.alarms(witnesses=True)
    assert list(alarms["detector"]) == ["B", "B"]
    assert list(alarms["incident"]) == [1, 2]
    assert list(alarms["witnesses"]) == ["A, B, C", "A, B, C"]
    assert list(alarms.columns) == list(every.columns)
    pd.testing.assert_frame_equal(alarms, every[every["main"]].reset_index(drop=True))
    assert every.groupby("incident")["main"].sum().tolist() == [1, 1]


def test_an_excursion_is_no_alarm_and_is_among_the_witnesses(tmp_path: Path) -> None:
    series = Series().change("alarm_high_delay", "2.00 s")
    series = series.add(350, times=20).add(395, times=3).add(350, times=20)
    run = open_run(recorded(series, tmp_path))
    assert len(run.alarms()) == 0
    every = run.alarms(witnesses=True)
    assert list(every["detector"]) == ["C"]
    assert not every["main"].any()
    assert len(run.alarms("dde-1", 1, witnesses=True)) == 1
