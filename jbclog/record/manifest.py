"""A run's `manifest.json`: who, what, when, and the result. It never changes once sealed."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from itertools import accumulate, islice
from pathlib import Path
from typing import Final, TypeVar

from jbclog.core.clock import utc_of, utc_text
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.files import LIMITS, Kind, read_regular
from jbclog.core.goal import Goal
from jbclog.core.json_files import (
    builder,
    expect_moment,
    expect_period,
    expect_time,
    json_of,
    read_json,
)
from jbclog.core.rows import SCHEMA_VERSION, SIGNAL_COLUMNS, StationFacts, TipCheck
from jbclog.core.states import StationOutcome
from jbclog.record.old_names import (
    OLD_COLUMNS,
    OLD_SCHEMA,
    facts_with_new_keys,
    with_new_keys,
)

NAME: Final = "manifest.json"
MOST_SAID: Final = 500
LONGEST_NAME: Final = 200  # of a station; names of figures and tables contain it
ROUND_A_UNIT: Final = 8  # bytes at most around a unit: its comma, line end and indentation
END: Final = b"\n}\n"
SINCE_DIGEST: Final = "units"  # a key that came with the digest: manifests of 0.1.0 have neither
DIGEST: Final = ',\n "digest": "%s"\n}\n'
_DIGEST: Final = re.compile(rb',\n "digest": "([0-9a-f]{64})"\n\}\n')
_DIGEST_BYTES: Final = len(DIGEST % ("0" * 64))
"""The keys of manifests without a digest."""


class RunState(StrEnum):
    """The state of a run's record."""

    OPEN = "open"
    SEALED = "sealed"


class NoManifest(RecordError):
    """The file exists and is no manifest of a recorder."""


V = TypeVar("V")
SignalLedger = dict[str, int]
"""``due``, ``ok`` and each reason: due = ok + all reasons."""

Ledger = dict[str, dict[str, dict[str, SignalLedger]]]
"""station -> port -> signal."""


@dataclass(frozen=True, slots=True)
class LineFile:
    """The line file as it ran: `file` is its name in the run's folder."""

    name: str
    file: str
    sha256: str


@dataclass(frozen=True, slots=True)
class RecipeFile:
    """A recipe as it ran."""

    file: str
    sha256: str
    name: str
    revision: int | str


@dataclass(frozen=True, slots=True)
class Metadata:
    """What people stated at the start of the run.

    A tip is ``ID``, ``STATION=ID`` or ``STATION:PORT=ID``: for all tools, for those of a station,
    for one.
    """

    operator: str | None = None
    order: str | None = None
    product: str | None = None
    units: list[str] = field(default_factory=list)
    tags: dict[str, str] = field(default_factory=dict)
    wire_lots: list[str] = field(default_factory=list)
    flux_lots: list[str] = field(default_factory=list)
    tips: list[str] = field(default_factory=list)

    def said(self) -> dict[str, str]:
        """Return entries by name, tags last, several of a kind joined (at most `MOST_SAID`)."""
        plain = {"operator": self.operator, "order": self.order, "product": self.product}
        several = {
            "units": self.units,
            "wire lots": self.wire_lots,
            "flux lots": self.flux_lots,
            "tips": self.tips,
        }
        shown = plain | {name: _joined(texts) for name, texts in several.items()}
        tags = {f"tag {name}" if name in shown else name: text for name, text in self.tags.items()}
        return {name: text for name, text in shown.items() if text} | tags

    def tip(self, station: str, port: int) -> str | None:
        """Return the stated tip of a port: the port's, else its station's, else the run's. None if
        not stated, or ambiguous.
        """
        of: dict[str, set[str]] = {}
        for text in self.tips:
            place, equals, name = text.partition("=")
            of.setdefault(place if equals else "", set()).add(name if equals else place)
        found = of.get(f"{station}:{port}") or of.get(station) or of.get("") or set()
        return found.pop() if len(found) == 1 else None


