"""A whole run of one or more virtual stations on a virtual clock, recorded into memory."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from weakref import finalize

from support.product import (
    COLUMN,
    FAMILIES,
    CounterRow,
    EventRow,
    Peer,
    Recipe,
    SampleRow,
    Session,
    SettingRow,
    StationFacts,
    StationSpec,
    StationTask,
    Steps,
    VirtualClock,
    VirtualDriver,
    VirtualOmega,
    VirtualStation,
    parse_line,
    parse_recipe,
    virtual_station,
)

RECIPE = """
[recipe]
name = "test"
revision = 1
families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]

[temperature]
select_c = 350

[sleep]
delay_min = 5

[hibernation]
delay_min = 30

[alarm.high]
limit_c = 380
delay_s = 0.5

[alarm.low]
limit_c = 250
delay_s = 2.0

[run]
status = "working"
"""

LINE = """
[line]
name = "test"

[[station]]
name = "dde-1"
url = "dde-1"
family = "dde"
{keys}
[station.sim]
turnaround_ms = 1.0
{sim}
"""


@dataclass
class Memory:
    """A journal that keeps everything in lists."""

    samples: list[SampleRow] = field(default_factory=list)
    events: list[EventRow] = field(default_factory=list)
    settings: list[SettingRow] = field(default_factory=list)
    counters: list[CounterRow] = field(default_factory=list)
    stations: dict[str, StationFacts] = field(default_factory=dict)
    urgent: list[EventRow] = field(default_factory=list)  # those that were to be kept at once

    def sample(self, row: SampleRow) -> None:
        self.samples.append(row)

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        self.events.append(event)
        if at_once:
            self.urgent.append(event)

    def setting(self, setting: SettingRow) -> None:
        self.settings.append(setting)

    def counter(self, counter: CounterRow) -> None:
        self.counters.append(counter)

    def facts(self, facts: StationFacts) -> None:
        self.stations[facts.name] = facts

    def column(self, name: str, port: int = 1) -> list[object]:
        return [row[COLUMN[name]] for row in self.samples if row[COLUMN["port"]] == port]

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]

    def of_kind(self, kind: str) -> list[EventRow]:
        return [event for event in self.events if event.kind == kind]


@dataclass(frozen=True)
class Heard:
    """A question as it reached the station: when it was sent, its text, and its answer without and
    with what faults did.
    """

    at: float
    text: str
    clean: str | None
    sent: str | None

    @property
    def is_write(self) -> bool:
        return self.text.startswith("W")


class Tap:
    """The cable to a virtual station, with a note of every question."""

    def __init__(self, station: VirtualStation | VirtualOmega) -> None:
        self._station = station
        self.heard: list[Heard] = []

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        struck = len(self._station.log.struck)
        replies = self._station.receive(data, now)
        after = self._station.log.struck[struck:]
        sent = replies[0].data if replies else None
        clean = after[-1].clean if after else sent
        self.heard.append(Heard(now, _text(data), clean and _text(clean), sent and _text(sent)))
        return replies

    def is_unplugged(self, now: float) -> bool:
        return self._station.is_unplugged(now)


def _text(frame: bytes) -> str:
    """Header, code and data; of a frame with addresses they are left out."""
    # OMEGA's sum has two characters
    body = frame[1:-2].decode("ascii", "replace").removesuffix("\x03")
    return body[4:] if body[:1].isdigit() else body


def is_cold_in_extractor(station: VirtualStation | VirtualOmega, port: int) -> bool:
    """Whether the tool lies as a station delivers it, and was not heated."""
    assert isinstance(station, VirtualStation)
    found = station.plant.ports[port]
    return found.doing.extractor and found.tip.temperature_c < 40


@dataclass
class VirtualRun:
    """What a run left behind: the journal, the stations' own view, and the facts."""

    memory: Memory
    stations: dict[str, VirtualStation | VirtualOmega]
    driver: VirtualDriver
    contexts: dict[str, Session]
    taps: dict[str, Tap] = field(default_factory=dict)
    t0: float = 0.0  # the run's zero on the monotonic clock

    @property
    def heard(self) -> list[Heard]:
        """Every question that reached the (first) station, whatever became of it."""
        return next(iter(self.taps.values())).heard

    @property
    def writes(self) -> list[Heard]:
        return [one for one in self.heard if one.is_write]

    def utc_s(self, moment: float) -> float:
        """UTC seconds of a moment on the virtual clock, as it began."""
        return moment + VirtualClock().utc() - VirtualClock().monotonic()

    def at(self, second: float, call: Callable[[], None]) -> None:
        """Do `call` that many seconds after the beginning."""
        self.driver.at(self.driver.clock.monotonic() + second, call)

    @property
    def station(self) -> VirtualStation:
        station = next(iter(self.stations.values()))
        assert isinstance(station, VirtualStation)
        return station

    @property
    def omega(self) -> VirtualOmega:
        station = next(iter(self.stations.values()))
        assert isinstance(station, VirtualOmega)
        return station

    @property
    def facts(self) -> StationFacts:
        return next(iter(self.contexts.values())).facts

    def go(self) -> VirtualRun:
        self.driver.run()
        return self


