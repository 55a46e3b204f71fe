"""The manifest: who, what, when, and what came of it. `manifest.json`, whole or not there, never changed once sealed."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import build, expect_moment, expect_period, expect_year, json_of, read_json
from jbclog.core.rows import Goal, StationFacts, TipCheck
from jbclog.record.schema import SCHEMA_VERSION

NAME: Final = "manifest.json"
STATES: Final = ("open", "sealed")
END: Final = b"\n}\n"
DIGEST: Final = ',\n "digest": "%s"\n}\n'
_DIGEST: Final = re.compile(rb',\n "digest": "([0-9a-f]{64})"\n\}\n\Z')
OF_0_1: Final = frozenset(
    {
        *("schema", "run", "state", "exit_status", "exit_code", "verdict", "verdict_rules", "started", "ended", "t0_mono"),
        *(
            "t0_utc",
            "line",
            "recipes",
            "metadata",
            "host",
            "rate",
            "guard",
            "wire",
            "stations",
            "ledger",
            "lost",
            "files",
            "previous",
        ),
    }
)
"""The keys of manifests before there was a digest."""


class NoManifest(RecordError):
    """The file is there, and is not what the recorder wrote."""


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
    """What people said of the run when they started it.

    A tip is ``ID``, ``STATION=ID`` or ``STATION:PORT=ID``: of every tool, of a station's, of one.
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
        """Everything that was said, by its name, tags behind the rest; several of one kind behind each other."""
        plain = {"operator": self.operator, "order": self.order, "product": self.product}
        several = {"units": self.units, "wire lots": self.wire_lots, "flux lots": self.flux_lots, "tips": self.tips}
        told = plain | {name: ", ".join(texts) for name, texts in several.items()}
        tags = {f"tag {name}" if name in told else name: text for name, text in self.tags.items()}
        return {name: text for name, text in told.items() if text} | tags

    def tip(self, station: str, port: int) -> str | None:
        """Which tip was said to be in a port: that of the port, of its station, of the run. None: nobody said so, or not one."""
        of: dict[str, set[str]] = {}
        for text in self.tips:
            place, equals, name = text.partition("=")
            of.setdefault(place if equals else "", set()).add(name if equals else place)
        found = of.get(f"{station}:{port}") or of.get(station) or of.get("") or set()
        return found.pop() if len(found) == 1 else None


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit that was on the bench while the run went on; times as in the manifest, `end` None where no event tells it."""

    serial: str
    begin: str
    end: str | None = None


@dataclass(frozen=True, slots=True)
class Lost:
    """What a crash, a disk or damage took: seconds of every station at the most (None: not known), in a sentence."""

    seconds_at_most: float | None
    text: str


@dataclass(frozen=True, slots=True)
class SealedFile:
    """A file of the run: its path in the folder, its rows (None: it has none), its size, its hash."""

    path: str
    rows: int | None
    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Previous:
    """The run before this one on the same line, and its head; where there is none, or it is not known, the text says why."""

    run: str | None
    sha256: str | None
    text: str


@dataclass(slots=True)
class Manifest:
    """`state` is ``open`` or ``sealed``; `exit_status` ``success``, ``aborted``, ``failed``, ``lost`` or not yet known.

    Times are ISO 8601 in UTC; `t0_mono` is the moment of tick 0 on the recorder's monotonic clock in seconds, `t0_utc`
    the same moment in seconds since 1970 UTC. `rate` is in Hz or ``max``. `wire` is None where what passed over the wires
    was not kept, ``whole`` where it was, or says what of it is missing. `previous` is None where the recorder had not come
    to looking for it. `units` are those whose serials were read while the run went on, as its events have them; those that
    were named when it was started are in `metadata`. `verifications` are the tip verifications that its ports stood on when it
    began; empty in records of before they were cited. `goals` are the numbers that it was to end with, and what came of them;
    empty where none was wanted. `rules` is the version of the rules and methods that it is judged by
    (`analysis/verdict/versions.py`); records of before there was a second have none, and are of 1.

    In the file a last key follows, `digest`: the SHA-256 of the file without it.
    """

    run: str
    schema: int = SCHEMA_VERSION
    state: str = "open"
    exit_status: str | None = None
    exit_code: int | None = None
    verdict: str | None = None
    rules: int = 1
    verdict_rules: list[dict[str, object]] = field(default_factory=list)
    started: str | None = None
    ended: str | None = None
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

    def serials(self) -> list[str]:
        """Every unit that is known of, each once: those named at the start, then those read while the run went on."""
        return list(dict.fromkeys([*self.metadata.units, *(unit.serial for unit in self.units)]))

    def station(self, name: str) -> StationFacts | None:
        """What is known of the station called `name`."""
        return next((facts for facts in self.stations if facts.name == name), None)


def iso(micros: int) -> str:
    """UTC microseconds since 1970 as they stand in the manifest: ``2026-11-21T01:30:00.000000Z``."""
    moment = datetime.fromtimestamp(micros // 1_000_000, UTC).replace(microsecond=micros % 1_000_000)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def read_manifest(folder: Path) -> Manifest:
    """The manifest of the run in `folder`. Raises `RecordError`: none there, not one, or of a newer jbclog."""
    path = folder / NAME
    try:
        data = read_json(path, Kind.MANIFEST, in_utf8=True)
        version = data.get("schema")
        if isinstance(version, int) and version > SCHEMA_VERSION:
            raise RecordError(f"{path}: written with schema {version}; this jbclog knows {SCHEMA_VERSION}")
        manifest = build(Manifest, data)
        if manifest.state not in STATES:
            raise NoManifest(f"{path} is no manifest: its state is {manifest.state!r:.60}")
        for time in (manifest.started, manifest.ended):
            _expect_time(time)
        expect_moment(manifest.t0_utc)
        for station in manifest.stations:
            expect_period(station.period_s)
        return manifest
    except FileNotFoundError:
        raise RecordError(f"{folder} has no manifest; it is no run, or one that was cut off at its very start") from None
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise NoManifest(f"{path} is no manifest: {error}") from error


def _expect_time(text: str | None) -> None:
    """Raises ValueError where it is none, or has no zone."""
    if text is None:
        return
    moment = datetime.fromisoformat(text)
    expect_year(moment.year)
    if moment.tzinfo is None:
        raise ValueError(f"{text!r:.60} does not say which zone it is of")


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write it; whoever looks finds the old one or the new one. Raises `RecordError`."""
    try:
        write_whole(folder / NAME, manifest_text(manifest).encode())
    except OSError as error:
        raise RecordError(f"{folder / NAME} cannot be written: {error.strerror or error}") from error


