"""The ledger: what is put in comes out, what was changed is told and counts for nothing, and one
audit at a time writes to it.
"""

from __future__ import annotations

import json
import tracemalloc
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

import pytest

from jbclog.core.chain import body_of
from jbclog.core.errors import RecordError
from jbclog.maintenance.counter_totals.observed import (
    Count,
    Entry,
    Errors,
    Fact,
    Identity,
    Observation,
    Standing,
)
from jbclog.maintenance.ledger import AuditInProgress, add, auditing, read_book, read_entry, written


def read_line(line: bytes) -> Entry | None:
    """What a line of the ledger has; None if it counts for nothing."""
    body = body_of(line)
    with suppress(ValueError):
        return None if body is None else read_entry(body)
    return None


COUNTS = (
    Count(1, "work_h", "h", 412.0),
    Count(1, "dispensed_mm", "mm", 0.3),
    Count(2, "sleep_cycles", "count", None, Standing.MOVING, (7.0, 8.0, 9.0)),
    Count(2, "plugged_h", "h", None, Standing.UNREAD, why="nak4"),
)
SEEN = Observation(
    time="2026-11-21T05:00:00+00:00",
    audit="2026-11-21T04:59:58+00:00",
    line="bench-3",
    station="dde-1",
    url="/dev/ttyUSB0",
    seen=True,
    identity=Identity("dde", "DDE", "8886412"),
    counts=COUNTS,
    tool_names={1: "T245", 2: "none"},
    parameters={"1.sleep_delay_min": "5"},
    errors=Errors("0", {1: "0"}, {"port.error": 2}, "2026-11-21T05:00:00+00:00"),
)
SILENT = replace(
    SEEN,
    seen=False,
    why="no answer",
    identity=None,
    counts=(),
    tool_names={},
    parameters={},
    errors=Errors(),
)
DONE = Fact(
    "2026-11-20T05:00:00+00:00",
    "2026-11-21T05:00:00+00:00",
    "A. Rossi",
    "bench-3",
    "dde-1",
    "tip-change",
    1,
    "TIP-0231",
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "counters.jsonl"


def test_what_is_put_in_comes_out(path: Path) -> None:
    kept = add(path, [SEEN, DONE]) + add(path, [SILENT])
    book = read_book(path)
    assert book.entries == kept
    assert [replace(one, seq=0, prev_sha256="") for one in kept] == [SEEN, DONE, SILENT]
    assert ([one.seq for one in kept], book.wrong, book.is_sound) == ([1, 2, 3], [], True)


def test_counts_that_were_read_are_those_that_were_written(path: Path) -> None:
    (kept,) = add(path, [SEEN])
    (found,) = read_book(path).observations
    counts = found.counts
    assert type(counts) is not tuple
    assert (counts == COUNTS, counts in [COUNTS], counts == COUNTS[1:]) == (True, True, False)
    assert (len(counts), counts[0], counts[-1], counts[1:3]) == (
        4,
        COUNTS[0],
        COUNTS[3],
        COUNTS[1:3],
    )
    assert (hash(counts), repr(counts)) == (hash(COUNTS), repr(COUNTS))
    assert written(found) == written(kept)


def test_what_a_look_repeats_is_kept_once(path: Path) -> None:
    """Hundreds of thousands of looks are in memory at once; the objects of one take 3 kB and more.
    The second station is asked between two looks at the first.
    """
    names = [
        (port, f"{name}_h") for port in (1, 2) for name in ("plugged", "work", "idle", "sleep")
    ]
    looks = [
        replace(
            SEEN,
            audit=f"2026-11-21T05:{number // 60:02}:{number % 60:02}+00:00",
            station=station,
            counts=tuple(Count(*key, "h", 412.0 + number) for key in names),
            parameters={f"1.setting_{place}": str(place) for place in range(20)},
        )
        for number in range(500)
        for station in ("dde-1", "dde-2")
    ]
    kept = add(path, looks)
    tracemalloc.start()
    book = read_book(path)
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert taken / len(looks) < 1200
    assert book.entries == kept


def test_no_field_of_it_is_lost() -> None:
    """What is read field by field has all the fields that there are, each with something in it."""
    assert SEEN.identity is not None
    every = replace(
        SEEN, identity=replace(SEEN.identity, uid="U-17"), seq=1, prev_sha256="0" * 64, why="late"
    )
    parts = (every, every.identity, every.errors)
    assert all(getattr(part, one.name) for part in parts for one in fields(part))  # type: ignore[arg-type]  # it has one
    assert read_line(written(every)) == every


def test_a_line_is_as_it_was_published(path: Path) -> None:
    """By hand: who reads old ledgers must find this form for ever."""
    plain = json.loads(written(SEEN))
    assert plain["counts"] == {"1": {"work_h": 412.0, "dispensed_mm": 0.3}}
    assert plain["moving"] == {"2": {"sleep_cycles": [7.0, 8.0, 9.0]}}
    assert plain["unread"] == {"2": {"plugged_h": "nak4"}}
    assert plain["identity"] == {
        "family": "dde",
        "model": "DDE",
        "software": "8886412",
        "uid": None,
    }


def test_no_file_is_an_empty_ledger(path: Path) -> None:
    assert read_book(path).entries == []


def test_every_changed_byte_of_a_line_is_seen() -> None:
    line = written(SEEN)
    for place in range(len(line)):
        changed = line[:place] + bytes([line[place] ^ 1]) + line[place + 1 :]
        assert read_line(changed) is None, place


NO_TIMES = ("", "today", "0001-01-01T00:00:00+00:00", "9999-12-31T23:00:00+00:00", "2026-11-21")


@pytest.mark.parametrize("time", NO_TIMES)
def test_a_line_whose_times_cannot_be_compared_counts_for_nothing(path: Path, time: str) -> None:
    """An audit took such a ledger for an internal error."""
    wrong = [
        *(replace(SEEN, **{name: time}) for name in ("time", "audit")),
        replace(SEEN, errors=replace(SEEN.errors, until=time)),
        *(replace(DONE, **{name: time}) for name in ("time", "told")),
    ]
    assert [read_line(written(one)) for one in wrong] == [None] * 5
    add(path, [SEEN])
    path.write_bytes(path.read_bytes() + written(replace(wrong[0], seq=2)) + b"\n")
    add(path, [DONE])
    book = read_book(path)
    assert [one.seq for one in book.entries] == [1, 2]
    assert not book.is_sound


@pytest.mark.parametrize("standing", Standing)
def test_a_line_of_ports_that_no_station_has_counts_for_nothing(standing: Standing) -> None:
    """Thousands of them kept an audit busy for hours."""
    values = {Standing.OK: 1.0}.get(standing)
    for port, is_one in ((1, True), (63, True), (64, False), (10**6, False), (-1, False)):
        counted = (Count(port, "work_h", "h", values, standing, why=""),)
        assert (read_line(written(replace(SEEN, counts=counted))) is not None) == is_one


def test_a_changed_line_is_told_and_counts_for_nothing_and_the_next_audit_is_still_kept(
    path: Path,
) -> None:
    add(path, [SEEN, DONE, SILENT])
    path.write_bytes(path.read_bytes().replace(b"A. Rossi", b"B. Rossi"))
    add(path, [SEEN])
    book = read_book(path)
    assert [one.seq for one in book.entries] == [1, 3, 4]
    assert not book.is_sound
    assert [number for number, _ in book.wrong] == [2, 3]
    assert "line 2 is no line of a ledger, or was changed" in book.sentences[0]


def test_a_line_taken_out_is_told(path: Path) -> None:
    add(path, [SEEN, DONE, SILENT])
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[2])
    assert [number for number, _ in read_book(path).wrong] == [2]


