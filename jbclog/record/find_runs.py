"""Find runs by their metadata and results, from their manifests alone.

    for one in find(Path("runs"), Filter(order="88123", since=datetime(2026, 11, 1, tzinfo=UTC))):
        ...  # a `Found`, or an `Unreadable` one, which may match

A text matches as a whole; ``*`` stands for any characters. Runs are ordered by their folders'
names, which begin with their start. The manifest has serials read during a run once it is sealed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from itertools import repeat
from pathlib import Path
from typing import Final

from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.json_files import builder, decoder, expect_period, expect_time, json_of
from jbclog.core.locks import is_held
from jbclog.core.rows import SCHEMA_VERSION
from jbclog.core.text import shortened
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import late_serials
from jbclog.record.clock_steps import EARLIEST_START, HostClock, start_doubt
from jbclog.record.folder import RUN_NAME
from jbclog.record.manifest import (
    NAME,
    ClockStep,
    LineFile,
    Lost,
    Metadata,
    RecipeFile,
    RunState,
    Unit,
    why_changed,
)
from jbclog.record.old_names import OLD_SCHEMA, with_new_keys

MOST_WHY: Final = 500  # characters of the reason why a manifest cannot be read
THREADS: Final = 8
AT_ONCE: Final = 256  # manifests given to the threads
MOST_COPIES: Final = 10  # named individually
RUNNING, CRASHED, SEALED = "running", "crashed", "sealed"
ENDINGS: Final = {
    "success": "ended",
    "aborted": "cut short",
    "failed": "ended with error",
    "lost": "recovered",
}
"""How a run ended, by the manifest's `exit_status`; independent of its verdict."""
STATES: Final = (RUNNING, CRASHED, *ENDINGS.values())
"""What `Found.shown_state` says of a run."""
STARTED: Final = "%Y%m%dT%H%M%SZ"  # the beginning of a folder's name
STARTED_LENGTH: Final = 16
OVER: Final = b'\n "state": "sealed"'
STEPPED: Final = b'"step_s": '  # of a step of the host's clock
# at the top level: deeper keys are indented more; 0.1.0 called it `ended`
STOP: Final = re.compile(rb'\n "(?:stop|ended)": "([0-9TZ:.+-]+)"')
OF_OLD_SCHEMA: Final = b'\n "schema": %d,' % OLD_SCHEMA


@dataclass(frozen=True, slots=True)
class _Station:
    name: str
    first_tick: int | None = None
    period_s: float | None = None


@dataclass(frozen=True, slots=True)
class _Summary:
    """The part of a manifest needed for finding."""

    run: str
    state: str
    schema: int = SCHEMA_VERSION
    exit_status: str | None = None
    exit_code: int | None = None
    verdict: str | None = None
    start: str | None = None
    stop: str | None = None
    line: LineFile | None = None
    recipes: list[RecipeFile] = field(default_factory=list)
    metadata: Metadata = field(default_factory=Metadata)
    units: list[Unit] = field(default_factory=list)
    stations: list[_Station] = field(default_factory=list)
    lost: Lost | None = None
    clock_steps: list[ClockStep] | None = None


_read_summary: Final = decoder(_Summary)
_build_summary: Final = builder(_Summary)


