"""Finish runs that a crash left open.

A crash can leave an empty folder, inputs without a manifest, a journal of which some segments are
sealed already, or a sealed run whose journal was not removed. `recover` brings all of them to the
same sealed form; the manifest states what is missing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final

from jbclog.core.disk_space import write_failure, write_failure_below
from jbclog.core.errors import Problems, RecordError, Unsafe
from jbclog.core.locks import FolderLock
from jbclog.core.rows import TABLES, StationFacts
from jbclog.core.text import count_text
from jbclog.record import clock_steps, guard_actions, sealed_files, wire
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
from jbclog.record.damage import Damage, note_damage, read_damage, set_aside, summary_of
from jbclog.record.folder import RUN_NAME, expect_no_links, recipe_copies
from jbclog.record.journal_reader import OLD_STORE, Journal, refuse_newer, refuse_old_store
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
from jbclog.record.part_chain import NAME as PARTS
from jbclog.record.part_chain import PartChain
from jbclog.record.part_writer import describe_part
from jbclog.record.parts import part_number, part_paths, remove_leavings, remove_unfinished
from jbclog.record.run_journal import AT_RISK_S
from jbclog.record.schema import CAPTURE, SCHEMAS
from jbclog.record.seal import seal_journal
from jbclog.record.segments import segments


def changed_parts(folder: Path, files: Iterable[SealedFile]) -> dict[str, str]:
    """Return those of the parts in `files` that differ from their sealed state, each with the
    reason.
    """
    found = {}
    for listed in files:
        if listed.path.partition("/")[0] in SCHEMAS:
            why = _difference(folder, listed)
            if why:
                found[listed.path] = why
    return found


def _difference(folder: Path, listed: SealedFile) -> str | None:
    path = folder / listed.path
    try:
        if not path.is_file():
            return "is missing"
        if sealed_file(folder, path, None).sha256 != listed.sha256:
            return "was changed after it was sealed"
    except (OSError, ValueError) as error:  # not ours to read; a name that no file can have
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    return None


def _set_parts_aside(folder: Path) -> None:
    """Set changed parts aside and note them; their rows are sealed again if the segment is still
    there.
    """
    chain = PartChain(folder)
    for name, why in changed_parts(folder, (part.file for part in chain.parts)).items():
        path = folder / name
        rows = next(part.file.rows for part in chain.parts if part.file.path == name)
        note_damage(folder, [Damage(name, rows, why)])
        if path.exists():
            set_aside(folder, path)


def _adopt_parts(folder: Path) -> None:
    """Add parts to the chain of which it has lost the line: their segments are not there."""
    chain = PartChain(folder)
    note_damage(folder, [Damage(PARTS, None, text) for text in chain.damage])
    known = {part.file.path for part in chain.parts}
    for table in SCHEMAS:
        for path in part_paths(folder, table):
            if f"{table}/{path.name}" in known:
                continue
            try:
                chain.add(part_number(path), describe_part(path))
            except RecordError as error:
                why = f"cannot be read: {sealed_files.portable(error, path)}"
                note_damage(folder, [Damage(f"{table}/{path.name}", None, why)])
                set_aside(folder, path)


PATIENCE_S: Final = 10.0  # for a sealing child that outlived its recorder
FINISHED: Final = "already finished; nothing was changed."
NOT_REBUILT: Final = (
    "No journal is left to rebuild it from; `jbclog check` lists what else is wrong."
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
            or (folder / OLD_STORE).exists()
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
    refuse_old_store(folder)
    manifest = _draft(folder)
    if manifest.is_sealed and not live_files(folder):
        return _recovery(
            folder,
            Outcome.WHOLE,
            f"{folder.name}: {FINISHED}{_not_rebuilt(folder, manifest)}",
            manifest,
        )
    with Journal(folder) as journal:
        refuse_newer(journal)
    lock = FolderLock.take(folder, patience_s)
    try:
        with guard_actions.without_guard(folder, patience_s):
            manifest = _draft(folder)  # the recorder may have finished while we waited
            if manifest.is_sealed and not changed_parts(folder, manifest.files):
                remove_live(folder, lock)
                text = f"{folder.name}: already sealed; its journal is now removed."
                return _recovery(folder, Outcome.RECOVERED, text, manifest)
            return _finish(folder, manifest, lock)
    except OSError as error:
        why = write_failure_below(error, folder)
        raise RecordError(f"{folder} cannot be recovered: {why}") from error
    finally:
        lock.release()


def _not_rebuilt(folder: Path, manifest: Manifest) -> str:
    """Describe damaged parts of a sealed run, which nothing can rebuild; empty for none."""
    found = [f"{name} {why}" for name, why in changed_parts(folder, manifest.files).items()]
    return f" But {'; '.join(found)}. {NOT_REBUILT}" if found else ""


def _finish(folder: Path, manifest: Manifest, lock: FolderLock) -> Recovery:
    remove_leavings(folder)
    remove_unfinished(folder)
    _set_parts_aside(folder)
    manifest = replace(manifest, state=RunState.OPEN, files=[])
    seal_journal(folder)
    _adopt_parts(folder)
    manifest = replace(manifest, wire=_capture(folder, manifest))
    by_guard = guard_actions.on_run_clock(
        guard_actions.action_log(folder), clock_steps.steps_of(folder)
    )
    guard_actions.take_in(folder, manifest.run, [*by_guard])
    manifest = replace(manifest, guard="lost" if guard_actions.was_lost(folder) else manifest.guard)
    with Journal(folder) as journal:
        stations = _note_left_hot(folder, manifest, journal)
        manifest = _outcome(
            folder, manifest, journal, is_safe=not any(facts.unsafe for facts in stations)
        )
    sealed = conclude(folder, manifest, lock)
    rows = rows_of(sealed)
    text = (
        f"{folder.name}: recovered, {_counted(rows)} sealed; exit status {sealed.exit_status},"
        f" verdict {sealed.verdict}."
    )
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


def _note_left_hot(folder: Path, manifest: Manifest, journal: Journal) -> list[StationFacts]:
    """Add an event for each tool whose safe state is unknown; return stations' facts with it."""
    stations = stations_of(folder, journal, manifest)
    unknown = unknown_tools(folder, stations, manifest.guard)
    events = hot_events(unknown, last_micros(folder) or 0)
    guard_actions.take_in(folder, manifest.run, events)
    return with_unknown(stations, unknown)


