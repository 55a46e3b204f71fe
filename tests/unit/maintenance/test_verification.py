"""How a verification comes out, what is kept of it, and which one a run stands on."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

from jbclog.core.errors import RecordError, UsageError
from jbclog.maintenance.verification import (
    NAME,
    Given,
    Own,
    Result,
    Verification,
    cited,
    keep,
    last_valid,
    own_of,
    read_book,
    unstable,
    verify,
)
from support.faults.hostile_names import HOSTILE

NOW = datetime(2026, 11, 21, 8, 0, tzinfo=UTC)
OWN = own_of([350.0] * 12, 350.0, 0.0, "T245", "DDE")


def given(reading_c: float = 352.4, **more: object) -> Given:
    said = Given("dde-1", 1, reading_c, "TC-7", date(2027, 3, 1), "T-17", "A. Rossi")
    return replace(said, **more)  # type: ignore[arg-type]  # test helper


def kept(out: Path, result: str = "pass", days: float = 0.0, **more: object) -> Verification:
    """One more in the file: it passes, fails or is invalid, and was made `days` after `NOW`."""
    reading = 400.0 if result == "fail" else 351.0
    due = date(2020, 1, 1) if result == "invalid" else date(2027, 3, 1)
    one = verify(given(reading, due=due, **more), OWN, NOW + timedelta(days=days))
    assert one.result == result
    return keep(out, one)[0]


# -- rules -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reading", "result"),
    [(365.0, "pass"), (365.1, "fail"), (335.0, "pass"), (334.9, "fail"), (350.0, "pass")],
)
def test_the_limit_is_15_either_way_and_belongs_to_what_is_allowed(
    reading: float, result: str
) -> None:
    one = verify(given(reading), OWN, NOW)
    assert (one.result, one.offset_c) == (result, round(reading - 350, 2))


def test_the_setting_counts_as_well_as_the_stations_own_reading() -> None:
    far = own_of([340.0] * 12, 350.0)
    assert verify(given(338.0), far, NOW).result == "pass"
    one = verify(given(334.0), far, NOW)  # 6 from the station, 16 from the setting
    assert one.result == "fail"
    assert "-6.0 °C from the station's own reading and -16.0 °C from the setpoint" in one.text


def test_an_instrument_past_its_due_date_proves_nothing() -> None:
    # on the day it still holds
    assert verify(given(400.0, due=NOW.date()), OWN, NOW).result == "fail"
    one = verify(given(400.0, due=NOW.date() - timedelta(days=1)), OWN, NOW)
    assert (one.result, one.is_valid, one.proposed_adjust_c) == (Result.INVALID, False, None)


@pytest.mark.parametrize(
    ("reading", "adjust", "proposed"),
    [
        (340.0, 0.0, 10),
        (362.0, 0.0, -12),
        (340.0, 45.0, None),
        (340.0, 40.0, 50),
        (350.2, 0.0, None),
        (340.0, None, None),
    ],
)
def test_the_proposal_brings_the_two_together_within_what_a_station_takes(
    reading: float, adjust: float | None, proposed: int | None
) -> None:
    assert verify(given(reading), replace(OWN, adjust_c=adjust), NOW).proposed_adjust_c == proposed


def test_uncertainty_is_of_steps_spread_and_the_instrument() -> None:
    one = verify(given(), OWN, NOW)
    assert one.uncertainty_c == pytest.approx(2 / 12**0.5, abs=0.01)  # whole degrees, no spread
    assert verify(given(instrument_u_c=3.0), OWN, NOW).uncertainty_c == pytest.approx(
        (4 / 12 + 9) ** 0.5, abs=0.01
    )
    near = verify(given(364.5, instrument_u_c=3.0), OWN, NOW)
    assert (near.result, "difference to the limit is within the uncertainty" in near.text) == (
        "pass",
        True,
    )
    assert "uncertainty" not in verify(given(355.0, instrument_u_c=3.0), OWN, NOW).text


@pytest.mark.parametrize(
    "more",
    [
        {"limit_c": 0.0},
        {"limit_c": float("nan")},
        {"instrument_u_c": -1.0},
        {"reading_c": float("inf")},
        {"reading_c": 900.0},
    ],
)
def test_what_no_thermometer_says_is_refused(more: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        verify(replace(given(), **more), OWN, NOW)  # type: ignore[arg-type]  # test helper


def test_a_tip_that_does_not_stand_still_cannot_stand_for_itself() -> None:
    still, working = [350.0, 351.0] * 6, ["working", "working"]
    assert unstable(still, working, [350.0, 350.0]) is None
    assert "changed by 4 °C" in (unstable([*still, 354.0], working, [350.0]) or "")
    assert "in sleep" in (unstable(still, ["working", "sleep"], [350.0]) or "")
    assert "setpoint changed" in (unstable(still, working, [350.0, 360.0]) or "")
    assert "only 3" in (unstable([350.0] * 3, working, [350.0]) or "")


# -- the file --------------------------------------------------------------------------------------


def test_it_is_read_back_as_it_was_kept_and_chained(tmp_path: Path) -> None:
    those = [kept(tmp_path), kept(tmp_path, "fail"), kept(tmp_path, "invalid")]
    book = read_book(tmp_path)
    assert (book.entries, book.wrong) == (those, [])
    assert [one.seq for one in book.entries] == [1, 2, 3]
    assert [one.prev_sha256 for one in book.entries[1:]] == [link for link, _ in book.lines[:2]]
    assert book.head == book.lines[2][0]


def test_a_folder_that_is_not_there_yet_is_made(tmp_path: Path) -> None:
    assert read_book(tmp_path / "new").entries == []
    kept(tmp_path / "new")
    assert len(read_book(tmp_path / "new").entries) == 1


@pytest.mark.parametrize("change", ["value", "out", "swap", "first"])
def test_a_line_changed_taken_out_or_moved_shows_and_nothing_is_added_behind_it(
    tmp_path: Path, change: str
) -> None:
    for result in ("pass", "fail", "pass"):
        kept(tmp_path, result)
    path = tmp_path / NAME
    lines = path.read_bytes().splitlines(keepends=True)
    match change:
        case "value":
            lines[1] = lines[1].replace(b'"fail"', b'"pass"')
        case "out":
            del lines[1]
        case "swap":
            lines[0], lines[1] = lines[1], lines[0]
        case "first":
            del lines[0]
    path.write_bytes(b"".join(lines))
    assert read_book(tmp_path).wrong
    assert cited(tmp_path, [("dde-1", 1)], {}, NOW + timedelta(days=9))[0].state == "unreadable"
    with pytest.raises(RecordError, match="nothing was added"):
        kept(tmp_path)


def test_a_line_that_was_cut_off_does_not_count_and_stops_nothing(tmp_path: Path) -> None:
    kept(tmp_path)
    whole = (tmp_path / NAME).read_bytes()
    (tmp_path / NAME).write_bytes(whole + whole[:100])
    assert [text for _, text in read_book(tmp_path).wrong] == [
        "was cut off while it was written; it counts for nothing"
    ]
    kept(tmp_path, "fail")
    book = read_book(tmp_path)
    assert ([one.result for one in book.entries], book.wrong) == (["pass", "fail"], [])


def test_it_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("")
    (tmp_path / NAME).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RecordError):
        kept(tmp_path)
    assert (tmp_path / "elsewhere").read_text() == ""


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts_stay_within_their_line(tmp_path: Path, name: str) -> None:
    text = HOSTILE[name]
    kept(tmp_path, tip=text, by=text, instrument=text, note=text)
    kept(tmp_path)
    book = read_book(tmp_path)
    assert (len(book.entries), book.wrong, book.entries[0].tip) == (2, [], text)
    assert (tmp_path / NAME).read_bytes().count(b"\n") == 2


def test_a_line_of_another_kind_is_no_verification(tmp_path: Path) -> None:
    kept(tmp_path)
    with (tmp_path / NAME).open("a") as file:
        file.write(json.dumps({"seq": 2, "sha256": "x"}) + "\n")
    assert read_book(tmp_path).wrong == [(2, "is no verification, or was changed")]


# -- which one a run stands on ---------------------------------------------------------------------


def test_the_last_valid_one_is_cited_whether_it_passed_or_not(tmp_path: Path) -> None:
    kept(tmp_path, "pass", 0)
    kept(tmp_path, "fail", 1)
    kept(tmp_path, "invalid", 2)
    kept(tmp_path, "pass", 9)  # after the run began
    (one,) = cited(tmp_path, [("dde-1", 1)], {}, NOW + timedelta(days=5))
    assert (one.state, one.days, one.seq, one.offset_c) == ("fail", 4.0, 2, 50.0)
    assert one.sha256 == read_book(tmp_path).lines[1][0]


def test_a_port_or_station_that_was_never_verified_has_none(tmp_path: Path) -> None:
    kept(tmp_path)
    kept(tmp_path, "invalid", port=2)
    found = cited(tmp_path, [("dde-1", 2), ("dde-2", 1)], {}, NOW)
    assert [(one.station, one.port, one.state) for one in found] == [
        ("dde-1", 2, "none"),
        ("dde-2", 1, "none"),
    ]


def test_a_verification_is_that_of_a_tip(tmp_path: Path) -> None:
    kept(tmp_path, "pass", 0, tip="T-17")
    kept(tmp_path, "fail", 1, tip="T-18")
    later, place = NOW + timedelta(days=2), ("dde-1", 1)
    states = [
        cited(tmp_path, [place], {place: tip}, later)[0].state
        for tip in ("T-17", "T-18", "T-19", None)
    ]
    assert states == ["pass", "fail", "other tip", "fail"]
    found = last_valid(read_book(tmp_path), "dde-1", 1, "T-17")
    assert found is not None
    assert found.seq == 1


def test_a_display_that_a_person_read_is_a_reading_of_its_own() -> None:
    one = verify(given(340.0), Own(350.0), NOW)
    assert (one.station_n, one.setpoint_c, one.proposed_adjust_c, one.offset_c) == (
        0,
        None,
        None,
        -10.0,
    )