def manifest_text(manifest: Manifest) -> str:
    """As it stands in the file, with its digest; what UTF-8 cannot write (a folder's name in another code) is a question mark."""
    plain = json.dumps(asdict(manifest), indent=1, ensure_ascii=False, allow_nan=False).encode(errors="replace").decode() + "\n"
    return plain.removesuffix(END.decode()) + DIGEST % hashlib.sha256(plain.encode()).hexdigest()


def manifest_sha256(folder: Path) -> str:
    """The head of a run: the hash that annotations, reports and other runs name it by. Raises `RecordError`."""
    try:
        return hashlib.sha256(read_foreign(folder / NAME, Kind.MANIFEST)).hexdigest()
    except OSError as error:
        raise NoManifest(f"{folder / NAME} cannot be read: {error.strerror or error}") from error


def wrong_digest(folder: Path) -> str | None:
    """What is wrong with the manifest's own digest, None where all is well. Raises OSError.

    It shows a change that was not meant to deceive: whoever changes the manifest can also change the digest.
    """
    return why_changed(read_foreign(folder / NAME, Kind.MANIFEST))


def has_digest(folder: Path) -> bool:
    """Whether the manifest has a digest; those of the first release have none. Raises OSError."""
    return _DIGEST.search(read_foreign(folder / NAME, Kind.MANIFEST)) is not None


def why_changed(data: bytes) -> str | None:
    """The same of a manifest that was read already."""
    found = _DIGEST.search(data)
    if found is None:
        told = json_of(data)
        is_old = isinstance(told, dict) and told.keys() <= OF_0_1
        return None if is_old else "has lost its digest: it was changed"
    plain = data[: found.start()] + END
    return None if hashlib.sha256(plain).hexdigest().encode() == found[1] else "was changed: its digest is another"
