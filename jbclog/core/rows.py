"""Rows of a record as sessions make them: plain tuples, no Arrow, no I/O.

A row of `samples` is a list in the order of `SAMPLE_COLUMNS`, because a run makes thousands a
second. docs/reference/tables.md describes every column; `record/schema.py` has the Parquet types. A
new column belongs in both (docs/how-to/change.md). The record adds `run` and `seq` itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple, Protocol

from jbclog.core.states import StationOutcome

SCHEMA_VERSION: Final = 2
TABLES: Final = ("samples", "events", "settings", "counters")
"""Tables of a run, defined in `record/schema.py`."""

PortKey = tuple[str, int]
"""Station and port."""

SampleRow = list[object]
"""One tick of one port, in the order of `SAMPLE_COLUMNS`."""

SAMPLE_COLUMNS: Final = (
    "time",
    "tick",
    "station",
    "port",
    "late_us",
    "scan_us",
    "quality",
    "reasons",
    "temperature_c",
    "power_permille",
    "status",
    "cooling",
    "desoldering",
    "motor",
    "setpoint_c",
    "tool",
    "port_error",
    "station_error",
    "alarm_high",
    "alarm_low",
    "transformer_c",
    "transistor_c",
    "delay_s",
    "external_c",
    "set_flow_permille",
    "feeding",
    "solder_shortage",
    "clogged",
    "preparing",
    "in_range",
)
COLUMN: Final = {name: place for place, name in enumerate(SAMPLE_COLUMNS)}
SIGNAL_COLUMNS: Final = SAMPLE_COLUMNS[COLUMN["temperature_c"] :]

_SHARED: Final = {
    "cooling": "status",
    "desoldering": "status",
    "motor": "status",
    "alarm_low": "alarm_high",
    "clogged": "solder_shortage",
}
SIGNAL_OF_COLUMN: Final = {column: _SHARED.get(column, column) for column in SIGNAL_COLUMNS}
"""Signal that fills each column; a signal is named after the first column that its answer fills."""

QUALITIES: Final = (
    "disconnected",
    "robot_off",
    "timeout",
    "bcc",
    "format",
    "nak",
    "implausible",
    "contradicted",
    "pulled",
    "no_tool",
    "skipped",
    "ok",
)
"""A row's quality is the first of these that applies (docs/reference/tables.md)."""


class Severity(StrEnum):
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"
    CRITICAL = "critical"


def severity_of(text: str) -> Severity:
    """Return the severity of a recorded event; one that this jbclog does not know, as of a newer
    one, is shown as needing attention.
    """
    try:
        return Severity(text)
    except ValueError:
        return Severity.WARNING


class EventRow(NamedTuple):
    """One event. Times are UTC microseconds; it happened between `earliest` and its time."""

    time: int
    kind: str
    severity: Severity
    text: str
    station: str | None = None
    port: int | None = None
    earliest: int | None = None
    code: int | None = None
    value: float | None = None
    limit_value: float | None = None
    raw: str | None = None


class SettingOutcome(StrEnum):
    CONFIRMED = "confirmed"
    UNCHANGED = "unchanged"
    MISMATCH = "mismatch"
    REFUSED = "refused"
    UNCONFIRMED = "unconfirmed"
    UNSUPPORTED = "unsupported"
    READ = "read"
    REPEATED = "repeated"


class SettingRow(NamedTuple):
    """Outcome of one setting on one station, one of `SettingOutcome`; values as text in the
    setting's unit.
    """

    time: int
    station: str
    port: int | None
    tool_name: str | None
    setting: str
    uom: str
    requested: str | None
    written: str | None
    readback: str | None
    nak: int | None
    outcome: str


class CounterRow(NamedTuple):
    """One reading of a counter. After a failed read, `value` is None and `raw` is the reason in
    ``<>``.
    """

    time: int
    station: str
    port: int | None
    counter: str
    value: float | None
    uom: str
    raw: str


class Journal(Protocol):
    """Receives a session's rows. No call may wait; the implementation stores the rows."""

    def sample(self, row: SampleRow) -> None: ...

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        """Record an event. `at_once`: commit now, because the station has already cleared it
        (flags).
        """

    def setting(self, setting: SettingRow) -> None: ...

    def counter(self, counter: CounterRow) -> None: ...

    def facts(self, facts: StationFacts) -> None:
        """Replace what is known about a station."""


