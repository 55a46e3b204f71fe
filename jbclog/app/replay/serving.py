"""A recorded run served on ports as virtual stations, at its own pace or another, and how fast that can be.

Faster means that time itself goes faster: the line file for the run says so (`[replay]`), and the recorder's clock goes
as many times as fast as the stations'. Rates, patience, slow signals' periods and durations then stand to each other as
they did, and the tables come out the same. What does not get faster is this host.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import floor
from pathlib import Path
from statistics import median

from jbclog.app.replay.recording import Recording
from jbclog.config.line import StationSpec
from jbclog.core.errors import UsageError
from jbclog.sim.recorded_wire import Exchange, exchanges
from jbclog.sim.replayed_station import TapeStation
from jbclog.sim.serve import Server
from jbclog.sim.setup import Tcp, set_up

HANDING_S = 0.0003  # that bytes take from one program to another and back through a pseudo-terminal, beside the wire's time
SHORTEST_S = 0.0006  # the shortest time from question to answer that can be kept
MOST_HZ = 1500.0  # questions that two programs on one host hand over in a second with time to spare
LOOKED_AT = 2000  # exchanges of each tape, from its beginning


def serve(recording: Recording, folder: Path, tcp: Tcp | None = None, speed: float = 1.0) -> tuple[Server, list[TapeStation]]:
    """Make ports appear in `folder` (or on TCP) behind which the recorded stations answer as they did, `speed` times as fast.

    The line file in `folder` names the recipes that ran, the rates that came of it, and the speed. Raises `UsageError`
    where a link cannot be made or the speed cannot be kept.
    """
    expect_possible(recording, speed)
    specs = tuple(_served(recording, spec) for spec in recording.stations)
    stations = [station_of(recording, spec.name, speed, HANDING_S) for spec in specs]
    line = recording.line.model_copy(update={"stations": specs})
    return set_up(line, folder, tcp, stations=stations, replay=recording.replay.model_copy(update={"speed": speed})), stations


def station_of(recording: Recording, name: str, speed: float = 1.0, early_s: float = 0.0) -> TapeStation:
    """The recorded station of that name."""
    return TapeStation(name, partial(recording.exchanges, name), speed, early_s, recording.ticks(name))


def _served(recording: Recording, spec: StationSpec) -> StationSpec:
    """The station as its line file for the replay has it: as then, with the recipe that ran."""
    return spec.model_copy(update={"recipe": recording.recipe_path(spec.name)})


# -- how fast ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Limit:
    """A speed that cannot be passed, and why."""

    speed: float
    why: str


def expect_possible(recording: Recording, speed: float) -> None:
    """Raises `UsageError` where the tables could not come out the same at that speed; it says which could, and why."""
    if speed != 1.0 and not recording.is_paced:
        raise UsageError(
            f"--speed {speed:g}: this run was recorded with --rate max, so its rows are as many as the line could carry; "
            "it can be served at its own pace only"
        )
    limit = min(limits(recording), key=lambda one: one.speed, default=None)
    if limit is not None and speed > max(limit.speed, 1.0):
        raise UsageError(f"--speed {speed:g} cannot be kept, and other tables would come of it: {limit.why}")


def limits(recording: Recording) -> Iterator[Limit]:
    """What limits the speed: the shortest answers, and all questions together."""
    asked_hz = 0.0
    for spec in recording.stations:
        tape = list(islice(exchanges(recording.exchanges(spec.name)), LOOKED_AT))
        answered_s = [one.replies[0][0] for one in tape if one.replies]
        asked_hz += _hz(tape)
        if answered_s:
            yield _shortest(spec.name, median(answered_s))
    if asked_hz:
        yield _most(asked_hz)


def _hz(tape: list[Exchange]) -> float:
    """Questions a second."""
    span_s = tape[-1].at_s - tape[0].at_s if tape else 0.0
    return len(tape) / span_s if span_s > 0 else 0.0


def _shortest(name: str, answer_s: float) -> Limit:
    speed = _rounded(answer_s / SHORTEST_S)
    why = f"{name} answered after {answer_s * 1000:.1f} ms, and {SHORTEST_S * 1000:g} ms is the shortest that this host can keep"
    return Limit(speed, f"{why}. --speed {max(speed, 1.0):g} is possible")


def _most(asked_hz: float) -> Limit:
    speed = _rounded(MOST_HZ / asked_hz)
    why = f"the stations were asked {asked_hz:.0f} times a second, and {MOST_HZ:g} is what two programs can hand over on this host"
    return Limit(speed, f"{why}. --speed {max(speed, 1.0):g} is possible")


def _rounded(speed: float) -> float:
    """Down to a tenth."""
    return floor(speed * 10) / 10
