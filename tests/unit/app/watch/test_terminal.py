"""The live view in the terminal, at several sizes, by its keys, with and without colour."""

from __future__ import annotations

import asyncio
import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from jbclog.app.watch.terminal import StationScreen, Tile, WatchApp
from jbclog.app.watch.words import NO_RUN
from jbclog.core.errors import RecordError
from jbclog.core.outcome import Exit
from jbclog.core.rows import EventRow, Severity
from jbclog.live import NumberedEvent, Phase, RunState
from jbclog.live.run_follower import CRASHED
from support.readers.screen import PICTURES, SIZES, in_utc, picture, text_of
from support.records import live_states

WAIT_S = 60.0
Steps = Callable[[WatchApp, Pilot[None]], Coroutine[Any, Any, None]]


@pytest.fixture(autouse=True)
def utc(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as changed:
        changed.setenv("TZ", "UTC")
        in_utc()
        yield
    time.tzset()


def play(
    steps: Steps,
    source: Callable[[], RunState | None] = lambda: None,
    *,
    every_s: float | None = None,
) -> None:
    async def inside() -> None:
        app = WatchApp(source, every_s)
        async with app.run_test(size=(120, 40)) as pilot:
            await steps(app, pilot)

    asyncio.run(inside())


async def shown(app: WatchApp, pilot: Pilot[None], run: RunState) -> str:
    app.show(run)
    await pilot.pause()
    await pilot.pause()
    return text_of(app)


@pytest.mark.parametrize("name", SIZES)
def test_it_looks_as_it_did(name: str) -> None:
    """After a change that is meant: ``python tests/support readers.screen``, and look at the
    difference.
    """
    assert asyncio.run(picture(name)) == (PICTURES / f"{name}.txt").read_text(encoding="utf-8")


def test_keys_open_a_station_and_choose_severities() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        text = await shown(app, pilot, live_states.run())
        assert "The run begins." in text
        await pilot.press("s")
        await pilot.pause()
        assert "The run begins." not in text_of(app)
        assert "No answer since 12 s." in text_of(app)
        await pilot.press("s", "s")
        await pilot.pause()
        assert "No answer since 12 s." not in text_of(app)
        await pilot.press("tab", "tab", "enter")
        await pilot.pause()
        assert isinstance(app.screen, StationScreen)
        assert app.screen.station == "ucr-1"
        await pilot.press("escape")
        await pilot.pause()
        assert not isinstance(app.screen, StationScreen)
        await pilot.press("q")

    play(steps)


def test_a_station_in_detail_shows_the_hour() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        await pilot.press("enter")
        await pilot.pause()
        assert "-60 s" in text_of(app)
        await pilot.press("h")
        await pilot.pause()
        assert "-60 min" in text_of(app)
        assert "too short yet for an hour's plot" in text_of(app)  # of port 2

    play(steps)


def test_a_station_in_detail_follows_the_run() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        await pilot.press("enter")
        await pilot.pause()
        crashed = replace(live_states.run(), phase=Phase.CRASHED)
        assert "CRASHED" in await shown(app, pilot, crashed)
        assert isinstance(app.screen, StationScreen)

    play(steps)


def test_ports_come_and_go() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        run = live_states.run()
        for stations in (run.stations, run.stations[:1], (), run.stations):
            await shown(app, pilot, replace(run, stations=stations))
            assert len(app.query(Tile)) == 2 * len(stations)

    play(steps)


def test_the_queue_of_a_batch() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        assert not app.query_one("#queue").display
        app.show_queues((live_states.QUEUE,))
        text = await shown(app, pilot, live_states.run())
        assert "batch night: 1 of 3 jobs have ended" in text
        assert "smd-2  running  recording, 42 s of 90 s" in text

    play(steps)


def test_a_terminal_that_is_resized() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        for width in (60, 200, 40, 120):
            await pilot.resize_terminal(width, 30)
            await pilot.pause()
            assert max(map(len, text_of(app).splitlines())) <= width
            assert "dde-1 port 1" in text_of(app)

    play(steps)


def test_no_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        svg = app.export_screenshot()
        colours = {svg[at + 1 : at + 7] for at in range(len(svg)) if svg[at - 1 : at + 1] == '"#'}
        assert colours
        assert [
            one
            for one in colours
            if one not in WINDOW and max(channels(one)) - min(channels(one)) > GREY
        ] == []

    play(steps)


def channels(colour: str) -> tuple[int, int, int]:
    return int(colour[:2], 16), int(colour[2:4], 16), int(colour[4:], 16)


GREY = 4
# buttons that the picture draws around the terminal
WINDOW = ("ff5f57", "febc2e", "28c840", "0178d4")


def test_what_was_read_while_the_app_ends_is_not_shown() -> None:
    """Its parts are removed one by one, and a thread may still bring something."""

    async def steps(app: WatchApp, _pilot: Pilot[None]) -> None:
        await app.query_one("#queue").remove()
        app._take(live_states.run(), ())

    play(steps)


def test_it_reads_in_a_thread_and_again_after_trouble() -> None:
    answer: RunState | Exception | None = None

    def source() -> RunState | None:
        if isinstance(answer, Exception):
            raise answer
        return answer

    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        nonlocal answer
        # each until it is seen: a busy app draws seldom
        for given, text in (
            (None, NO_RUN),
            (RecordError("the disk is away"), "the disk is away"),
            (live_states.run(), "dde-1 port 1"),
        ):
            answer = given
            end = time.monotonic() + WAIT_S
            while text not in text_of(app):
                assert time.monotonic() < end, text
                await pilot.pause(0.05)

    play(steps, source, every_s=0.1)


def test_while_the_record_cannot_be_read_nothing_is_known() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        assert "NORMAL" in await shown(app, pilot, live_states.run())
        app._show_trouble("the disk is away")
        await pilot.pause()
        assert {str(tile.border_title)[:6] for tile in app.query(Tile)} == {"STALE "}
        assert "now unknown (not readable; last" in text_of(app)
        assert "NORMAL" in await shown(app, pilot, live_states.run())

    play(steps)


def test_the_newest_event_is_seen_whole_however_long_those_before_it_are() -> None:
    long = EventRow(1, "host.busy", Severity.WARNING, "The recorder was too late. " * 12)
    newest = EventRow(2, "alarm.high", Severity.ERROR, "The tool is too hot. " * 8 + "Look at it.")
    events = tuple(NumberedEvent(seq, one) for seq, one in enumerate([*[long] * 20, newest]))

    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        seen = await shown(app, pilot, replace(live_states.run(), events=events))
        assert "Look at it." in seen
        assert " ".join(seen.split()).count("The tool is too hot.") == 8

    play(steps)


def test_what_to_do_about_hot_tools_is_never_cut_off() -> None:
    """The longest line at the top, at 60 columns."""
    hot = replace(
        live_states.run(phase=Phase.CRASHED),
        product="demo board",
        text=CRASHED,
        problems=(f"{'Tools of ale-1, dde-1, dde-2, ucr-1 may still be hot. ' * 2}Look at them.",),
    )

    async def inside() -> None:
        app = WatchApp(lambda: None, None)
        async with app.run_test(size=(60, 30)) as pilot:
            assert "Look at them." in await shown(app, pilot, hot)

    asyncio.run(inside())


def test_arrows_and_tab_choose_a_tile_and_the_footer_says_so() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        assert "Tab ←↑↓→ choose" in await shown(app, pilot, live_states.run())
        tiles = list(app.query(Tile))
        a_line = sum(tile.region.y == tiles[0].region.y for tile in tiles)
        assert 1 < a_line < len(tiles)
        for key, place in (
            ("right", 1),
            ("left", 0),
            ("left", 0),
            ("down", a_line),
            ("up", 0),
            ("tab", 1),
        ):
            await pilot.press(key)
            assert app.focused is tiles[place]

    play(steps)


def test_ctrl_c_ends_it_as_it_ends_other_commands() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        await pilot.press("enter", "ctrl+c")
        await pilot.pause()
        assert app.return_code == Exit.INTERRUPTED

    play(steps)


def test_no_run_is_said_only_when_it_is_known() -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        assert NO_RUN not in text_of(app)
        app._take(None, ())
        await pilot.pause()
        assert NO_RUN in text_of(app)
        await shown(app, pilot, live_states.run())
        app._take(None, ())
        await pilot.pause()
        assert NO_RUN not in text_of(app)

    play(steps)


@pytest.mark.parametrize(
    ("size", "has_events"),
    [((80, 10), False), ((40, 15), False), ((80, 17), True), ((80, 24), True)],
)
def test_on_a_low_terminal_tiles_come_before_events(
    size: tuple[int, int], has_events: bool
) -> None:
    async def steps(app: WatchApp, pilot: Pilot[None]) -> None:
        await shown(app, pilot, live_states.run())
        app.show_queues((live_states.QUEUE,) if size[1] < 17 else ())
        await pilot.resize_terminal(*size)
        await pilot.pause()
        text = text_of(app)
        assert ("events from" in text) is has_events
        assert "dde-1 port 1" in text
        assert "row 0." in text  # the fifth line of a tile

    play(steps)


@pytest.mark.parametrize(("key", "code"), [(b"q", 0), (b"\x03", Exit.INTERRUPTED)])
def test_the_exit_code_of_the_command(tmp_path: Path, key: bytes, code: int) -> None:
    command = [sys.executable, "-c", "from jbclog.cli import main; main()", "watch", str(tmp_path)]
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
    ) as process:
        os.close(theirs)
        shown = b""
        while b"no run" not in shown:
            shown += os.read(ours, 1 << 16)
        os.write(ours, key)
        with suppress(OSError):  # its end
            while os.read(ours, 1 << 16):
                pass
        assert process.wait(WAIT_S) == code
    os.close(ours)
