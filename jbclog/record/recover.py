"""Finish runs that a crash left open.

A crash can leave an empty folder, inputs without a manifest, a live store with some of its rows
already sealed, or a sealed run whose store was not removed. `recover` brings all of them to the
same sealed form; the manifest states what is missing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final

from jbclog.core.disk_space import write_failure, write_failure_below
from jbclog.core.errors import Problems, RecordError, Unsafe
from jbclog.core.locks import FolderLock, commit_status
from jbclog.core.rows import TABLES, StationFacts
from jbclog.core.text import count_text
from jbclog.record import capture, clock_steps, guard_actions, parts, sealed_files
from jbclog.record.capture_file import NOT_OURS
from jbclog.record.conclude import (
    NOT_KEPT,
    TOOK_OVER,
    conclude,
    hot_events,
    hot_warning,
    last_micros,
    live_files,
    remove_live,
    sealed_file,
    stations_of,
    unkept_rows,
    unknown_tools,
    with_unknown,
)
from jbclog.record.folder import RUN_NAME, expect_no_links, recipe_copies
from jbclog.record.live import AT_RISK_S
from jbclog.record.manifest import (
    NAME,
    Lost,
    Manifest,
    NoManifest,
    RunState,
    SealedFile,
    read_manifest,
    wrong_digest,
)
from jbclog.record.parts import part_paths, read_through, remove_leavings, remove_unfinished
from jbclog.record.seal import seal_rows
from jbclog.record.store import refuse_newer, segments
from jbclog.record.store_reader import StoreReader


def changed_parts(folder: Path, manifest: Manifest) -> dict[str, str]:
    """Return the parts of a manifest that differ from their sealed state, each with the reason."""
    found = {}
    for listed in manifest.files:
        if listed.path.partition("/")[0] in TABLES:
            why = _difference(folder, listed)
            if why:
                found[listed.path] = why
    return found


def _difference(folder: Path, listed: SealedFile) -> str | None:
    path = folder / listed.path
    try:
        if not path.is_file():
            return "is missing"
        return (
            None
            if sealed_file(folder, path, None).sha256 == listed.sha256
            else "was changed after it was sealed"
        )
    except (OSError, ValueError) as error:  # not ours to read; a name that no file can have
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"


def set_parts_aside(folder: Path, manifest: Manifest) -> None:
    """Set unreadable and changed parts aside and note them; their rows are sealed again as far as
    the live store has them.
    """
    wrong = changed_parts(folder, manifest)
    for table in TABLES:
        for path in part_paths(folder, table):
            name = f"{table}/{path.name}"
            why = wrong.pop(name, None) or _unreadable(path)
            if why:
                parts.note_damage(folder, [parts.Damage(name, None, why)])
                parts.set_aside(folder, path)
    parts.note_damage(folder, [parts.Damage(name, None, why) for name, why in wrong.items()])


def _unreadable(path: Path) -> str | None:
    try:
        read_through(path)
    except (OSError, RecordError) as error:
        return f"cannot be read: {sealed_files.portable(error, path)}"
    return None


PATIENCE_S: Final = 10.0  # for a sealing child that outlived its recorder
FINISHED: Final = "already finished; nothing was changed."
NOT_REBUILT: Final = (
    "No live store is left to rebuild it from; `jbclog check` lists what else is wrong."
)
EXIT_CODE: Final = RecordError.exit_code


class Outcome(StrEnum):
    """What `recover` did with a folder."""

    RECOVERED = "recovered"
    WHOLE = "finished already"
    REFUSED = "left alone"


@dataclass(frozen=True, slots=True)
class Recovery:
    """The result for one run: a sentence in `text`; in `rows` the sealed rows by table and lines of
    captures.

    `is_safe` is False if the record shows a tool that may still be hot.
    """

    folder: Path
    outcome: Outcome
    text: str
    rows: Mapping[str, int] = field(default_factory=dict)
    is_safe: bool = True


def is_run(folder: Path) -> bool:
    """Whether `folder` is a run's folder, also one that a crash left empty. One of another name
    that may not be entered is none.
    """
    with suppress(OSError):
        return folder.is_dir() and (
            bool(RUN_NAME.fullmatch(folder.name))
            or (folder / NAME).exists()
            or bool(segments(folder))
        )
    return False


def recover_all(folder: Path, patience_s: float = PATIENCE_S) -> list[Recovery]:
    """Recover the run in `folder`, or every run directly below it; a refusal does not stop the
    others.
    """
    runs = [folder] if is_run(folder) else sorted(path for path in folder.iterdir() if is_run(path))
    return [_tried(run, patience_s) for run in runs]


def _tried(folder: Path, patience_s: float) -> Recovery:
    try:
        return recover(folder, patience_s)
    except RecordError as error:
        return Recovery(folder, Outcome.REFUSED, str(error))
    except OSError as error:
        text = f"{folder} cannot be recovered: {write_failure(error, folder)}"
        return Recovery(folder, Outcome.REFUSED, text)


def recover(folder: Path, patience_s: float = PATIENCE_S) -> Recovery:
    """Finish the run in `folder`.

    Raises `RecordError`, and leaves the record unchanged, if the run is being written, is of a
    newer jbclog, or the disk fails.
    """
    if not is_run(folder):
        raise RecordError(f"{folder} is not a run")
    expect_no_links(folder)
    manifest = _draft(folder)
    if manifest.is_sealed and not live_files(folder):
        return _recovery(
            folder,
            Outcome.WHOLE,
            f"{folder.name}: {FINISHED}{_not_rebuilt(folder, manifest)}",
            manifest,
        )
    refuse_newer(folder)
    lock = FolderLock.take(folder, patience_s)
    try:
        with guard_actions.without_guard(folder, patience_s):
            manifest = _draft(folder)  # the recorder may have finished while we waited
            if manifest.is_sealed and not changed_parts(folder, manifest):
                remove_live(folder, lock)
                text = f"{folder.name}: already sealed; its live store is now removed."
                return _recovery(folder, Outcome.RECOVERED, text, manifest)
            return _finish(folder, manifest, lock)
    except OSError as error:
        why = write_failure_below(error, folder)
        raise RecordError(f"{folder} cannot be recovered: {why}") from error
    finally:
        lock.release()


def _not_rebuilt(folder: Path, manifest: Manifest) -> str:
    """Describe damaged parts of a sealed run, which nothing can rebuild; empty for none."""
    found = [f"{name} {why}" for name, why in changed_parts(folder, manifest).items()]
    return f" But {'; '.join(found)}. {NOT_REBUILT}" if found else ""


def _finish(folder: Path, manifest: Manifest, lock: FolderLock) -> Recovery:
    remove_leavings(folder)
    remove_unfinished(folder)
    set_parts_aside(folder, manifest)
    manifest = replace(manifest, state=RunState.OPEN, files=[], wire=_wire(folder, manifest))
    seal_rows(folder)
    by_guard = guard_actions.on_run_clock(
        guard_actions.action_log(folder), clock_steps.steps_of(folder)
    )
    guard_actions.take_in(folder, manifest.run, [*by_guard])
    manifest = replace(manifest, guard="lost" if guard_actions.was_lost(folder) else manifest.guard)
    with StoreReader(folder) as store:
        _note_missing_end(folder, store.last)
        stations = _note_left_hot(folder, manifest, store)
        manifest = _outcome(
            folder, manifest, store, is_safe=not any(facts.unsafe for facts in stations)
        )
    sealed = conclude(folder, manifest, lock)
    rows = rows_of(sealed)
    text = (
        f"{folder.name}: recovered, {_counted(rows)} sealed; exit status {sealed.exit_status},"
        f" verdict {sealed.verdict}."
    )
    text += f" {sealed.wire}" if sealed.wire is not None and NOT_OURS in sealed.wire else ""
    unsafe = [facts.name for facts in sealed.stations if facts.unsafe]
    return _recovery(
        folder,
        Outcome.RECOVERED,
        text + (f" {sealed.lost.text}" if sealed.lost else ""),
        sealed,
        rows,
        unsafe,
    )


def _recovery(
    folder: Path,
    outcome: Outcome,
    text: str,
    manifest: Manifest,
    rows: Mapping[str, int] = MappingProxyType({}),
    unsafe: Collection[str] = (),
) -> Recovery:
    warning = hot_warning(folder, manifest.stations, unsafe)
    return Recovery(folder, outcome, f"{text} {warning}".rstrip(), rows, is_safe=not warning)


def _note_left_hot(folder: Path, manifest: Manifest, store: StoreReader) -> list[StationFacts]:
    """Add an event for each tool whose safe state is unknown; return stations' facts with it."""
    stations = stations_of(folder, store, manifest)
    unknown = unknown_tools(folder, stations, manifest.guard)
    guard_actions.take_in(folder, manifest.run, hot_events(unknown, last_micros(folder) or 0))
    return with_unknown(stations, unknown)