@dataclass(frozen=True, slots=True)
class Found:
    """A run. `state` is ``running``, ``crashed`` (`recover` finishes it) or ``sealed``.

    `run` is its name in the manifest, and that of its folder unless somebody renamed or copied it.
    `units` are all serials: named at the start, read during the run, added later. `recipes` are
    ``NAME@REVISION``. `changed` says what is wrong with the manifest: a person or a disk changed
    it. `periods_s` are seconds between the ticks of each sampled station; None without pause.
    `start` and `stop` are by the run's clock, whose host's was stepped by `clock_steps`.
    """

    folder: Path
    run: str
    state: str
    start: str | None
    stop: str | None
    line: str | None
    stations: tuple[str, ...]
    recipes: tuple[str, ...]
    operator: str | None
    order: str | None
    product: str | None
    units: tuple[str, ...]
    wire_lots: tuple[str, ...]
    flux_lots: tuple[str, ...]
    tips: tuple[str, ...]
    tags: Mapping[str, str]
    verdict: str | None
    exit_status: str | None
    exit_code: int | None
    lost: str | None
    changed: str | None
    periods_s: Mapping[str, float | None] = field(default_factory=dict)
    manifest_sha256: str = ""
    clock_steps: tuple[ClockStep, ...] = ()

    @property
    def host_start(self) -> str | None:
        """Start by the host's clock, corrected if that was wrong then."""
        return HostClock(self.clock_steps, self.start).corrected_text(self.start)

    @property
    def host_stop(self) -> str | None:
        """End by the host's clock."""
        return HostClock(self.clock_steps, self.start).corrected_text(self.stop)

    @property
    def clock_wrong(self) -> str | None:
        """What is wrong with its times, if its host had a wrong clock at the start."""
        return start_doubt(self.start, self.clock_steps)

    @property
    def shown_state(self) -> str:
        """``running``, ``crashed``, or how it ended: ``ended``, ``cut short``, ``ended with
        error``, ``recovered``.
        """
        return ending(self.exit_status, self.state) if self.state == SEALED else self.state


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A run's folder whose manifest cannot be read, and why."""

    folder: Path
    why: str


@dataclass(frozen=True, slots=True)
class Copy:
    """Another folder with the run of `counted`. `is_same`: their manifests are equal byte for
    byte.
    """

    folder: Path
    counted: Path
    is_same: bool

    def __str__(self) -> str:
        which = "the same" if self.is_same else "another"
        return (
            f"{self.folder} has the same run as {self.counted.name} ({which} manifest); only"
            f" {self.counted.name} counts"
        )


@dataclass(frozen=True, slots=True)
class Filter:
    """The conditions; None matches all. `since` and `until` limit a run's start, `until` excluded;
    both need a zone.

    `ended_since`: runs that ended then or later, or not at all; decided by the end of the manifest
    alone. A recipe is ``NAME`` or ``NAME@REVISION``, a tip its ID, with or without its place.
    """

    operator: str | None = None
    order: str | None = None
    product: str | None = None
    unit: str | None = None
    wire_lot: str | None = None
    flux_lot: str | None = None
    tip: str | None = None
    tags: Mapping[str, str] = field(default_factory=dict)
    line: str | None = None
    station: str | None = None
    recipe: str | None = None
    verdict: str | None = None
    state: str | None = None
    since: datetime | None = None
    until: datetime | None = None
    ended_since: datetime | None = None

    def fits(self, run: Found) -> bool:
        sought: list[tuple[str | None, Iterable[str | None]]] = [
            (self.operator, [run.operator]),
            (self.order, [run.order]),
            (self.product, [run.product]),
            (self.unit, run.units),
            (self.wire_lot, run.wire_lots),
            (self.flux_lot, run.flux_lots),
            (self.tip, [*run.tips, *(tip.partition("=")[2] for tip in run.tips)]),
            (self.line, [run.line]),
            (self.station, run.stations),
            (self.recipe, [*run.recipes, *(recipe.rpartition("@")[0] for recipe in run.recipes)]),
            (self.verdict and self.verdict.upper(), [run.verdict]),
            (self.state, [run.shown_state]),
            *((text, [run.tags.get(name)]) for name, text in self.tags.items()),
        ]
        if any(text is not None and not _fits(text, those) for text, those in sought):
            return False
        return self._is_within(run.host_start) and not self._has_ended(run.host_stop)

    def may_have(self, folder: Path) -> bool:
        """Return True if the start in the folder's name lies within the limits, or was given by a
        clock that was wrong.
        """
        began = folder.name[:STARTED_LENGTH]
        if began < EARLIEST_START.strftime(STARTED):
            return True
        is_early = self.since is not None and began < self.since.strftime(STARTED)
        is_late = self.until is not None and began > self.until.strftime(STARTED)
        return not (is_early or is_late) or not RUN_NAME.fullmatch(folder.name)

    def may_be_in(self, data: bytes, *, has_annotations: bool = False) -> bool:
        """Return True if a manifest's bytes contain all texts, so that the run may match."""
        sought = [
            self.operator,
            self.order,
            self.product,
            self.wire_lot,
            self.flux_lot,
            self.line,
            self.station,
        ]
        sought += [None if has_annotations else self.unit, self.verdict and self.verdict.upper()]
        texts = (text for text in (*sought, *self.tags.values()) if text and "*" not in text)
        return all(json.dumps(text, ensure_ascii=False).encode() in data for text in texts)

    def had_ended(self, data: bytes) -> bool:
        """Return True if a manifest's bytes show an end before `ended_since`."""
        if self.ended_since is None or OVER not in data or STEPPED in data:
            return False
        found = STOP.search(data)
        return found is not None and self._has_ended(found[1].decode())

    def _has_ended(self, stop: str | None) -> bool:
        """Return True if `stop` is before `ended_since`. Raises ValueError for text that is no
        time, or has no zone.
        """
        if self.ended_since is None or stop is None:
            return False
        expect_time(stop)
        return datetime.fromisoformat(stop) < self.ended_since

    def _is_within(self, start: str | None) -> bool:
        if self.since is None and self.until is None:
            return True
        began = None if start is None else datetime.fromisoformat(start)
        return (
            began is not None
            and (self.since is None or began >= self.since)
            and (self.until is None or began < self.until)
        )


