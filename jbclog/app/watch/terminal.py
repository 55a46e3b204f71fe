"""The live view in the terminal (Textual): a tile for each port, the events below, a station in
detail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from textwrap import wrap
from typing import ClassVar, Final

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import ItemGrid, VerticalScroll
from textual.content import Content
from textual.css.query import NoMatches
from textual.events import Resize
from textual.screen import Screen
from textual.widgets import Footer, Static

from jbclog.app.watch import words
from jbclog.app.watch.batch_queue import BatchQueue
from jbclog.core.errors import JbclogError
from jbclog.core.outcome import Exit
from jbclog.core.rows import Severity
from jbclog.core.text import clean
from jbclog.live import PortState, RunState, StationState

EVERY_S: Final = 0.5
TILE: Final = 38  # columns
SHOWN_EVENTS: Final = 200
PLOT_LINES: Final = 8
LINES_OF_TILES: Final = 14  # including the lines above and below them
MOST_LINES, FEWEST_LINES = 9, 3  # lines of the events, with their title
READING: Final = "reading …"
NOT_READABLE: Final = "not readable"

Source = Callable[[], RunState | None]
Queues = Callable[[], Sequence[BatchQueue]]


class Tile(Static, can_focus=True):
    """A port. Enter opens its station."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1, True)", "choose", key_display="Tab ←↑↓→"),
        Binding("down", "move(1, True)", show=False),
        Binding("left", "move(-1)", show=False),
        Binding("right", "move(1)", show=False),
        Binding("enter", "open", "details"),
    ]

    def __init__(self, port: PortState) -> None:
        super().__init__()
        self.port = port

    def show(self, port: PortState) -> None:
        self.port = port
        # first: visible even on a tile that is cut off below, or has a long name
        self.border_title = Content(f"{str(port.condition).upper()} · {words.port_name(port)}")
        self.set_classes(str(port.condition).replace(" ", "-"))
        self.update(Content("\n".join(words.port_lines(port, max(self.size.width, 1)))))

    def on_resize(self) -> None:
        self.show(self.port)

    def action_move(self, step: int, by_line: bool = False) -> None:
        """Select the tile `step` places or lines ahead, or this one if there is none."""
        tiles = list(self.screen.query(Tile))
        a_line = sum(tile.region.y == tiles[0].region.y for tile in tiles)
        place = tiles.index(self) + step * (a_line if by_line else 1)
        if 0 <= place < len(tiles):
            tiles[place].focus()

    def action_open(self) -> None:
        self.app.push_screen(StationScreen(self.port.station))


class StationScreen(Screen[None]):
    """A station in detail: its ports with the last minute or hour, settings and counters."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "app.pop_screen", "back"),
        Binding("h", "span", "minute/hour"),
    ]

    def __init__(self, station: str) -> None:
        super().__init__()
        self.station = station
        self.shows_hour = False

    def action_span(self) -> None:
        """Toggle between the last hour and the last minute."""
        self.shows_hour = not self.shows_hour
        self.show()

    def compose(self) -> ComposeResult:
        yield Static(id="head")
        with VerticalScroll():
            yield Static(id="ports")
            yield Static(id="settings")
            yield Static(id="counters")
        yield Footer()

    def on_mount(self) -> None:
        self.show()

    def on_screen_resume(self) -> None:
        self.show()

    def show(self) -> None:
        """Show the station's current state."""
        run = self.app.run_state if isinstance(self.app, WatchApp) else None
        station = None if run is None else run.station(self.station)
        if run is None or station is None or not self.is_mounted:
            return
        self.query_one("#head", Static).update(
            Content(f"{words.run_line(run)}\n{_station_line(station)}")
        )
        width = max(self.size.width - 4, 10)
        self.query_one("#ports", Static).update(
            Content(
                "\n\n".join(
                    _port_text(port, width, shows_hour=self.shows_hour) for port in station.ports
                )
            )
        )
        self._show_table("#settings", words.columns(words.setting_rows(station)))
        self._show_table("#counters", words.columns(words.counter_rows(station)))

    def _show_table(self, place: str, lines: list[str]) -> None:
        table = self.query_one(place, Static)
        table.display = bool(lines)
        table.update(Content("\n".join(lines)))


