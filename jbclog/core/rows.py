"""The rows of a record, as the session makes them: plain tuples, no Arrow, no I/O.

A row of `samples` is a list in the order of `SAMPLE_COLUMNS`, because a run makes thousands a second of
them; the other three are rare and are named tuples. What every column means is in docs/reference/tables.md;
types and units for Parquet are in `record/schema.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple, Protocol

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
    "set_c",
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
FLAG_COLUMNS: Final = frozenset(
    ["cooling", "desoldering", "alarm_high", "alarm_low", "feeding", "solder_shortage", "clogged", "preparing", "in_range"]
)
"""Held as `bool`."""
TEXT_COLUMNS: Final = frozenset(["station", "quality", "reasons", "status", "motor"])
"""Held as `str`; `motor` is ``off``, ``forward`` or ``backward``. All other columns hold `int`; `tool` is the code of R-CT."""

_SHARED: Final = {
    "cooling": "status",
    "desoldering": "status",
    "motor": "status",
    "alarm_low": "alarm_high",
    "clogged": "solder_shortage",
}
SIGNAL_OF_COLUMN: Final = {column: _SHARED.get(column, column) for column in SIGNAL_COLUMNS}
"""The signal that fills a column: named by the first of the columns that one answer fills."""

QUALITIES: Final = ("disconnected", "robot_off", "timeout", "bcc", "format", "nak", "implausible", "no_tool", "skipped", "ok")
"""In the order in which the first that applies is taken (docs/reference/tables.md)."""


class Severity(StrEnum):
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"
    CRITICAL = "critical"


class EventRow(NamedTuple):
    """One fact. Times are UTC microseconds; `earliest` is the other end of the interval in which it happened."""

    time: int
    kind: str
    severity: Severity
    text: str
    station: str | None = None
    port: int | None = None
    earliest: int | None = None
    code: int | None = None
    value: float | None = None
    limit: float | None = None
    raw: str | None = None


class SettingRow(NamedTuple):
    """The outcome of one setting on one station; values as text in the setting's unit."""

    time: int
    station: str
    port: int | None
    tool: str | None
    setting: str
    unit: str
    requested: str | None
    written: str | None
    readback: str | None
    nak: int | None
    outcome: str


OUTCOMES: Final = ("confirmed", "unchanged", "mismatch", "refused", "unconfirmed", "unsupported", "read", "repeated")


class CounterRow(NamedTuple):
    """One reading of a counter. Where it failed `value` is None and `raw` is the reason in angle brackets."""

    time: int
    station: str
    port: int | None
    counter: str
    value: float | None
    unit: str
    raw: str


class Journal(Protocol):
    """Where a session puts what it has learnt. Each call returns at once; keeping it safe is the journal's work."""

    def sample(self, row: SampleRow) -> None: ...

    def event(self, event: EventRow, *, at_once: bool = False) -> None:
        """`at_once`: commit now, because the station has already forgotten it (alarm flags)."""

    def setting(self, setting: SettingRow) -> None: ...

    def counter(self, counter: CounterRow) -> None: ...

    def facts(self, facts: StationFacts) -> None:
        """What is now known of a station; replaces what was handed over before."""


class NoJournal:
    """Takes everything and keeps nothing: for a session whose record has failed and whose tools are still hot."""

    def sample(self, row: SampleRow) -> None: ...

    def event(self, event: EventRow, *, at_once: bool = False) -> None: ...

    def setting(self, setting: SettingRow) -> None: ...

    def counter(self, counter: CounterRow) -> None: ...

    def facts(self, facts: StationFacts) -> None: ...


def quality_of(reasons: dict[str, str]) -> str:
    """The row's quality: the first of `QUALITIES` among its reasons, ``nak3`` counting as ``nak``."""
    present = {"nak" if reason.startswith("nak") else reason for reason in reasons.values()}
    return next((quality for quality in QUALITIES if quality in present), "ok")


def reasons_text(reasons: dict[str, str]) -> str | None:
    """``power_permille=timeout;alarm_high=nak3``, or None when all is well."""
    return ";".join(f"{column}={reason}" for column, reason in reasons.items()) or None