ALL: Final = Filter()


def ending(exit_status: str | None, state: str) -> str:
    """Return how a run ended, or its state if the manifest does not say."""
    return state if exit_status is None else ENDINGS.get(exit_status, exit_status)


def find(folder: Path, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
    """Yield the matching runs directly below `folder`, or `folder` itself if it is one. Raises
    RecordError if it cannot be read.
    """
    paths = [path for path in runs_in(folder) if wanted.may_have(path)]
    for run in _summaries(paths, wanted):
        if isinstance(run, Unreadable) or (run is not None and wanted.fits(run)):
            yield run


def _summaries(paths: Sequence[Path], wanted: Filter) -> Iterator[Found | Unreadable | None]:
    """Read the manifests in order, several at a time: on a network share most of the time is spent
    waiting for it.
    """
    if len(paths) < AT_ONCE:
        yield from (summary_of(path, wanted) for path in paths)
        return
    from concurrent.futures import ThreadPoolExecutor  # a start looks at a few runs only

    with ThreadPoolExecutor(THREADS) as pool:
        for start in range(0, len(paths), AT_ONCE):  # no more than these after the last one wanted
            some = paths[start : start + AT_ONCE]
            yield from pool.map(summary_of, some, repeat(wanted))


def once(found: Iterable[Found]) -> tuple[list[Found], list[Copy]]:
    """Return each run once, in this order, and its other folders, those with a different manifest
    first. Every figure over runs counts a run once.

    Of several folders the one with the run's own name counts, else the first by name.
    """
    runs = list(found)
    by_run: dict[str, list[Found]] = {}
    for one in runs:
        by_run.setdefault(one.run, []).append(one)
    counted = {
        run: min(those, key=lambda one: (one.folder.name != one.run, one.folder.name))
        for run, those in by_run.items()
    }
    copies = [
        Copy(one.folder, its.folder, one.manifest_sha256 == its.manifest_sha256)
        for one in runs
        if (its := counted[one.run]) is not one
    ]
    return (
        [one for one in runs if counted[one.run] is one],
        sorted(copies, key=lambda one: one.is_same),
    )


def copies_texts(copies: Sequence[Copy]) -> list[str]:
    """Return a sentence for each of the first copies, and one for how many more there are."""
    more = len(copies) - MOST_COPIES
    are = "folder has a run" if more == 1 else "folders have runs"
    said = [f"{more} more {are} that another folder has; they do not count"] if more > 0 else []
    return [*map(str, copies[:MOST_COPIES]), *said]


def summary_of(folder: Path, wanted: Filter = ALL) -> Found | Unreadable | None:
    """Read a run's manifest; None if its bytes show that it does not match."""
    try:
        data = read_regular(folder / NAME, Kind.MANIFEST)
    except FileNotFoundError:
        return Unreadable(
            folder,
            "it has no manifest: cut off at its very start, or no run; `jbclog recover`"
            " finishes it",
        )
    except OSError as error:
        return Unreadable(folder, shortened(f"its manifest cannot be read: {error}", MOST_WHY))
    has_annotations = (folder / ANNOTATIONS).exists()
    return summary_in(
        data, folder, wanted, lambda: late_serials(folder), has_annotations=has_annotations
    )


def summary_in(
    data: bytes,
    folder: Path,
    wanted: Filter,
    late: Callable[[], Sequence[str]],
    *,
    has_annotations: bool,
) -> Found | Unreadable | None:
    """Return the summary of the manifest in `data`; None if it shows that the run does not match.
    `late` returns the serials that annotations of a sealed run add.
    """
    try:
        if wanted.had_ended(data):
            return None
        changed = why_changed(data)
        if changed is None and not wanted.may_be_in(data, has_annotations=has_annotations):
            return None
        is_old = OF_OLD_SCHEMA in data
        summary = _build_summary(with_new_keys(json_of(data))) if is_old else _read_summary(data)
        if summary.state not in set(RunState) or summary.schema > SCHEMA_VERSION:
            return Unreadable(folder, "its manifest is of a newer jbclog, or none")
        steps = [step.time for step in summary.clock_steps or ()]
        for time in (summary.start, summary.stop, *steps):
            expect_time(time)
        for station in summary.stations:
            expect_period(station.period_s)
        serials = late() if summary.state == SEALED else ()
        return _found(folder, summary, changed, hashlib.sha256(data).hexdigest(), serials)
    except (OSError, ValueError, AttributeError, RecursionError, RecordError) as error:
        return Unreadable(folder, shortened(f"its manifest cannot be read: {error}", MOST_WHY))


def _found(
    folder: Path, summary: _Summary, changed: str | None, sha256: str, late: Sequence[str]
) -> Found:
    state = summary.state if summary.state == SEALED else RUNNING if is_held(folder) else CRASHED
    metadata = summary.metadata
    serials = [
        *metadata.units,
        *(unit.unit for unit in summary.units),
        *late,
    ]
    return Found(
        folder=folder,
        run=summary.run,
        state=state,
        start=summary.start,
        stop=summary.stop,
        line=None if summary.line is None else summary.line.name,
        stations=tuple(station.name for station in summary.stations),
        recipes=tuple(f"{recipe.name}@{recipe.revision}" for recipe in summary.recipes),
        operator=metadata.operator,
        order=metadata.order,
        product=metadata.product,
        units=tuple(dict.fromkeys(serials)),
        wire_lots=tuple(metadata.wire_lots),
        flux_lots=tuple(metadata.flux_lots),
        tips=tuple(metadata.tips),
        tags=metadata.tags,
        verdict=summary.verdict,
        exit_status=summary.exit_status,
        exit_code=summary.exit_code,
        lost=None if summary.lost is None else summary.lost.text,
        changed=changed,
        clock_steps=tuple(summary.clock_steps or ()),
        periods_s={
            station.name: station.period_s
            for station in summary.stations
            if station.first_tick is not None
        },
        manifest_sha256=sha256,
    )


def runs_in(folder: Path) -> list[Path]:
    """Return the runs' folders directly below `folder` by name, or `folder` itself if it is one.
    Raises RecordError.
    """
    try:
        if RUN_NAME.fullmatch(Path(os.path.realpath(folder)).name) or (folder / NAME).exists():
            return [folder]
        return [folder / name for name in sorted(os.listdir(folder)) if _is_run(folder, name)]  # noqa: PTH208  # of 10 000 runs
    except OSError as error:
        raise RecordError(f"{folder} cannot be read: {error.strerror or error}") from error


def _is_run(home: Path, name: str) -> bool:
    """Whether it is a run's folder, by its name or, if renamed, by its content. A folder of another
    name that may not be entered is none: a disk has `lost+found`.
    """
    if RUN_NAME.fullmatch(name):
        return True
    with suppress(OSError):
        return (home / name / NAME).exists()
    return False


def _fits(sought: str, texts: Iterable[str | None]) -> bool:
    if "*" not in sought:
        return sought in texts
    pattern = re.compile(".*".join(map(re.escape, sought.split("*"))), re.DOTALL)
    return any(text is not None and pattern.fullmatch(text) for text in texts)