def test_a_line_cut_off_by_a_crash_harms_nothing(path: Path) -> None:
    add(path, [SEEN, DONE])
    path.write_bytes(path.read_bytes()[:-40])
    assert read_book(path).is_sound
    assert len(read_book(path).wrong) == 1
    add(path, [SILENT])
    book = read_book(path)
    assert ([one.seq for one in book.entries], book.wrong) == ([1, 2], [])


def test_a_long_ledger_is_added_to_by_its_end(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jbclog.core.chain.TAIL", 3000)
    for _ in range(8):
        add(path, [SEEN, DONE])
    book = read_book(path)
    assert ([one.seq for one in book.entries], book.wrong) == (list(range(1, 17)), [])


def test_two_audits_do_not_go_on_at_once(path: Path) -> None:
    with auditing(path), pytest.raises(AuditInProgress, match="another audit"), auditing(path):
        pass
    with auditing(path):  # and what ended leaves nothing behind
        pass
    assert list(path.parent.iterdir()) == []


def test_a_killed_audits_lock_holds_nobody_up(path: Path) -> None:
    path.parent.mkdir()
    path.with_name("counters.jsonl.lock").touch()
    with auditing(path):
        pass


def test_facts_are_added_while_an_audit_goes_on(path: Path) -> None:
    with auditing(path):
        add(path, [DONE])
    assert len(read_book(path).facts) == 1


def test_what_cannot_be_written_is_said(path: Path, tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    path.mkdir()
    with pytest.raises(RecordError, match="cannot be written"):
        add(path, [SEEN])
    with pytest.raises(RecordError, match="cannot be read"):
        read_book(path)


# -- ledgers of nothing but faults -----------------------------------------------------------------


def test_of_many_wrong_lines_the_first_are_named_and_the_others_counted(path: Path) -> None:
    (kept,) = add(path, [SEEN])
    path.write_bytes((written(kept) + b"\n") * 500)
    book = read_book(path)
    assert (len(book.wrong), len(book.entries)) == (101, 500)
    assert len(book.sentences) == 101
    assert book.sentences[-1].endswith("line 102 is wrong, and 398 later lines with it")
