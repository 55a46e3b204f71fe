"""What is said of a run after it was sealed: added to, chained, and never in the way."""

from __future__ import annotations

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import pytest

from support.product import (
    ANNOTATIONS_FILE,
    LONGEST_ANNOTATION,
    Annotation,
    Manifest,
    RecordError,
    append_annotation,
    durable_line,
    manifest_sha256,
    read_annotations,
    write_manifest,
)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    write_manifest(tmp_path, Manifest("a-run", state="sealed"))
    return tmp_path


def say(folder: Path, what: str = "SN-12 was scrapped") -> str:
    return append_annotation(
        folder, who="A. Rossi", what=what, why="cracked joint", utc_s=1_790_000_000.25
    )


def wrong(folder: Path) -> list[str]:
    return [f"{number}: {text}" for number, text in read_annotations(folder).wrong]


def lines(folder: Path) -> list[bytes]:
    return (folder / ANNOTATIONS_FILE).read_bytes().splitlines(keepends=True)


def test_who_when_what_and_why_are_kept(run: Path) -> None:
    say(run)
    append_annotation(
        run,
        who="jbclog guard",
        what="dde-1 port 1: stand",
        why="its recorder was killed",
        kind="safety.safe_state",
    )
    first, second = read_annotations(run).said
    assert (first.seq, first.time, first.kind) == (1, "2026-09-21T14:13:20.250000Z", "note")
    assert (first.who, first.what, first.why) == ("A. Rossi", "SN-12 was scrapped", "cracked joint")
    assert first.prev_sha256 == manifest_sha256(run)
    assert (second.seq, second.kind) == (2, "safety.safe_state")
    assert wrong(run) == []


def test_the_head_is_the_manifest_s_hash_and_then_the_last_line_s(run: Path) -> None:
    assert read_annotations(run).head == manifest_sha256(run)
    heads = [say(run), say(run)]
    assert read_annotations(run).head == heads[1] != heads[0]


def test_every_byte_of_every_line_is_vouched_for(run: Path) -> None:
    for text in ("one", "two – 350 °C", "three"):
        say(run, text)
    whole = (run / ANNOTATIONS_FILE).read_bytes()
    for place in range(len(whole)):
        data = bytearray(whole)
        data[place] ^= 1
        (run / ANNOTATIONS_FILE).write_bytes(data)
        assert wrong(run), f"byte {place}: {bytes(data[place - 20 : place + 20])!r}"


def test_lines_moved_taken_out_and_put_in_are_found(run: Path) -> None:
    for text in ("one", "two", "three"):
        say(run, text)
    one, two, three = lines(run)
    broken = "does not carry the hash of the line before it"
    for changed, number in (([one, three], 2), ([one, three, two], 2), ([one, one, two, three], 2)):
        (run / ANNOTATIONS_FILE).write_bytes(b"".join(changed))
        assert wrong(run)[0].startswith(f"{number}: {broken}")
    (run / ANNOTATIONS_FILE).write_bytes(two + three)
    assert wrong(run)[0].startswith("1: does not carry the hash of the manifest")


def test_another_manifest_is_found(run: Path) -> None:
    say(run)
    write_manifest(run, Manifest("a-run", state="sealed", verdict="ACCEPT"))
    assert wrong(run) == ["1: does not carry the hash of the manifest: one of the two was changed"]


def test_a_line_that_was_cut_off_anywhere_is_told_and_keeps_nobody_from_going_on(run: Path) -> None:
    say(run, "one")
    kept = (run / ANNOTATIONS_FILE).read_bytes()
    say(run, "two")
    whole = (run / ANNOTATIONS_FILE).read_bytes()
    for end in range(len(kept) + 1, len(whole)):
        (run / ANNOTATIONS_FILE).write_bytes(whole[:end])
        assert len(wrong(run)) == 1
        say(run, "three")
        assert wrong(run) == [], "the line behind vouches for what is left"
        assert [one.what for one in read_annotations(run).said if one.what != "two"] == [
            "one",
            "three",
        ]
    assert (run / ANNOTATIONS_FILE).read_bytes().startswith(whole[: len(whole) - 1]), (
        "nothing is ever taken away"
    )