class NoJournal:
    """Discards everything: for a session whose record has failed while its tools are still hot."""

    def sample(self, row: SampleRow) -> None: ...

    def event(self, event: EventRow, *, at_once: bool = False) -> None: ...

    def setting(self, setting: SettingRow) -> None: ...

    def counter(self, counter: CounterRow) -> None: ...

    def facts(self, facts: StationFacts) -> None: ...


def quality_of(reasons: dict[str, str]) -> str:
    """Return the first of `QUALITIES` among the reasons; ``nak3`` counts as ``nak``."""
    present = {"nak" if reason.startswith("nak") else reason for reason in reasons.values()}
    return next((quality for quality in QUALITIES if quality in present), "ok")


def reasons_text(reasons: dict[str, str]) -> str | None:
    """Format reasons: ``power_permille=timeout;alarm_high=nak3``; None for none."""
    return ";".join(f"{column}={reason}" for column, reason in reasons.items()) or None


@dataclass(slots=True)
class StationFacts:
    """What a run knows about one station, for the manifest; a session sends it again on every
    change.

    `outcome` is one of `StationOutcome`. `safe_state` maps a touched port to ``verified``, ``sent``
    or ``failed``.
    """

    name: str
    url: str
    family: str
    model: str | None = None
    software: str | None = None
    address: int | None = None
    baudrate: int = 19200
    format: str = "8N1"
    ports: list[int] = field(default_factory=list)
    tool_names: dict[int, str] = field(default_factory=dict)
    # median, p99, n; faster_by if a faster link setting exists
    turnaround_us: dict[str, float] = field(default_factory=dict)
    asked_rate: float | str | None = None  # Hz, auto, fit or max; None in older records
    rate_hz: float | None = None  # the chosen rate; None without pause and in older records
    period_s: float | None = None
    recipe: str | None = None
    rated_power_w: float | None = None
    # supported by the family; empty in older records
    signals: list[str] = field(default_factory=list)
    not_supported: list[str] = field(default_factory=list)
    first_tick: int | None = None
    last_tick: int | None = None
    # port -> signal -> readings due, counted by the session
    due: dict[str, dict[str, int]] = field(default_factory=dict)
    # settings read repeatedly that have no column
    watched: dict[str, dict[str, dict[str, int]]] = field(default_factory=dict)
    skipped: int = 0  # ticks without rows: the host was suspended or late
    # rows of `skipped` for which the host was too late; None in older records
    skipped_by_host: int | None = None
    garbage_bytes: int = 0
    # frames without a request, by kind: echo, address, code, late, unasked
    strays: dict[str, int] = field(default_factory=dict)
    # deviations from the recommended form, by B-number
    anomalies: dict[int, int] = field(default_factory=dict)
    # answers read again before they were accepted, by command
    doubted: dict[str, int] = field(default_factory=dict)
    # for evaluating the samples; empty in older records
    alarm_rules: dict[str, float] = field(default_factory=dict)
    alarms: int = 0  # that count (docs/reference/exit-codes.md)
    unconfirmed_alarms: int = 0
    settings_changed: int = 0
    settings_repeated: int = 0  # settings written again at the start because the write was lost
    outages: int = 0
    worst_slow_periods: float = 0.0  # longest delay of a slow reading, in its own periods
    touched: list[int] = field(default_factory=list)
    outcome: str = StationOutcome.RUNNING
    reason: str = ""
    asked_safe_state: str = ""  # target state of touched tools
    # hot air ports whose suction stays on in the safe state
    suction: list[int] = field(default_factory=list)
    may_feed: bool = False  # a feeder that this run has to stop may be running
    safe_state: dict[int, str] = field(default_factory=dict)
    # a sentence for each tool or feeder that is not safe
    unsafe: list[str] = field(default_factory=list)
    last_temperature_c: dict[int, float] = field(default_factory=dict)
    # by the line file's key `model` and confirmed by reads; else the name proves the family
    model_accepted: bool = False


@dataclass(frozen=True, slots=True)
class TipCheck:
    """The tip verification in force on a port at the start of the run (`maintenance.verification`).

    `state`: ``pass`` or ``fail`` by the last valid verification, ``other tip`` if that was for a
    different tip than the run names, ``none``, or ``unreadable``. `days` is its age at the start;
    `adjust_c` the station's adjustment then, if read; `sha256` the hash of its line.
    """

    station: str
    port: int
    state: str
    text: str
    time: str | None = None
    days: float | None = None
    tip: str | None = None
    instrument: str | None = None
    offset_c: float | None = None
    limit_c: float | None = None
    adjust_c: float | None = None
    seq: int | None = None
    sha256: str | None = None
