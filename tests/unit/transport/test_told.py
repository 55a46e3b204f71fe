"""What a session was told is kept, and told again to the bit; where it wishes something else, it
ends.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest

from jbclog.core.capture_rows import CaptureRow, LinkRow, ResultRow
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import (
    Ask,
    IoResult,
    Listen,
    Reopen,
    Request,
    RunEnded,
    Steps,
    Wait,
    ask,
    listen,
    reopen,
    wait,
)
from jbclog.transport.session_history import (
    Divergence,
    ReplayStep,
    captured,
    replay_steps,
    replayed,
)

Story = list[object]


async def session(story: Story) -> str:
    """Opens, waits, asks, listens; keeps what it is told, and ends with the first thing that is
    thrown into it twice.
    """
    story.append(await wait(1.0))
    story.append(await reopen())
    try:
        story.append(await ask(b"first", 0.5))
        story.append(await listen(9.0))
        story.append(await ask(b"second", 0.5))
    except (LinkError, RunEnded) as error:
        story.append(str(error))
        story.append(await wait(8.0))
    return "the end"


Answer = IoResult | Exception


def pulled(steps: Steps[object], answers: list[Answer]) -> tuple[list[Request], object]:
    """Give these answers, one after the other; the wishes, and what came of the session."""
    wishes = [steps.send(None)]
    for answer in answers:
        try:
            wishes.append(
                steps.throw(answer) if isinstance(answer, Exception) else steps.send(answer)
            )
        except StopIteration as end:
            return wishes, end.value
    return wishes, None


GOOD: list[Answer] = [
    IoResult(1.00002, b"", 0.0),
    IoResult(1.5, b"", 0.0),
    IoResult(2.1, b"ab", 2.0),
    IoResult(2.2, b"c", 2.0),
    IoResult(3.75, b"", 3.0),
]
BYTES: dict[int, list[CaptureRow]] = {
    2: [LinkRow(2.0, "sent", b"first"), LinkRow(2.1, "heard", b"ab"), LinkRow(2.15, "heard", b"c")],
    4: [LinkRow(3.0, "sent", b"second")],
}


def recording(answers: list[Answer]) -> tuple[list[CaptureRow], Story]:
    """The tape of a session that was answered so, and what it was told."""
    tape, story = list[CaptureRow](), list[object]()
    steps = captured(session(story), tape.append, lambda: 7.0)
    steps.send(None)
    for place, answer in enumerate(answers):
        tape.extend(BYTES.get(place, []))
        with suppress(StopIteration):
            _ = steps.throw(answer) if isinstance(answer, Exception) else steps.send(answer)
    return tape, story


def lived_again(
    tape: list[CaptureRow],
    made: Callable[[Story], Steps[str]] = session,
    answers: list[Answer] | None = None,
) -> tuple[Story, list[Request], object, list[Divergence]]:
    story, left = list[object](), list[Divergence]()

    steps = replayed(made(story), replay_steps(tape), left.append)
    wishes, ended = pulled(
        steps, [IoResult(0.0, b"the driver's", 0.0)] * 20 if answers is None else answers
    )
    return story, wishes, ended, left


@pytest.mark.parametrize(
    "answers",
    [
        GOOD,
        [*GOOD[:3], LinkError("gone"), IoResult(8.0, b"", 2.0)],
        [*GOOD[:2], LinkError("gone at once"), IoResult(8.0, b"", 2.0)],
        [*GOOD[:4], RunEnded("Ctrl-C"), IoResult(8.0, b"x", 3.0)],
    ],
    ids=["good", "broken", "broken at once", "ended"],
)
def test_the_second_life_is_told_the_same(answers: list[Answer]) -> None:
    if answers[-1] == IoResult(8.0, b"x", 3.0):
        BYTES[5] = [LinkRow(5.0, "heard", b"x")]
    tape, story = recording(answers)
    BYTES.pop(5, None)
    again, wishes, ended, left = lived_again(tape)
    assert again == story
    assert (ended, left) == ("the end", [])
    # the driver only hears of waits
    assert all(isinstance(io_request, Wait) for io_request in wishes)
    moments = [io_request.until for io_request in wishes if isinstance(io_request, Wait)]
    assert moments == [
        row.at_s for row in tape if isinstance(row, ResultRow) and row.what != "done"
    ]


def test_what_is_kept() -> None:
    tape, _ = recording(GOOD)
    assert [row for row in tape if isinstance(row, ResultRow)] == [
        ResultRow(1.00002, "told", "wait", 0, 0.0),
        ResultRow(1.5, "told", "reopen", 0, 0.0),
        ResultRow(2.1, "told", "ask", 2, 2.0),
        ResultRow(2.2, "told", "listen", 1, 2.0),
        ResultRow(3.75, "told", "ask", 0, 3.0),
        ResultRow(7.0, "done", "wait"),
    ]


def test_a_session_that_breaks_is_not_held() -> None:
    async def broken() -> None:
        await wait(0.0)
        raise ZeroDivisionError

    for wrapped in (
        captured(broken(), print, lambda: 0.0),
        replayed(broken(), replay_steps(recording(GOOD)[0]), print),
    ):
        wrapped.send(None)
        with pytest.raises(ZeroDivisionError):
            wrapped.send(IoResult(0.0, b"", 0.0))


def test_bytes_are_told_to_the_wish_that_took_them_and_those_of_a_closed_port_to_none() -> None:
    rows: list[CaptureRow] = [
        LinkRow(1.0, "heard", b"left over"),
        LinkRow(2.0, "opened"),
        LinkRow(3.0, "sent", b"q"),
        LinkRow(3.1, "heard", b"abc"),
        ResultRow(3.2, "told", "ask", 1, 3.0),
        ResultRow(3.3, "told", "listen", 2, 3.0),
    ]
    steps = list(replay_steps(rows))
    assert [(step.asked, step.data) for step in steps] == [(b"q", b"a"), (b"", b"bc")]


# -- another program -------------------------------------------------------------------------------


async def another(story: Story) -> str:
    story.append(await wait(1.0))
    story.append(await reopen())
    story.append(await ask(b"something else", 0.5))
    story.append(await wait(99.0))
    return "another end"


def test_a_session_that_wishes_something_else_ends_there() -> None:
    tape, story = recording(GOOD)
    again, wishes, ended, (left,) = lived_again(tape, another)
    assert again == story[:2]
    assert wishes == [Wait(1.00002), Wait(1.5)]
    assert ended is None
    assert (left.at_s, left.is_cut_off) == (1.5, False)
    assert str(left) == "it would ask b'something else'; recorded is ask b'first'"


def test_a_tape_without_its_end() -> None:
    tape, story = recording(GOOD)
    again, _, ended, (left,) = lived_again(tape[:-2])
    assert (again, ended, left.is_cut_off) == (story[:-1], None, True)
    assert str(left) == "it would ask b'second'; recorded is nothing more"


@pytest.mark.parametrize(
    ("io_request", "step", "fits"),
    [
        (Wait(2.0), ResultRow(2.0, "told", "wait"), True),
        (Wait(2.0), ResultRow(2.5, "told", "wait"), True),  # the host was late
        (Wait(2.0), ResultRow(1.9, "told", "wait"), False),
        (Listen(2.0), ResultRow(1.9, "told", "listen"), False),
        (Ask(b"q", 0.5), ResultRow(2.5, "told", "ask", 0, 2.0), True),
        (Ask(b"q", 0.5), ResultRow(2.3, "told", "ask", 0, 2.0), False),  # it would wait longer now
        (Ask(b"r", 0.5), ResultRow(2.5, "told", "ask", 0, 2.0), False),
        (Ask(b"r", 0.5), ResultRow(2.5, "broke", "ask"), False),
        (Wait(2.0), ResultRow(2.5, "told", "listen"), False),
        (Reopen(), ResultRow(2.5, "broke", "reopen"), True),
        (Wait(2.0), ResultRow(2.5, "done", "wait"), False),
    ],
)
def test_which_steps_answer_a_wish(io_request: Request, step: ResultRow, fits: bool) -> None:
    asked = b"q" if step.request == "ask" else b""
    assert ReplayStep(step, asked, b"").answers(io_request) is fits


def test_a_question_that_could_not_even_be_sent() -> None:
    assert ReplayStep(ResultRow(2.5, "broke", "ask"), b"", b"").answers(Ask(b"any", 0.5))
    assert not ReplayStep(ResultRow(2.5, "told", "ask"), b"", b"").answers(Ask(b"any", 0.5))