def test_a_run_that_is_not_sealed_takes_none(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no manifest"):
        say(tmp_path)
    write_manifest(tmp_path, Manifest("a-run"))
    with pytest.raises(RecordError, match="is not sealed"):
        say(tmp_path)


@pytest.mark.parametrize("field", ["who", "what", "why"])
def test_nothing_is_no_answer(run: Path, field: str) -> None:
    with pytest.raises(RecordError, match=f"says {field}: nothing"):
        append_annotation(run, **{"who": "a", "what": "b", "why": "c", field: " \n\u202e"})


def test_what_does_not_show_is_left_out_and_what_is_long_is_cut(run: Path) -> None:
    append_annotation(run, who="A\x1b]0;x\x07", what="x" * 5000, why="one\ntwo\u202e", kind="note")
    (said,) = read_annotations(run).said
    assert (said.who, said.why) == ("A ]0;x", "one two")
    assert len(said.what) == LONGEST_ANNOTATION
    assert len(lines(run)) == 1


def test_a_link_is_not_followed(run: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "file"
    elsewhere.write_text("")
    (run / ANNOTATIONS_FILE).symlink_to(elsewhere)
    for call in (say, read_annotations):
        with pytest.raises(RecordError, match="link"):
            call(run)
    assert elsewhere.read_text() == ""


def test_a_pipe_in_its_place_is_not_waited_for(run: Path) -> None:
    os.mkfifo(run / ANNOTATIONS_FILE)
    with pytest.raises(RecordError):
        say(run)


def test_many_writers_at_once_make_one_chain(run: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: say(run, f"number {number}"), range(40)))
    assert wrong(run) == []
    assert sorted(one.what for one in read_annotations(run).said) == sorted(
        f"number {number}" for number in range(40)
    )


@pytest.mark.parametrize(
    "line",
    ["", "{}", "[]", "null", "1", "[" * 5000, '{"sha256": 1}', "\x00", '{"seq": 1, "sha256": "x"}'],
)
def test_a_line_that_is_no_annotation_is_a_sentence(run: Path, line: str) -> None:
    (run / ANNOTATIONS_FILE).write_text(line + "\n")
    assert wrong(run) == ["1: is no annotation, or was changed"]


def test_the_lines_are_plain_json_for_whoever_reads_them(run: Path) -> None:
    say(run)
    assert set(json.loads(lines(run)[0])) == {
        "seq",
        "time",
        "kind",
        "who",
        "what",
        "why",
        "prev_sha256",
        "sha256",
    }


@pytest.mark.parametrize(
    "changed",
    [{"who": ""}, {"who": " "}, {"why": ""}, {"what": "\t"}, {"time": "yesterday"}],
    ids=lambda one: "".join(one),
)
def test_what_nobody_said_or_with_no_reason_counts_for_nothing_though_its_hash_is_right(
    run: Path, changed: dict[str, str]
) -> None:
    said = asdict(
        Annotation(
            1,
            "2026-09-21T14:13:20.250000Z",
            "note",
            "A. Rossi",
            "hot",
            "door open",
            manifest_sha256(run),
        )
    )
    (run / ANNOTATIONS_FILE).write_bytes(durable_line(said) + b"\n")
    assert len(read_annotations(run).said) == 1
    (run / ANNOTATIONS_FILE).write_bytes(durable_line({**said, **changed}) + b"\n")
    assert read_annotations(run).said == []
    assert read_annotations(run).complaints() == [
        "annotations.jsonl: line 1 is no annotation, or was changed"
    ]


def test_nothing_is_added_to_a_file_of_millions_of_lines(run: Path) -> None:
    """To look through them would take half a minute."""
    (run / ANNOTATIONS_FILE).write_bytes(b"\n" * 200_000)
    with pytest.raises(RecordError, match="200000 lines"):
        say(run)
    assert (run / ANNOTATIONS_FILE).read_bytes() == b"\n" * 200_000


def test_a_file_of_damaged_lines_gives_a_hundred_faults_and_their_number(run: Path) -> None:
    head = say(run)
    with (run / ANNOTATIONS_FILE).open("ab") as file:
        file.write(b"{{{\n" * 3000)
    found = read_annotations(run)
    assert [number for number, _ in found.wrong] == list(range(2, 103))
    assert found.wrong[-1][1] == f"is wrong, and {3000 - 101} later lines with it"
    assert head in found.links
    assert found.head not in (head, manifest_sha256(run))
