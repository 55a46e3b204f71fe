"""Where a session's rows and events go, each with its station and time."""

from __future__ import annotations

from jbclog.core.clock import UtcOffset
from jbclog.core.rows import EventRow, Journal, Severity
from jbclog.protocol.client.interface import Client
from jbclog.protocol.commands.decisions import decisions


class SessionLog:
    """The notes of one session. A row has the time of the answer that it is about."""

    def __init__(self, name: str, station: Client, journal: Journal, utc: UtcOffset) -> None:
        self.name = name
        self.station = station
        self.journal = journal
        self.utc = utc
        self.answered_at: float | None = None  # while an answer is handed over: when it came

    @property
    def now(self) -> float:
        """Time of the last result, or of the answer being handed over, monotonic seconds."""
        return self.station.now if self.answered_at is None else self.answered_at

    def note(
        self,
        kind: str,
        severity: Severity,
        text: str,
        *,
        port: int | None = None,
        since: float | None = None,
        code: int | None = None,
        value: float | None = None,
        limit: float | None = None,
        raw: str | None = None,
        at_once: bool = False,
    ) -> None:
        """Record an event. `since`: the earliest time at which it can have happened."""
        time = self.utc.micros(self.now)
        earliest = None if since is None else self.utc.micros(since)
        event = EventRow(
            time, kind, severity, text, self.name, port, earliest, code, value, limit, raw
        )
        self.journal.event(event, at_once=at_once)

    def report_anomalies(self) -> None:
        """Record new anomalies of the station; each kind once."""
        for one in self.station.anomalies.take():
            decision = decisions()[one.number]
            severity = (
                Severity.WARNING if decision.doubtful and not decision.usual else Severity.INFO
            )
            text = f"{decision.met} First met: {one.place}."
            self.note(
                "protocol.anomaly", severity, text, port=one.port, code=one.number, raw=one.raw
            )