def _joined(texts: list[str]) -> str:
    more = len(texts) - MOST_SAID
    return ", ".join(texts[:MOST_SAID]) + (f" and {more} more, in {NAME}" if more > 0 else "")


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit (its serial) worked on during the run; times as in the manifest, `stop` None if
    unknown.
    """

    unit: str
    start: str
    stop: str | None = None


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A step of the host's clock: when it was seen (by the run's clock, as in the manifest), its
    size, and from then on the host's time less the run's.
    """

    time: str
    step_s: float
    offset_s: float


@dataclass(frozen=True, slots=True)
class Lost:
    """What a crash, a disk or damage took: at most so many seconds of each station (None: unknown),
    and a sentence.
    """

    seconds_at_most: float | None
    text: str


@dataclass(frozen=True, slots=True)
class SealedFile:
    """A file of the run: path in the folder, rows (None: no table), size, hash.

    Of a part also length and hash of its footer, from the first byte of its metadata to the end of
    the file; None for other files, and in manifests of 0.1.0.
    """

    path: str
    rows: int | None
    bytes: int
    sha256: str
    footer_bytes: int | None = None
    footer_sha256: str | None = None

    def in_report(self) -> dict[str, object]:
        """Return what a report repeats of the entry."""
        return {"path": self.path, "rows": self.rows, "bytes": self.bytes, "sha256": self.sha256}


@dataclass(frozen=True, slots=True)
class Previous:
    """The previous run on the same production line, and its fingerprint; without one the text says
    why.
    """

    run: str | None
    sha256: str | None
    text: str


@dataclass(slots=True)
class Manifest:
    """The manifest. `exit_status` is ``success``, ``aborted``, ``failed``, ``lost`` or not yet
    known.

    Times are ISO 8601 in UTC. `t0_mono`: tick 0 on the recorder's monotonic clock in seconds;
    `t0_utc`: the same moment in seconds since 1970 UTC. `rate`: in Hz, or ``max``. `wire`: None
    without serial captures, ``whole`` with complete ones, else what is missing. `previous`: None if
    the recorder ended before it searched. `units`: those whose serials were read during the run;
    units named at its start are in `metadata`. `verifications`: the tip verifications in force at
    the start. `goals`: the numbers after which it was to end, and their results. `rules`: number
    of the rules and methods of its verdict (`analysis/rules_number.py`); runs of 0.1.0 lack it, and
    have 1. `clock_steps`: steps of the host's clock, which no time of the run follows; None in runs
    of 0.1.0, whose times follow it.

    The file has a last key `digest`: the SHA-256 of the file without it.
    """

    run: str
    schema: int = SCHEMA_VERSION
    state: RunState = RunState.OPEN
    exit_status: str | None = None
    exit_code: int | None = None
    verdict: str | None = None
    rules: int = 1
    verdict_rules: list[dict[str, object]] = field(default_factory=list)
    start: str | None = None
    stop: str | None = None
    t0_mono: float | None = None
    t0_utc: float | None = None
    line: LineFile | None = None
    recipes: list[RecipeFile] = field(default_factory=list)
    metadata: Metadata = field(default_factory=Metadata)
    units: list[Unit] = field(default_factory=list)
    host: dict[str, str] = field(default_factory=dict)
    rate: float | str | None = None
    guard: str = "none"
    wire: str | None = None
    stations: list[StationFacts] = field(default_factory=list)
    ledger: Ledger = field(default_factory=dict)
    lost: Lost | None = None
    files: list[SealedFile] = field(default_factory=list)
    previous: Previous | None = None
    verifications: list[TipCheck] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    clock_steps: list[ClockStep] | None = None

    @property
    def is_sealed(self) -> bool:
        return self.state == RunState.SEALED

    @property
    def t0_utc_us(self) -> int:
        """`t0_utc` in µs, as the origin of a time axis; 0 if it is unknown."""
        return round((self.t0_utc or 0.0) * 1e6)

    def serials(self) -> list[str]:
        """Return all known units, each once: those named at the start, then those read."""
        return list(dict.fromkeys([*self.metadata.units, *(unit.unit for unit in self.units)]))

    def station(self, name: str) -> StationFacts | None:
        return next((facts for facts in self.stations if facts.name == name), None)