def rows_of(manifest: Manifest) -> dict[str, int]:
    """Return the number of sealed rows by table, and of the capture if there is one."""
    found: Counter[str] = Counter(dict.fromkeys(TABLES, 0))
    for file in manifest.files:
        found[file.path.partition("/")[0]] += file.rows or 0
    names = (*TABLES, CAPTURE) if manifest.wire is not None else TABLES
    return {name: found[name] for name in names}


def _counted(rows: Mapping[str, int]) -> str:
    counted = [f"{count} {_named(name, count)}" for name, count in rows.items()]
    return f"{', '.join(counted[:-1])} and {counted[-1]}"


def _named(name: str, count: int) -> str:
    if name == CAPTURE:
        return "row of serial capture" if count == 1 else "rows of serial capture"
    return name.removesuffix("s") if count == 1 else name


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
        why = f"cannot be read; rewritten from the journal: {error}"
        note_damage(folder, [Damage(NAME, None, why)])
        set_aside(folder, folder / NAME)
        return Manifest(run=folder.name)


def _outcome(folder: Path, manifest: Manifest, journal: Journal, *, is_safe: bool) -> Manifest:
    """Complete the manifest with the end that the recorder could not write."""
    damage = read_damage(folder)
    was_closed = journal.notes.get("closed") is True
    if was_closed and manifest.exit_status is not None and not damage:
        return manifest  # the run ended properly; only its sealing was interrupted
    return replace(
        manifest,
        exit_status="lost",
        exit_code=EXIT_CODE if is_safe else Unsafe.exit_code,
        verdict="INCONCLUSIVE" if _was_to_be_judged(folder, manifest) else "NOT JUDGED",
        lost=_lost(damage, journal, manifest, was_closed=was_closed),
    )


def _lost(damage: list[Damage], journal: Journal, manifest: Manifest, *, was_closed: bool) -> Lost:
    unkept = unkept_rows(journal)
    pieces = summary_of(damage)
    if unkept:
        pieces.append(f"{count_text(unkept, 'row')} {NOT_KEPT}")
    if was_closed and not pieces:
        return Lost(
            0.0, "The recorder ended before it could write the run's result; no row is missing."
        )
    text = "The recorder ended without closing the record."
    if manifest.start is not None and not (journal.notes or journal.chain.parts or pieces):
        return Lost(None, f"{text} The journal holds nothing of it.")
    at_risk_s = _at_risk_s(journal)
    if not pieces:
        return Lost(at_risk_s, f"{text} At most the last {at_risk_s:g} s of it are missing.")
    return Lost(
        None, f"{text} The last {at_risk_s:g} s of it may be missing, and: {'; '.join(pieces)}."
    )


def _at_risk_s(journal: Journal) -> float:
    """Return the longest time that rows can have waited for their commit, in seconds.

    The recorder notes how long they waited before. The guard's log has the recorder's end, and with
    it the length of the last wait.
    """
    noted = journal.notes.get("risk_s")
    waits_s = [AT_RISK_S, noted if isinstance(noted, int | float) else 0.0]
    ended = [
        event.time
        for event in guard_actions.action_log(journal.folder)
        if event.kind == TOOK_OVER[0]
    ]
    if ended and journal.last_mark is not None:
        waits_s.append((ended[0] - journal.last_mark.utc_us) / 1e6)
    return math.ceil(max(waits_s) * 10) / 10


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


def _capture(folder: Path, manifest: Manifest) -> str | None:
    """Return what the sealed capture lacks, `WHOLE` for nothing, None for a run without one."""
    if not part_paths(folder, CAPTURE):
        return None if manifest.wire is None else "The recorder ended before the capture began."
    try:
        lacking = wire.losses(folder)
    except RecordError as error:
        return f"The serial capture cannot be read: {sealed_files.portable(error, folder)}."
    if not lacking:
        return wire.WHOLE
    return (
        f"The serial capture is not whole: {'; '.join(lacking)}. At most the last"
        f" {AT_RISK_S:g} s are missing, more if the power failed, or what wire.failed says."
    )