def line_text(sim: str = "", keys: str = "") -> str:
    return LINE.format(sim=sim, keys=keys)


Pulled = Callable[[StationTask, Steps[StationFacts], Peer], tuple[Steps[StationFacts], Peer]]


def prepare(
    line: str | None = None,
    recipe: str = RECIPE,
    duration_s: float | None = 10.0,
    rate: float | str | None = None,
    *,
    allow_omega_write: bool = False,
    allow_missing: bool = False,
    pulled: Pulled = lambda _order, session, cable: (session, cable),
) -> VirtualRun:
    """A run that is ready to go: `prepare(line_text(sim=...)).go()`. `pulled` may put itself around
    session and cable.
    """
    clock = VirtualClock()
    memory, driver = Memory(), VirtualDriver(clock, allow_missing=allow_missing)
    stations, contexts, taps, t0 = {}, {}, {}, clock.monotonic()
    loaded, sessions = parse_recipe(recipe), list[Steps[StationFacts]]()
    for spec in parse_line(line or line_text(), Path("line.toml")).stations:
        station = virtual_station(spec, now=clock.monotonic())
        order = order_for(
            spec, loaded, clock, duration_s, rate, allow_omega_write=allow_omega_write
        )
        order = replace(order, may_be_missing=allow_missing)
        context = Session(order, memory, clock)
        taps[spec.name] = Tap(station)
        session = context.steps()
        around, cable = pulled(order, session, taps[spec.name])
        driver.add(around, cable, spec.name)
        sessions += [session, around]
        stations[spec.name], contexts[spec.name] = station, context
    run = VirtualRun(memory, stations, driver, contexts, taps, t0)
    finalize(run, _close_unbegun, sessions)
    return run


def _close_unbegun(sessions: Iterable[Steps[StationFacts]]) -> None:
    """Close the sessions of a run that nobody let go; a coroutine that is never awaited warns."""
    for session in sessions:
        if inspect.getcoroutinestate(session) == inspect.CORO_CREATED:
            session.close()


def order_for(
    spec: StationSpec,
    recipe: Recipe,
    clock: VirtualClock,
    duration_s: float | None,
    rate: float | str | None,
    *,
    allow_omega_write: bool = False,
) -> StationTask:
    return StationTask(
        name=spec.name,
        url=spec.url,
        family=None if spec.family == "auto" else FAMILIES[spec.family],
        line=spec.line_format,
        address=spec.address,
        ports=spec.ports,
        recipe=recipe,
        recipe_file="recipe.toml",
        families=FAMILIES,
        t0=clock.monotonic(),
        duration_s=duration_s,
        rate=rate,
        rated_power_w=spec.rated_power_w,
        model=spec.model,
        allow_omega_write=allow_omega_write,
    )