@dataclass(frozen=True, slots=True)
class _Rule:
    """What a report shows of a rule of the verdict; 0.1.0 wrote fewer fields."""

    name: str = ""
    station: str | None = None
    port: int | None = None
    limit_value: float | str | None = None
    observed: float | str | None = None
    uom: str = ""
    result: str = ""
    text: str = ""


_build_manifest: Final = builder(Manifest)
_build_facts: Final = builder(StationFacts)
_build_rules: Final = builder(list[_Rule])


def iso(micros: int) -> str:
    """Format UTC microseconds since 1970 as in the manifest: ``2026-11-21T01:30:00.000000Z``."""
    return utc_text(utc_of(micros))


def read_manifest(folder: Path) -> Manifest:
    """Read a run's manifest. Raises RecordError if it is missing, invalid, or of a newer jbclog."""
    path = folder / NAME
    try:
        data = read_json(path, Kind.MANIFEST)
        version = data.get("schema")
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise RecordError(
                f"{path}: written with schema {version}; this jbclog knows {SCHEMA_VERSION}; use a"
                " newer jbclog"
            )
        if version == OLD_SCHEMA:
            data = with_new_keys(data)
        manifest = _build_manifest(data)
        if version == OLD_SCHEMA:
            manifest = _signals_now(manifest)
        _build_rules(manifest.verdict_rules)
        _expect_stations(manifest.stations)
        steps = [step.time for step in manifest.clock_steps or ()]
        for time in (manifest.start, manifest.stop, *steps):
            expect_time(time)
        expect_moment(manifest.t0_utc)
        for station in manifest.stations:
            expect_period(station.period_s)
        return manifest
    except FileNotFoundError:
        raise RecordError(
            f"{folder} has no manifest; it is no run, or one that was cut off at its very start"
        ) from None
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise NoManifest(f"{path} is no manifest: {error}") from error


def _signals_now(manifest: Manifest) -> Manifest:
    """Return a manifest of schema 1 with the names that signals have now."""
    stations = [_facts_now(facts) for facts in manifest.stations]
    ledger = {name: _by_port_now(ports) for name, ports in manifest.ledger.items()}
    return replace(manifest, stations=stations, ledger=ledger)


def _facts_now(facts: StationFacts) -> StationFacts:
    now = OLD_COLUMNS["samples"]
    return replace(
        facts,
        signals=[now.get(name, name) for name in facts.signals],
        not_supported=[now.get(name, name) for name in facts.not_supported],
        due=_by_port_now(facts.due),
        watched=_by_port_now(facts.watched),
    )


def _by_port_now(ports: Mapping[str, Mapping[str, V]]) -> dict[str, dict[str, V]]:
    now = OLD_COLUMNS["samples"]
    return {
        port: {now.get(name, name): value for name, value in signals.items()}
        for port, signals in ports.items()
    }


def facts_in(folder: Path, texts: Mapping[str, str]) -> dict[str, StationFacts]:
    """Return stations' facts by name, from their texts in a journal. Raises `RecordError`."""
    found = {}
    for name, text in texts.items():
        try:
            found[name] = _facts_now(_build_facts(facts_with_new_keys(json_of(text))))
        except ValueError as error:
            raise RecordError(
                f"{folder}: the facts of station {name} cannot be read: {error}"
            ) from error
    return found


def merged_facts(
    known: Iterable[StationFacts], stored: Mapping[str, StationFacts]
) -> list[StationFacts]:
    """Return the facts of a manifest, in its order, updated from the journal.

    The manifest's take precedence for a session that has ended: the store may not have them.
    """
    facts = {one.name: one for one in known}
    for name, found in stored.items():
        if name not in facts or facts[name].outcome == StationOutcome.RUNNING:
            facts[name] = found
    return list(facts.values())


