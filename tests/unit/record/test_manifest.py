"""The manifest comes back as it was written; what is none, or newer, is said to be."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from jbclog.core import durable_files
from jbclog.core.errors import RecordError
from jbclog.core.goal import Goal
from jbclog.core.rows import SIGNAL_COLUMNS, StationFacts
from jbclog.protocol.commands.family import FAMILIES
from jbclog.record.find_runs import ALL, Unreadable, summary_of
from jbclog.record.manifest import (
    ClockStep,
    LineFile,
    Lost,
    Manifest,
    Metadata,
    NoManifest,
    Previous,
    RecipeFile,
    SealedFile,
    Unit,
    expect_readable,
    iso,
    manifest_sha256,
    read_manifest,
    write_manifest,
    wrong_digest,
)

KEYS = (
    "schema, run, state, exit_status, exit_code, verdict, rules, verdict_rules, start, stop,"
    " t0_mono, t0_utc, line, recipes, metadata, host, rate, guard, wire, stations, ledger, lost,"
    " units, files, previous, verifications, goals, clock_steps"
)

FULL = Manifest(
    "20261121T013000Z-bench-3-k7qd",
    state="sealed",
    exit_status="success",
    exit_code=0,
    verdict="ACCEPT",
    verdict_rules=[{"rule": "coverage", "limit_value": 99.5, "value": None}],
    start=iso(1),
    t0_mono=12.5,
    t0_utc=1_790_000_000.0,
    line=LineFile("bench-3", "line.toml", "ab"),
    recipes=[RecipeFile("recipes/a.toml", "cd", "a", 7)],
    metadata=Metadata(
        "Ü. <b>", None, None, ["SN1"], {"k": "v"}, ["W-7"], ["F-1"], ["T1", "a=T2", "a:2=T3"]
    ),
    units=[Unit("SN2", iso(2), iso(3)), Unit("SN1", iso(3))],
    host={"python": "3.11"},
    rate="max",
    stations=[
        StationFacts(
            "a",
            "url",
            "dde",
            tool_names={1: "T210"},
            safe_state={1: "verified"},
            due={"1": {"tool": 3}},
        )
    ],
    ledger={"a": {"1": {"tool": {"due": 3, "ok": 2, "timeout": 1}}}},
    lost=Lost(1.0, "a second"),
    clock_steps=[ClockStep(iso(2), -20.0, -20.0)],
    goals=[Goal("units", 3, 2, "Units finished: 2, wanted: 3."), Goal("joints", 40)],
    files=[
        SealedFile("samples/part-0000.parquet", 10, 100, "ef"),
        SealedFile("line.toml", None, 5, "01"),
    ],
)


def test_it_has_the_documented_keys() -> None:
    assert set(asdict(FULL)) == set(KEYS.split(", "))


def test_it_comes_back_as_it_was_written(tmp_path: Path) -> None:
    write_manifest(tmp_path, FULL)
    assert read_manifest(tmp_path) == FULL
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
    assert json.loads((tmp_path / "manifest.json").read_text())["stations"][0]["tool_names"] == {
        "1": "T210"
    }


def test_its_hash_is_that_of_the_file(tmp_path: Path) -> None:
    write_manifest(tmp_path, FULL)
    before = manifest_sha256(tmp_path)
    FULL.previous = Previous(
        "20261120T013000Z-bench-3-aaaa", before, "The run before this one on line bench-3."
    )
    write_manifest(tmp_path, FULL)
    FULL.previous = None
    assert manifest_sha256(tmp_path) != before


def test_a_write_that_fails_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(path: Path) -> None:
        raise OSError(28, "No space left on device")

    write_manifest(tmp_path, FULL)
    monkeypatch.setattr(durable_files, "sync_file", broken)
    with pytest.raises(RecordError, match="No space left"):
        write_manifest(tmp_path, Manifest("other"))
    assert read_manifest(tmp_path) == FULL
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no manifest"),
        ("[]", "no manifest"),
        ("{}", "missing required field `run`"),
        ('{"run": 5}', "run"),
        (
            '{"run": "r", "stations": [{"name": "a"}]}',
            r"missing required field `url` - at `\$.stations\[0\]`",
        ),
        ('{"run": "r", "lost": {"seconds_at_most": "x", "text": ""}}', "lost"),
        (
            (
                '{"run": "r", "stations": [{"name": "a", "url": "", "family": "",'
                ' "tool_names": {"x": "T"}}]}'
            ),
            r"Expected `int`, got `str` - at `key` in `\$.stations\[0\].tool_names`",
        ),
        ('{"run": "r", "schema": 99}', "this jbclog knows 2"),
        ("[" * 100_000, "no manifest"),
    ],
)
def test_what_is_no_manifest_is_refused_with_its_reason(
    tmp_path: Path, text: str, why: str
) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(RecordError, match=why):
        read_manifest(tmp_path)


def test_a_folder_without_one(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no run"):
        read_manifest(tmp_path)


def test_a_key_of_a_later_jbclog_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"run": "r", "schema": 2, "colour": "red"}')
    assert read_manifest(tmp_path) == Manifest("r")


def test_times_are_exact() -> None:
    assert iso(1_795_224_600_000_001) == "2026-11-21T01:30:00.000001Z"


@pytest.mark.parametrize("time", ["yesterday", "", "2026-11-21T01:30:00", "<b>", "9" * 5000])
def test_a_time_that_is_none_is_no_manifest_s(tmp_path: Path, time: str) -> None:
    write_manifest(tmp_path, Manifest("run", start=time))
    with pytest.raises(RecordError, match="is no manifest"):
        read_manifest(tmp_path)


def test_the_tip_of_a_port_is_the_one_said_of_it_of_its_station_or_of_all() -> None:
    said = Metadata(tips=["T1", "a=T2", "a:2=T3"])
    assert [said.tip("a", 2), said.tip("a", 1), said.tip("b", 1)] == ["T3", "T2", "T1"]
    assert Metadata(tips=["T1", "T2"]).tip("a", 1) is None  # one of two, and nobody said which
    assert Metadata().tip("a", 1) is None


def test_what_was_said_is_told_once_each_and_no_tag_stands_for_something_else() -> None:
    said = Metadata(
        "A. Rossi", None, "", ["1", "2"], {"operator": "M", "shift": "1"}, ["W"], [], ["T"]
    )
    expected = {
        "operator": "A. Rossi",
        "units": "1, 2",
        "wire lots": "W",
        "tips": "T",
        "tag operator": "M",
        "shift": "1",
    }
    assert said.said() == expected


def test_each_serial_stands_once() -> None:
    manifest = Manifest(
        "r",
        metadata=Metadata(units=["1", "2"]),
        units=[Unit("2", "t"), Unit("3", "t"), Unit("2", "u")],
    )
    assert manifest.serials() == ["1", "2", "3"]


def test_what_utf_8_cannot_write_is_a_question_mark_and_the_digest_holds(tmp_path: Path) -> None:
    """The url of a station below a folder whose name is in another code: a run of it must be sealed
    all the same.
    """
    write_manifest(tmp_path, Manifest("r", stations=[StationFacts("a", "/dev/b\udcff/a", "dde")]))
    assert read_manifest(tmp_path).stations[0].url == "/dev/b?/a"
    assert wrong_digest(tmp_path) is None


@pytest.mark.parametrize("period_s", [0, -0.1, 1e-300, 1e7])
def test_a_period_that_no_run_can_have_makes_it_no_manifest(
    tmp_path: Path, period_s: float
) -> None:
    write_manifest(
        tmp_path, replace(FULL, stations=[StationFacts("a", "url", "dde", period_s=period_s)])
    )
    with pytest.raises(NoManifest, match="is no sampling period"):
        read_manifest(tmp_path)
    found = summary_of(tmp_path, ALL)
    assert isinstance(found, Unreadable)
    assert "is no sampling period" in found.why


def test_a_signal_that_is_no_column_makes_it_no_manifest(tmp_path: Path) -> None:
    """Coverage reads the columns of these names: `report` ended in an internal error."""
    forged = replace(FULL, stations=[StationFacts("a", "url", "dde", signals=["status", "x"])])
    write_manifest(tmp_path, forged)
    with pytest.raises(NoManifest, match="station a: 'x' is no signal"):
        read_manifest(tmp_path)
    with pytest.raises(RecordError, match="no reader takes this manifest"):
        expect_readable(forged)


@pytest.mark.parametrize(
    "rule",
    [
        {"text": None},
        {"name": 1},
        {"uom": None},
        {"limit_value": [1]},
        {"observed": {"x": 1}},
        {"port": "1"},
        {"result": 1},
    ],
    ids=str,
)
def test_a_rule_of_other_types_makes_it_no_manifest(
    tmp_path: Path, rule: dict[str, object]
) -> None:
    """`report` ended in an internal error."""
    write_manifest(tmp_path, replace(FULL, verdict_rules=[*FULL.verdict_rules, rule]))
    with pytest.raises(NoManifest, match=f"{next(iter(rule))}"):
        read_manifest(tmp_path)


def test_every_signal_of_every_family_is_a_column() -> None:
    signals = {one.name for family in FAMILIES.values() for one in family.signals}
    assert signals <= set(SIGNAL_COLUMNS)


STATION = StationFacts("a", "url", "dde")


def test_a_station_s_name_that_is_too_long_makes_it_no_manifest(tmp_path: Path) -> None:
    forged = replace(FULL, stations=[replace(STATION, name="x" * 201)])
    write_manifest(tmp_path, forged)
    with pytest.raises(NoManifest, match="a station's name of 201 characters, at most 200"):
        read_manifest(tmp_path)
    with pytest.raises(RecordError, match="no reader takes this manifest"):
        expect_readable(forged)


def test_a_week_of_units_is_read_and_only_the_first_are_listed(tmp_path: Path) -> None:
    """One each 5 s for a week."""
    began = iso(2)
    write_manifest(
        tmp_path, replace(FULL, units=[Unit(f"SN{number}", began) for number in range(120_960)])
    )
    manifest = read_manifest(tmp_path)
    shown = replace(manifest.metadata, units=manifest.serials()).said()["units"]
    assert (len(manifest.units), len(shown) < 6000) == (120_960, True)
    assert shown.endswith(" and 120460 more, in manifest.json")