def rows_of(manifest: Manifest) -> dict[str, int]:
    """Return the number of sealed rows by table, and of capture lines if it was captured."""
    found: Counter[str] = Counter(dict.fromkeys(TABLES, 0))
    for file in manifest.files:
        found[file.path.partition("/")[0]] += file.rows or 0
    names = (*TABLES, capture.FOLDER) if manifest.wire is not None else TABLES
    return {name: found[name] for name in names}


def _counted(rows: Mapping[str, int]) -> str:
    counted = [f"{count} {_named(name, count)}" for name, count in rows.items()]
    return f"{', '.join(counted[:-1])} and {counted[-1]}"


def _named(name: str, count: int) -> str:
    several = "lines of serial capture" if name == capture.FOLDER else name
    return (
        several
        if count != 1
        else "line of serial capture"
        if name == capture.FOLDER
        else name.removesuffix("s")
    )


def _draft(folder: Path) -> Manifest:
    """Return the manifest as the recorder left it, or an empty one if there is none."""
    if not (folder / NAME).exists():
        return Manifest(run=folder.name)
    try:
        manifest = read_manifest(folder)
        digest = wrong_digest(folder)
        if digest:
            raise NoManifest(f"{folder / NAME} {digest}")
        return manifest
    except NoManifest as error:
        if not live_files(folder):
            raise
        parts.note_damage(
            folder,
            [parts.Damage(NAME, None, f"cannot be read; rewritten from the live store: {error}")],
        )
        parts.set_aside(folder, folder / NAME)
        return Manifest(run=folder.name)