def _expect_stations(stations: Iterable[StationFacts]) -> None:
    """Raise ValueError for a station's name that is too long, or a signal that is no column of the
    samples: coverage and verdict read the columns of these names.
    """
    for station in stations:
        if len(station.name) > LONGEST_NAME:
            raise ValueError(
                f"a station's name of {len(station.name)} characters, at most {LONGEST_NAME}"
            )
        for signal in station.signals:
            if signal not in SIGNAL_COLUMNS:
                raise ValueError(f"station {station.name}: {signal!r:.60} is no signal")


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest atomically. Raises RecordError."""
    try:
        write_whole(folder / NAME, manifest_text(manifest).encode())
    except OSError as error:
        raise RecordError(
            f"{folder / NAME} cannot be written: {write_failure(error, folder)}"
        ) from error


def manifest_text(manifest: Manifest) -> str:
    """Format a manifest with its digest; characters that UTF-8 cannot encode (from a folder's name
    in another encoding) become question marks.
    """
    plain = (
        json.dumps(asdict(manifest), indent=1, ensure_ascii=False, allow_nan=False)
        .encode(errors="replace")
        .decode()
        + "\n"
    )
    return plain.removesuffix(END.decode()) + DIGEST % hashlib.sha256(plain.encode()).hexdigest()


def expect_readable(manifest: Manifest) -> None:
    """Raise RecordError for a manifest that no reader would accept: too long, or with an invalid
    station.
    """
    try:
        _expect_stations(manifest.stations)
    except ValueError as error:
        raise RecordError(f"no reader takes this manifest: {error}") from error
    size = len(manifest_text(manifest).encode())
    if size > LIMITS[Kind.MANIFEST]:
        raise RecordError(
            f"too much for one record: its manifest has {size} bytes, at most"
            f" {LIMITS[Kind.MANIFEST]}"
        )


def fitting_units(manifest: Manifest, units: list[Unit]) -> list[Unit]:
    """Return the first units, as many as fit with the other parts; the events have all of them."""
    size = len(manifest_text(replace(manifest, units=[])).encode())
    ends = accumulate(
        (
            len(json.dumps(asdict(one), indent=3, ensure_ascii=False).encode(errors="replace"))
            + ROUND_A_UNIT
            for one in units
        ),
        initial=size,
    )
    room = sum(end <= LIMITS[Kind.MANIFEST] for end in islice(ends, 1, None))
    return units[:room]


def manifest_sha256(folder: Path) -> str:
    """Return the run's fingerprint, cited by notes, reports and runs. Raises RecordError."""
    try:
        return hashlib.sha256(read_regular(folder / NAME, Kind.MANIFEST)).hexdigest()
    except OSError as error:
        raise NoManifest(f"{folder / NAME} cannot be read: {error.strerror or error}") from error


def wrong_digest(folder: Path) -> str | None:
    """Return what is wrong with the manifest's own digest; None if it is right. Raises OSError.

    It shows accidental changes: a deliberate change of the manifest can include the digest.
    """
    return why_changed(read_regular(folder / NAME, Kind.MANIFEST))


def has_digest(folder: Path) -> bool:
    """Return True if the manifest has a digest; those of 0.1.0 have none. Raises OSError."""
    return (
        _DIGEST.fullmatch(read_regular(folder / NAME, Kind.MANIFEST)[-_DIGEST_BYTES:]) is not None
    )


def why_changed(data: bytes) -> str | None:
    """Return what is wrong with the digest of a manifest's bytes."""
    found = _DIGEST.fullmatch(data[-_DIGEST_BYTES:])
    if found is None:
        plain = json_of(data)
        is_of_0_1 = isinstance(plain, dict) and SINCE_DIGEST not in plain
        return None if is_of_0_1 else "has lost its digest: it was changed"
    without = data[:-_DIGEST_BYTES] + END
    return (
        None
        if hashlib.sha256(without).hexdigest().encode() == found[1]
        else "was changed: its digest is another"
    )
