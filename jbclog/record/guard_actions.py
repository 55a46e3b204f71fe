"""Turns a guard's action log (`guard.jsonl`) into events, and its results into the stations' facts.

`recover` appends the events behind the recorder's last one; a second time changes nothing.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.line_file import LineFile
from jbclog.core.locks import try_lock
from jbclog.core.rows import SCHEMA_VERSION, EventRow, Severity, StationFacts
from jbclog.core.states import SafetyResult

if TYPE_CHECKING:
    import pyarrow as pa

    from jbclog.record.manifest import ClockStep

# what reads and writes sealed rows is loaded where that is done: a recorder does neither

ACTION_LOG: Final = "guard.jsonl"
LOCK: Final = "guard.lock"
LEASE: Final = "lease.json"
LOST: Final = "guard.lost"
BLANK: Final = b"\n"  # reserved space
RETRY_S: Final = 0.05
ROWS_AT_ONCE: Final = 8192
SAFE: Final = "safety.safe_state"
NOT_SAFE: Final = "safety.not_safe"
REACHED: Final[dict[str, SafetyResult]] = {
    SAFE: SafetyResult.VERIFIED,
    NOT_SAFE: SafetyResult.FAILED,
}


@contextmanager
def without_guard(folder: Path, patience_s: float) -> Iterator[None]:
    """Wait until no guard works on a run, and lock guards out: the record needs all their actions.
    Raises RecordError.
    """
    end = time.monotonic() + patience_s
    while (descriptor := try_lock(folder / LOCK)) is None:
        if time.monotonic() >= end:
            raise RecordError(
                f"{folder}: its guard is at work; nothing was changed. Try again when it has ended"
            )
        time.sleep(RETRY_S)
    try:
        yield
        (folder / LOCK).unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def await_guard(folder: Path, patience_s: float) -> None:
    """Wait until no guard works on a run. Raises RecordError."""
    if (folder / LOCK).exists():
        with without_guard(folder, patience_s):
            pass


def was_lost(folder: Path) -> bool:
    """Whether a run was without its guard for a time, by its sealed events."""
    from jbclog.record.parts import row_groups

    return any(
        LOST in group["kind"].to_pylist() for group in row_groups(folder, "events", ["kind"])
    )


def tidy(folder: Path) -> None:
    """Release unused space of the action log; remove an empty one. Raises OSError."""
    with suppress(FileNotFoundError):
        LineFile(folder / ACTION_LOG, Kind.ACTION_LOG).release()


def action_log(folder: Path) -> list[EventRow]:
    """Return the readable lines of the guard's action log as events, by the host's clock."""
    try:
        lines = (
            read_regular(folder / ACTION_LOG, Kind.ACTION_LOG)
            .rstrip(BLANK)
            .decode(errors="replace")
            .splitlines()
        )
    except FileNotFoundError:
        return []
    return [event for line in lines if (event := _event(line)) is not None]


def on_run_clock(
    events: Iterable[EventRow], steps: Sequence[ClockStep] | None
) -> Iterator[EventRow]:
    """Yield the guard's events with times by the run's clock, which its host's `steps` give."""
    from jbclog.record.clock_steps import HostClock

    host = HostClock(steps or ())
    for event in events:
        yield event._replace(time=host.run_time(event.time))


@dataclass(slots=True)
class _Action:
    """A line of the action log."""

    time: int
    kind: str
    severity: Severity
    text: str
    station: str | None
    port: int | None
    value: float | None = None  # orders without an answer

    def event(self) -> EventRow:
        return EventRow(
            self.time,
            self.kind,
            self.severity,
            self.text,
            self.station,
            self.port,
            value=self.value,
        )


_build_action: Final = builder(_Action)


def _event(line: str) -> EventRow | None:
    """Parse a line; None for one that is torn or changed."""
    try:
        return _build_action(json_of(line)).event()
    except ValueError:
        return None


def take_in(folder: Path, run: str, events: list[EventRow]) -> None:
    """Append the guard's events that the sealed ones of a run lack, in a part of their own. Seal
    those of the journal before.
    """
    if not events:
        return
    from jbclog.record.chains import Chain
    from jbclog.record.part_chain import PartChain
    from jbclog.record.part_writer import write_part
    from jbclog.record.parts import row_groups
    from jbclog.record.row_batches import BARE, decode, encode

    wanted, known, last = (
        {(event.time, event.text) for event in events},
        set[tuple[int, str]](),
        None,
    )
    for group in row_groups(folder, "events"):
        for last in event_dicts(group):
            known |= {(last["time"], last["text"])} & wanted
    missing = [event for event in events if (event.time, event.text) not in known]
    if missing:
        chain = Chain.after(last, SCHEMA_VERSION) if last is not None else Chain(run)
        values: list[object] = []
        for event in missing:
            chain.link(event, values)
        rows = decode(encode("events", values, 0), BARE["events"], run)
        parts = PartChain(folder)
        number = 1 + max((part.segment for part in parts.parts), default=0)
        parts.add(number, write_part(folder, "events", rows, number))


def event_dicts(events: pa.Table) -> Iterator[Any]:
    """Yield events as they are hashed: some at a time, as one takes a kilobyte and more."""
    for batch in plain_events(events).to_batches(max_chunksize=ROWS_AT_ONCE):
        yield from batch.to_pylist()


def plain_events(events: pa.Table) -> pa.Table:
    """Return events with times as whole microseconds, as they are hashed."""
    import pyarrow as pa

    for name in ("time", "earliest"):
        place = events.schema.get_field_index(name)
        events = events.set_column(place, name, events[name].cast(pa.int64()))
    return events


def with_guard(
    folder: Path, stations: list[StationFacts], counts_from: Mapping[tuple[str, int], int]
) -> list[StationFacts]:
    """Return the facts updated by the guard's results; of several about a tool, the last.

    A safe state that was logged before `counts_from` (UTC in µs, by station and port) is out of
    date.
    """
    reached: dict[str, dict[int, EventRow]] = {}
    for event in action_log(folder):
        if event.kind in REACHED and event.station is not None and event.port is not None:
            reached.setdefault(event.station, {})[event.port] = event
    for (station, port), since in counts_from.items():
        said = reached.get(station, {}).get(port)
        if said is not None and said.kind == SAFE and said.time < since:
            del reached[station][port]
    return [_updated(station, reached.get(station.name, {})) for station in stations]


def _updated(facts: StationFacts, reached: Mapping[int, EventRow]) -> StationFacts:
    states = {port: _reached(event) for port, event in reached.items()}
    unsafe = [
        f"{facts.name} port {port}: {event.text}"
        for port, event in reached.items()
        if _reached(event) != SafetyResult.VERIFIED
    ]
    return replace(facts, safe_state=facts.safe_state | states, unsafe=[*facts.unsafe, *unsafe])


def _reached(event: EventRow) -> SafetyResult:
    """Return what an action made of a tool. An order without an answer has the number of orders as
    its value.
    """
    reached = REACHED[event.kind]
    return SafetyResult.SENT if reached == SafetyResult.FAILED and event.value else reached