def _outcome(folder: Path, manifest: Manifest, store: StoreReader, *, is_safe: bool) -> Manifest:
    """Complete the manifest with the end that the recorder could not write."""
    found = parts.read_damage(folder)
    if store.was_closed and manifest.exit_status is not None and not found:
        return manifest  # the run ended properly; only its sealing was interrupted
    return replace(
        manifest,
        exit_status="lost",
        exit_code=EXIT_CODE if is_safe else Unsafe.exit_code,
        verdict="INCONCLUSIVE" if _was_to_be_judged(folder, manifest) else "NOT JUDGED",
        lost=_lost(found, store),
    )


def _lost(found: list[parts.Damage], store: StoreReader) -> Lost:
    unkept = unkept_rows(store)
    if store.was_closed and not found and not unkept:
        return Lost(
            0.0, "The recorder ended before it could write the run's result; no row is missing."
        )
    ends = [one.seconds for one in found if one.seconds is not None]
    text, at_risk_s = "The recorder ended without closing the record.", _at_risk_s(store.folder)
    if len(ends) == len(found) and not unkept:
        seconds = at_risk_s + sum(ends)
        return Lost(seconds, f"{text} At most the last {seconds:g} s of it are missing.")
    pieces = parts.summary_of(found) + (
        [f"{count_text(unkept, 'row')} {NOT_KEPT}"] if unkept else []
    )
    return Lost(
        None, f"{text} The last {at_risk_s:g} s of it may be missing, and: {'; '.join(pieces)}."
    )


def _at_risk_s(folder: Path) -> float:
    """Return the longest time that rows can have waited for their commit, in seconds.

    The guard's log has the recorder's end, and with it the length of the last wait.
    """
    said = commit_status(folder)
    ended = [
        event.time / 1e6 for event in guard_actions.action_log(folder) if event.kind == TOOK_OVER[0]
    ]
    last = ended[0] - said.since if ended and said.since is not None else 0.0
    return math.ceil(max(AT_RISK_S, said.risk_s, last) * 10) / 10


def _was_to_be_judged(folder: Path, manifest: Manifest) -> bool:
    """Return True if a recipe of the run sets limits. An unreadable recipe counts as one that
    does.
    """
    if manifest.verdict is not None:
        return manifest.verdict != "NOT JUDGED"
    try:
        return any("acceptance" in tables for tables in recipe_copies(folder))
    except (OSError, Problems):
        return True


def _wire(folder: Path, manifest: Manifest) -> str | None:
    """Cut incomplete ends off the serial captures; return what they lack, `WHOLE` for nothing, None
    without captures.
    """
    paths = capture.wire_paths(folder)
    if not paths:
        return None if manifest.wire is None else "The recorder ended before the capture began."
    return " ".join(text for path in paths for text in _lacking(path)) or capture.WHOLE


def _lacking(path: Path) -> Iterator[str]:
    name = f"{capture.FOLDER}/{path.name}"
    try:
        cut = capture.mend(path)
        if cut:
            yield f"{name}: the last {cut} bytes were an incomplete block and were cut off."
        if not path.stat().st_size:
            path.unlink()
            yield f"{name}: empty."
            return
        found = [*sealed_files.losses(path)]
        yield from (f"{name}: {text}." for text in found)
        if not any(NOT_OURS in text for text in found) and not capture.is_done(path):
            yield (
                f"{name} ends before its session: at most the last {AT_RISK_S:g} s are missing, or"
                " what wire.failed says."
            )
    except OSError as error:
        yield f"{name} cannot be read: {error.strerror or error}."


def _note_missing_end(folder: Path, last: int) -> None:
    """Note acknowledged batches that the store lacks: the end of SQLite's log is lost."""
    missing = commit_status(folder).last - last
    if missing > 0:
        which = f"batches {last + 1} to {last + missing}"
        parts.note_damage(
            folder,
            [
                parts.Damage(
                    which,
                    None,
                    "acknowledged, but missing from the live store",
                    missing * AT_RISK_S,
                )
            ],
        )
