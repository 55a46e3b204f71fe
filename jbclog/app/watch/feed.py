"""Messages to the page about a run: texts as in the terminal, and the points of each trace since
the last message.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from jbclog.app.watch import words
from jbclog.app.watch.batch_queue import BatchQueue
from jbclog.core.rows import PortKey
from jbclog.core.text import cleaned, json_line
from jbclog.live import PortState, RunState, StationState, Trace

SHOWN_EVENTS: Final = 200
SAME_S: Final = 1e-6

Json = dict[str, object]


class Feed:
    """Makes messages from states. `whole` is for a page that has nothing yet, `change` for pages
    that have the last message.
    """

    def __init__(self, no_run: str = words.NO_RUN) -> None:
        self._no_run = no_run  # shown without a run
        self._state: RunState | None = None
        self._queues: Sequence[BatchQueue] = ()
        self._sent: dict[PortKey, float] = {}  # `last_s` of each trace

    def whole(self) -> str:
        """Return the last state with all traces."""
        return "" if self._state is None else _message(self._state, self._queues, {}, is_whole=True)

    def change(self, state: RunState | None, queues: Sequence[BatchQueue] = ()) -> str:
        """Return a new state with the new points of its traces; None: there is no run."""
        self._queues = queues
        is_other = _run_of(self._state) is None or _run_of(self._state) != _run_of(state)
        sent = {} if is_other else self._sent
        self._state = state
        if state is None:
            nothing: Json = {
                "heading": self._no_run,
                "title": words.title(None),
                "whole": True,
                "ports": [],
                "stations": [],
                "events": [],
            }
            return json_line({**nothing, **_queue(queues)})
        self._sent = {(port.station, port.port): port.trace.last_s for port in state.ports}
        return _message(state, queues, sent, is_whole=is_other)

    def hour(self, key: str) -> str | None:
        """Return the last hour of a port as JSON; None: there is no such port."""
        ports = () if self._state is None else self._state.ports
        found = next((port.hour for port in ports if f"{port.station} {port.port}" == key), None)
        return None if found is None else json_line(_points(found, None))


def _run_of(state: RunState | None) -> tuple[Path, str | None] | None:
    """Return what tells a run from another; a folder may be replaced by that of another run."""
    return None if state is None else (state.folder, state.start)


def _message(
    state: RunState, queues: Sequence[BatchQueue], sent: dict[PortKey, float], *, is_whole: bool
) -> str:
    data: Json = {
        "run": state.folder.name,
        "heading": words.run_line(state),
        "title": words.title(state),
        "phase": str(state.phase),
        "status": words.status_line(state),
        "worst": str(words.worst(state) or "not known"),
        "zone": words.zone_text(),
        "whole": is_whole,
        "ports": [_port(port, sent.get((port.station, port.port))) for port in state.ports],
        "stations": [_station(station) for station in state.stations],
        "events": [
            {"seq": one.seq, "severity": str(one.event.severity), "text": words.event_line(one)}
            for one in state.events[-SHOWN_EVENTS:]
        ],
        **_queue(queues),
    }
    return json_line(cleaned(data))


def _port(port: PortState, sent_s: float | None) -> Json:
    return {
        "key": f"{port.station} {port.port}",
        "station": port.station,
        "name": words.port_name(port),
        "condition": str(port.condition),
        "now": words.reading_text(port.temperature, "°C"),
        "known": port.temperature.is_known,
        "setpoint": words.reading_text(port.setpoint, "°C"),
        "power": words.power_text(port.power),
        "status": words.status_text(port.status),
        "row": words.row_text(port),
        "joints": words.joints_text(port.joints),
        "counts": " · ".join(words.counts(port)),
        "joints_why": words.joints_why(port.joints),
        "coverage": words.coverage_text(port.coverage),
        "wrong": words.wrong(port),
        "trace": _points(port.trace, sent_s),
    }


def _points(trace: Trace, sent_s: float | None) -> Json:
    """Return the points after `sent_s`, or all of them if the trace has begun anew."""
    is_new = sent_s is None or trace.last_s < sent_s - SAME_S
    first = 0 if is_new or sent_s is None else _first_after(trace, sent_s)
    return {
        "whole": is_new,
        "seconds": [round(one, 3) for one in trace.seconds[first:]],
        "temperature": [
            None if one is None else round(one, 2) for one in trace.temperature_c[first:]
        ],
        "power": [
            None if one is None else round(one / 10, 1) for one in trace.power_permille[first:]
        ],
    }


def _first_after(trace: Trace, sent_s: float) -> int:
    return bisect_right(trace.seconds, sent_s + SAME_S)


def _queue(queues: Sequence[BatchQueue]) -> Json:
    return {
        "queue": [
            {"text": one.text, "jobs": [[job.name, job.state, job.text] for job in one.jobs]}
            for one in queues
        ]
    }


def _station(station: StationState) -> Json:
    return {
        "name": station.name,
        "settings": words.setting_rows(station),
        "counters": words.counter_rows(station),
    }
