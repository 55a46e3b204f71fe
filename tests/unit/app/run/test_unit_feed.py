"""From lines to units: what begins one, what ends one, and when nobody knows whose joints
follow.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from jbclog.app.run.unit_feed import UnitFeed
from jbclog.cli.progress import EventFilter
from jbclog.core.rows import EventRow
from jbclog.transport.typed_lines import LineSource


@dataclass
class Desk:
    """A feed that a test types into; each look is a second after the one before."""

    writing: int
    events: list[EventRow] = field(default_factory=list)
    now: int = 0

    def micros(self) -> int:
        self.now += 1_000_000
        return self.now

    def told(self) -> list[tuple[str, str | None]]:
        return [(event.kind.removeprefix("unit."), event.raw) for event in self.events]


@dataclass
class Feeding:
    context: Desk
    feed: UnitFeed

    def types(self, *lines: bytes) -> list[tuple[str, str | None]]:
        """What is told when these lines have come, each before a look of its own."""
        before = len(self.context.events)
        for line in lines:
            os.write(self.context.writing, line)
            self.feed.look()
        return self.context.told()[before:]

    def hangs_up(self) -> None:
        os.close(self.context.writing)
        self.context.writing = -1


@pytest.fixture
def feeding() -> Iterator[Feeding]:
    reading, writing = os.pipe()
    context = Desk(writing)
    yield Feeding(
        context, UnitFeed(LineSource(reading, "stdin"), context.events.append, context.micros)
    )
    if context.writing >= 0:
        os.close(context.writing)


def test_a_serial_begins_its_unit_and_ends_the_one_before(feeding: Feeding) -> None:
    assert feeding.types(b"SN-1\n", b"SN-2\n") == [
        ("begin", "SN-1"),
        ("end", "SN-1"),
        ("begin", "SN-2"),
    ]
    end, begin = feeding.context.events[-2:]
    assert end.time == begin.time


def test_a_file_in_another_encoding_that_is_piped_in_is_named(feeding: Feeding) -> None:
    (told, *_) = feeding.types("SN-1\r\nSN-2\r\n".encode("utf-16-be"))
    assert told == ("begin", r"\x00S\x00N\x00-\x001\x00")
    assert feeding.context.events[0].text.endswith(
        "The source seems to send UTF-16; set it to UTF-8."
    )


def test_a_list_joined_from_files_of_windows_has_its_serials(feeding: Feeding) -> None:
    mark = b"\xef\xbb\xbf"
    assert feeding.types(mark + b"SN-1\r\n", mark + b"SN-2\r\n") == [
        ("begin", "SN-1"),
        ("end", "SN-1"),
        ("begin", "SN-2"),
    ]


def test_a_unit_begins_somewhere_between_two_looks(feeding: Feeding) -> None:
    feeding.types(b"SN-1\n")
    (event,) = feeding.context.events
    assert (event.earliest, event.time) == (1_000_000, 2_000_000)


def test_the_same_serial_again_changes_nothing_and_is_told_once(feeding: Feeding) -> None:
    assert feeding.types(b"SN-1\n", b"SN-1\nSN-1\n\n") == [("begin", "SN-1"), ("again", "SN-1")]
    assert feeding.context.events[-1].value == 2


def test_a_unit_that_comes_back_begins_again_and_that_is_told(feeding: Feeding) -> None:
    assert feeding.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")[2:] == [
        *(("begin", "SN-2"), ("end", "SN-2"), ("repeated", "SN-1"), ("begin", "SN-1"))
    ]
    event = feeding.context.events[-2]
    assert (
        event.text
        == "Serial SN-1 was read before, at 1970-01-01 00:00:02 UTC, and begins again; each serial"
        " counts once."
    )
    assert (event.severity, event.value) == ("warning", 2)
    assert EventFilter().passes(event)
    assert feeding.types(b"SN-2\nSN-1\n")[1] == ("repeated", "SN-2")
    assert [
        one.value
        for one in feeding.context.events
        if one.kind == "unit.repeated" and one.raw == "SN-1"
    ] == [2, 3]


def test_a_unit_that_an_unreadable_line_took_from_the_bench_continues_and_is_no_repeat(
    feeding: Feeding,
) -> None:
    assert feeding.types(b"SN-1\n", b"X" * 250 + b"\n", b"SN-1\n")[-1] == ("begin", "SN-1")
    assert "repeated" not in [kind for kind, _ in feeding.context.told()]
    assert feeding.context.events[-1].text == "Unit SN-1 continues."
    feeding.types(b"X" * 250 + b"\n", b"SN-2\n")
    assert feeding.types(b"SN-1\n")[1] == ("repeated", "SN-1")  # another one was read between them


def test_a_line_that_is_no_serial_ends_the_unit_for_nobody_knows_whose_joints_follow(
    feeding: Feeding,
) -> None:
    feeding.types(b"SN-1\n")
    assert feeding.types(b"X" * 250, b"\n") == [("refused", "X" * 200), ("end", "SN-1")]
    assert feeding.feed.unit is None


def test_what_does_not_show_is_a_warning_and_the_unit_begins(feeding: Feeding) -> None:
    assert feeding.types(b"A\x1dB\n") == [("begin", "A\\x1dB")]
    assert feeding.context.events[0].severity == "warning"


def test_a_pipe_that_was_closed_leaves_the_last_unit_and_says_so(feeding: Feeding) -> None:
    feeding.types(b"SN-1\nSN-2")
    feeding.hangs_up()
    feeding.feed.look()
    assert feeding.context.told()[-3:] == [("end", "SN-1"), ("begin", "SN-2"), ("closed", None)]
    assert "unit SN-2 lasts until the end of the run" in feeding.context.events[-1].text
    assert not feeding.feed.look()
    feeding.feed.finish()
    assert feeding.context.told()[-1] == ("end", "SN-2")


def test_a_reader_that_is_gone_leaves_no_unit() -> None:
    reading, writing = os.pipe()
    context = Desk(writing)
    feed = UnitFeed(
        LineSource(reading, "/dev/ttyACM0", ends=False), context.events.append, context.micros
    )
    Feeding(context, feed).types(b"SN-1\n")
    os.close(writing)
    feed.look()
    assert context.told()[-2:] == [("lost", None), ("end", "SN-1")]
    feed.finish()
    assert len(context.told()) == 3


def test_the_end_of_the_run_takes_in_what_has_come(feeding: Feeding) -> None:
    os.write(feeding.context.writing, b"SN-1\nSN-2\nSN")
    feeding.feed.finish()
    assert feeding.context.told()[-4:] == [
        ("end", "SN-1"),
        ("begin", "SN-2"),
        ("refused", "SN"),
        ("end", "SN-2"),
    ]
    assert "without a line end" in feeding.context.events[-2].text


# -- until so many are finished --------------------------------------------------------------------


@pytest.fixture
def until_two() -> Iterator[Feeding]:
    reading, writing = os.pipe()
    context = Desk(writing)
    yield Feeding(
        context,
        UnitFeed(LineSource(reading, "stdin"), context.events.append, context.micros, wanted=2),
    )
    if context.writing >= 0:
        os.close(context.writing)


def test_a_unit_ends_when_another_serial_comes_and_what_follows_the_last_is_no_unit(
    until_two: Feeding,
) -> None:
    assert until_two.types(b"SN-1\n", b"SN-1\n", b"SN-2\n")[-2:] == [
        ("end", "SN-1"),
        ("begin", "SN-2"),
    ]
    assert (until_two.feed.finished, until_two.feed.is_done) == ({"SN-1"}, False)
    assert until_two.types(b"SN-3\nSN-4\n") == [("end", "SN-2"), ("next", "SN-3"), ("next", "SN-4")]
    assert until_two.feed.is_done
    until_two.feed.finish()
    assert len(until_two.context.events) == 7
    assert until_two.feed.on_bench_at_end is None


def test_the_word_end_finishes_the_last_unit_begins_none_and_is_echoed(until_two: Feeding) -> None:
    assert until_two.types(b"END\n", b"SN-1\n", b"END\n", b"END\n") == [
        *(
            ("finish", None),
            ("begin", "SN-1"),
            ("end", "SN-1"),
            ("finish", "SN-1"),
            ("finish", None),
        )
    ]
    assert until_two.types(b"SN-2\n", b"END\n") == [
        ("begin", "SN-2"),
        ("end", "SN-2"),
        ("finish", "SN-2"),
    ]
    assert until_two.feed.is_done
    assert [event.text for event in until_two.context.events if event.kind == "unit.finish"] == [
        "END was read, and no unit is on the bench. Units finished: 0, wanted: 2.",
        "END was read: unit SN-1 is finished. Units finished: 1, wanted: 2.",
        "END was read, and no unit is on the bench. Units finished: 1, wanted: 2.",
        "END was read: unit SN-2 is finished. Units finished: 2, wanted: 2.",
    ]
    assert all(
        EventFilter().passes(event)
        for event in until_two.context.events
        if event.kind == "unit.finish"
    )


def test_the_word_end_says_where_it_finishes_nothing(until_two: Feeding) -> None:
    until_two.types(b"SN-1\nEND\n", b"SN-2\n", b"X" * 250 + b"\n", b"END\n")
    said = [event.text for event in until_two.context.events if event.kind == "unit.finish"]
    assert said == [
        f"END was read: unit SN-{n} ends and is not counted as finished. Units finished: 0,"
        " wanted: 2."
        for n in (1, 2)
    ]


def test_where_no_number_is_wanted_end_is_a_serial_like_any_other(feeding: Feeding) -> None:
    assert feeding.types(b"END\n") == [("begin", "END")]
    assert not feeding.feed.is_done


# -- where the recipe refuses repeats --------------------------------------------------------------


@pytest.fixture
def refusing() -> Iterator[Feeding]:
    reading, writing = os.pipe()
    context = Desk(writing)
    yield Feeding(
        context,
        UnitFeed(
            LineSource(reading, "stdin"),
            context.events.append,
            context.micros,
            wanted=3,
            refuses_repeats=True,
        ),
    )
    if context.writing >= 0:
        os.close(context.writing)


def test_a_refused_serial_begins_no_unit_and_what_follows_belongs_to_none(
    refusing: Feeding,
) -> None:
    assert refusing.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")[-2:] == [
        ("end", "SN-2"),
        ("repeated", "SN-1"),
    ]
    assert refusing.feed.unit is None
    event = refusing.context.events[-1]
    assert (event.severity, event.value) == ("error", 2)
    assert (
        event.text
        == "Serial SN-1 was read before, at 1970-01-01 00:00:02 UTC, and is refused, as the recipe"
        " says: what follows belongs to no unit until another serial is read; SN-2 read again"
        " continues that one."
    )
    assert refusing.feed.finished == {"SN-1"}
    assert refusing.types(b"SN-3\n") == [("begin", "SN-3")]
    assert refusing.feed.finished == {"SN-1", "SN-2"}  # it was put away, as the next serial shows


def test_the_unit_on_the_bench_continues_where_the_wrong_label_was_read(refusing: Feeding) -> None:
    refusing.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")
    assert refusing.types(b"SN-2\n") == [("begin", "SN-2")]
    assert refusing.context.events[-1].text == "Unit SN-2 continues."
    assert refusing.feed.finished == {"SN-1"}
    assert refusing.types(b"SN-1\n", b"END\n") == [
        ("end", "SN-2"),
        ("repeated", "SN-1"),
        ("finish", "SN-2"),
    ]
    assert refusing.feed.finished == {"SN-1", "SN-2"}
    assert refusing.types(b"SN-2\n") == [("repeated", "SN-2")]  # now it is one


def test_a_refused_serial_that_is_read_again_and_again_is_told_once(refusing: Feeding) -> None:
    refusing.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")
    assert refusing.types(b"SN-1\nSN-1\n") == [("again", "SN-1")]
    assert (
        refusing.context.events[-1].text
        == "Serial SN-1, which is refused, came again; nothing changes."
    )


def test_a_repeat_that_ends_the_last_unit_is_of_the_next_run(until_two: Feeding) -> None:
    assert until_two.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")[-1] == ("next", "SN-1")
    assert EventFilter().passes(until_two.context.events[-1])
    assert "repeated" not in [kind for kind, _ in until_two.context.told()]


def test_a_unit_that_comes_back_counts_once(until_two: Feeding) -> None:
    until_two.types(b"SN-1\n", b"SN-2\n", b"SN-1\n")
    assert until_two.feed.finished == {"SN-1", "SN-2"}


@pytest.mark.parametrize(
    "typed", [(b"SN-1\nSN-2\nSN-3\n",), (b"SN-1\n", b"X" * 250 + b"\n", b"Y" * 250 + b"\n")]
)
def test_a_list_pasted_at_once_or_a_line_that_is_no_serial_finishes_nothing(
    until_two: Feeding, typed: tuple[bytes, ...]
) -> None:
    until_two.types(*typed)
    assert until_two.feed.finished == set()


def test_the_unit_on_the_bench_when_the_run_ends_is_not_finished(until_two: Feeding) -> None:
    until_two.types(b"SN-1\n", b"SN-2\n")
    until_two.hangs_up()
    until_two.feed.look()
    assert until_two.context.events[-1].text.endswith(
        "The wanted number of units can no longer be reached."
    )
    until_two.feed.finish()
    assert (until_two.feed.finished, until_two.feed.on_bench_at_end) == ({"SN-1"}, "SN-2")