@dataclass(slots=True)
class StationFacts:
    """What a run knows of one station, kept in the manifest; a session hands it over again when it learns more.

    `outcome` is ``running`` until the end, then ``completed``, ``stopped`` (by a setting found changed),
    ``refused`` (before sampling), ``gone`` (did not answer at the start or at the end), ``not_started`` (it was ready, and another
    station was not), ``left_out`` (it was not ready, and the run was allowed to start without it) or ``failed``.
    `safe_state` maps a touched port to ``verified``, ``sent`` or ``failed``.
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
    tools: dict[int, str] = field(default_factory=dict)
    turnaround_us: dict[str, float] = field(default_factory=dict)  # median, p99, n; faster_by, where the link is so
    asked_rate: float | str | None = None  # Hz, auto, fit or max; None in records that do not say
    rate_hz: float | None = None  # that came of it; None without pause, and in records that do not say
    period_s: float | None = None
    recipe: str | None = None
    rated_power_w: float | None = None
    signals: list[str] = field(default_factory=list)  # that its family tells; empty in records that do not say
    not_supported: list[str] = field(default_factory=list)
    first_tick: int | None = None
    last_tick: int | None = None
    due: dict[str, dict[str, int]] = field(default_factory=dict)  # port -> signal -> readings due, as the session counted
    watched: dict[str, dict[str, dict[str, int]]] = field(default_factory=dict)  # settings read again, without a column
    skipped: int = 0  # ticks without rows: the host stood still
    skipped_by_host: int | None = None  # rows of `skipped` for which the host was too late; None in records that do not say
    garbage_bytes: int = 0
    strays: dict[str, int] = field(default_factory=dict)  # frames that answered nothing: echo, address, code, late, unasked
    anomalies: dict[int, int] = field(default_factory=dict)  # forms not as recommended, by B-number
    doubted: dict[str, int] = field(default_factory=dict)  # answers that were not believed at once, by command
    alarm_rules: dict[str, float] = field(default_factory=dict)  # by which samples are evaluated; empty in records without
    alarms: int = 0  # that count (docs/reference/exit-codes.md)
    unconfirmed_alarms: int = 0
    settings_changed: int = 0
    settings_repeated: int = 0  # writes at the start that were lost and followed by another
    outages: int = 0
    worst_slow_periods: float = 0.0  # the longest that a slow reading waited, in its own periods
    touched: list[int] = field(default_factory=list)
    outcome: str = "running"
    reason: str = ""
    asked_safe_state: str = ""  # what touched tools are to be put in
    suction: list[int] = field(default_factory=list)  # ports of hot air whose suction is on, and is kept by a safe order
    may_feed: bool = False  # a feeder may be running that is this run's to stop
    safe_state: dict[int, str] = field(default_factory=dict)
    unsafe: list[str] = field(default_factory=list)  # a sentence for each tool or feeder that could not be made safe
    last_temperature_c: dict[int, float] = field(default_factory=dict)
    model_accepted: bool = False  # by the line file's key `model`, and borne out by reads; else the name proves the family


UNITS, JOINTS = "units", "joints"
NOT_COUNTED: Final = "How many there were is not known: the record ends before they were counted."


@dataclass(frozen=True, slots=True)
class Goal:
    """How many units or joints a run was to end with, and how many there were; kept in the manifest.

    `what` is ``units`` or ``joints``. `reached` counts what is known: units that were finished, joints that were found, of all
    stations together. It is None where nobody knows, or the run has not ended. `text` says it in a sentence.
    """

    what: str
    wanted: int
    reached: int | None = None
    text: str = NOT_COUNTED

    @property
    def is_met(self) -> bool:
        return self.reached is not None and self.reached >= self.wanted


@dataclass(frozen=True, slots=True)
class TipCheck:
    """The tip verification that a port stood on when its run began, kept in the manifest (`verifying`).

    `state`: ``pass`` or ``fail`` as the last valid one came out, ``other tip`` where that was of another tip than the one that
    was named for the run, ``none``, or ``unreadable``. `days` is its age at the run's start; `adjust_c` is the station's
    adjustment at that time, where it was read; `sha256` is that of its line.
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