class WatchApp(App[None]):
    """Shows the results of `source` and `queues`, twice a second."""

    TITLE = "jbclog watch"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head { height: auto; max-height: 9; padding: 0 1; text-style: bold; }
    #tiles { height: auto; grid-gutter: 0 1; }
    #queue { height: auto; text-wrap: nowrap; }
    #events { height: 9; }
    .too-low { display: none; }
    #queue, #events { border-top: solid $foreground; border-title-align: left; padding: 0 1; }
    Tile { height: auto; min-height: 7; border: round $foreground; padding: 0 1; }
    Tile:focus { border: heavy $foreground; }
    Tile.alarm, Tile.failed { border: double $error; color: $text-error; }
    Tile.stale, Tile.not-known { border: dashed $warning; color: $text-warning; }
    Tile.attention { border: round $warning; }
    Tile.normal { border: round $success; }
    #ports, #settings, #counters { height: auto; padding: 0 1; margin: 0 0 1 0; }
    #settings, #counters { text-wrap: nowrap; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "quit"),
        Binding("ctrl+c", "interrupt", show=False, priority=True),
        Binding("s", "severity", "severity"),
    ]

    def __init__(
        self,
        source: Source,
        every_s: float | None = EVERY_S,
        queues: Queues = tuple,
        no_run: str = words.NO_RUN,
    ) -> None:
        super().__init__()
        self.run_state: RunState | None = None
        self.severity = Severity.INFO
        self._source, self._queues, self._every_s = source, queues, every_s
        self._no_run = no_run

    def compose(self) -> ComposeResult:
        yield Static(READING, id="head")
        with VerticalScroll(can_focus=False):
            yield ItemGrid(id="tiles", min_column_width=TILE)
        yield Static(id="queue")
        yield Static(id="events")
        yield Footer()

    def on_mount(self) -> None:
        self._show_events()
        self.show_queues(())
        if self._every_s is not None:
            self._read_in_thread()
            self.set_interval(self._every_s, self._read_in_thread)

    def _read_in_thread(self) -> None:
        if all(worker.is_finished for worker in self.workers):  # a slow disk must not queue reads
            self.run_worker(self._read, thread=True)

    def _read(self) -> None:
        try:
            state, queues = self._source(), self._queues()
        except JbclogError as error:
            self.call_from_thread(self._show_trouble, str(error))
        else:
            self.call_from_thread(self._take, state, queues)

    def _take(self, state: RunState | None, queues: Sequence[BatchQueue]) -> None:
        with suppress(NoMatches):  # the app is ending: its parts are removed one by one
            self.show_queues(queues)
            if state is not None:
                self.show(state)
            elif self.run_state is None:
                self._show_head(self._no_run)

    def show(self, run: RunState) -> None:
        """Show a run."""
        self.run_state = run
        base = self.screen_stack[0]
        self._show_head(f"{words.run_line(run)}\n{words.status_line(run)}")
        self._show_tiles(base.query_one("#tiles", ItemGrid), run.ports)
        self._show_events()
        if isinstance(self.screen, StationScreen):
            self.screen.show()

    def show_queues(self, queues: Sequence[BatchQueue]) -> None:
        """Show the running batches."""
        box, lines = self.screen_stack[0].query_one("#queue", Static), words.queue_lines(queues)
        box.display = bool(lines)
        box.border_title = Content(lines[0] if lines else "")
        box.update(Content("\n".join(lines[1:])))

    def _show_tiles(self, grid: ItemGrid, ports: tuple[PortState, ...]) -> None:
        tiles = list(grid.query_children(Tile))
        for tile, port in zip(tiles, ports, strict=False):
            tile.show(port)
        for tile in tiles[len(ports) :]:
            tile.remove()
        new = [Tile(port) for port in ports[len(tiles) :]]
        if new:
            grid.mount_all(new)
            if not tiles:
                self.call_after_refresh(new[0].focus)

    def _show_events(self) -> None:
        events = self.screen_stack[0].query_one("#events", Static)
        events.border_title = Content(f"events from {self.severity} · times in {words.zone_text()}")
        known = () if self.run_state is None else self.run_state.events
        shown = [words.event_line(one) for one in known if words.at_least(self.severity, one)][
            -SHOWN_EVENTS:
        ]
        lines, width = max(events.size.height, 1), max(events.size.width, 20)
        # wrapped here and not by the box, so that the newest event is whole and older ones are cut
        broken = [line for one in shown[-lines:] for line in wrap(one, width)]
        events.update(Content("\n".join(broken[-lines:]) or "no event"))

    def _show_trouble(self, text: str) -> None:
        with suppress(NoMatches):  # as in `_take`
            self._show_head(clean(text))
            for tile in self.screen_stack[0].query(Tile):
                tile.show(words.not_known(tile.port, NOT_READABLE))

    def _show_head(self, text: str) -> None:
        self.screen_stack[0].query_one("#head", Static).update(Content(text))

    def on_resize(self, event: Resize) -> None:
        """Give the tiles their lines: on a low terminal, events and queue get fewer or none."""
        lines = event.size.height - LINES_OF_TILES
        for name in ("#events", "#queue"):
            box = self.screen_stack[0].query_one(name, Static)
            box.styles.max_height = max(min(lines, MOST_LINES), 1)
            box.set_class(lines < FEWEST_LINES, "too-low")

    def action_interrupt(self) -> None:
        """End as other commands do at SIGINT."""
        self.exit(return_code=Exit.INTERRUPTED)

    def action_severity(self) -> None:
        """Show events from the next severity on."""
        self.severity = words.SEVERITIES[
            (words.SEVERITIES.index(self.severity) + 1) % len(words.SEVERITIES)
        ]
        self._show_events()


def _station_line(station: StationState) -> str:
    rate = "rate unknown" if station.rate_hz is None else f"{station.rate_hz:g} Hz"
    facts = [
        station.name,
        station.family,
        station.model or "model unknown",
        rate,
        station.outcome,
        station.reason,
    ]
    return " · ".join(clean(text) for text in facts if text)


def _port_text(port: PortState, width: int, *, shows_hour: bool) -> str:
    lines = words.port_lines(port, width)
    lines[3:4] = (
        words.hour_plot(port, width, PLOT_LINES)
        if shows_hour
        else words.plot(port.trace, width, PLOT_LINES)
    )
    why = words.joints_why(port.joints)
    return "\n".join(
        [f"{words.port_name(port)}: {str(port.condition).upper()}", *lines, *([why] if why else [])]
    )
