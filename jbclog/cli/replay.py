"""`jbclog replay`: reproduce a recorded run from its captures, without ports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import NO_FOLDER, is_folder
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.replay import Again, Held, Recording
    from jbclog.core.goal import Goal
    from jbclog.core.rows import EventRow
    from jbclog.session.run.context import SessionContext
    from jbclog.transport.session_history import Divergence

DOUBTFUL = "The recording was changed: only blocks with a correct checksum are used."

UNSEALED = "not compared: the run is not sealed; finish it with `jbclog recover`"
SAME = "decoded tables are equal"


@reports_errors
def replay(
    run: Path = options.RUN,
    out: Path = typer.Option(
        ..., "--record", metavar="DIR", help="Folder below which the reproduced run is recorded."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Reproduce a run recorded with --capture, and compare it.

    Uses no ports and does not wait: the sessions get the recorded bytes and results again, and
    jbclog compares samples, events, settings and counters of all stations to the last row, except
    when rows were written and the recorder's own events. Prints how many rows were compared. Where
    this version asks a station something else than the recording has, the session ends.

    Exit code 1: a difference, nothing compared, a session that left its recording, or captures that
    hold less than a run that was not cut off. The last line of stdout is the new run folder.

    \b
    Example:
      jbclog replay runs/20261121T013000Z-bench-3-k7qd --record again
    """
    from jbclog.app.replay import open_recording

    if not is_folder(run):
        raise UsageError(NO_FOLDER.format(run))
    recording = open_recording(run)
    doubts = recording.doubts
    note(*doubts)
    if doubts:
        note(DOUBTFUL)
    raise typer.Exit(_record(recording, out, doubts, as_json=as_json))


class _Silent:
    """Observer that shows nothing: the events were shown when the run was recorded."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext], goals: Sequence[Goal]) -> None: ...

    def sealing(self) -> None: ...


def _record(recording: Recording, out: Path, doubts: Sequence[str], *, as_json: bool) -> int:
    from jbclog.app.replay import compare, record_again

    again = record_again(recording, out, _Silent())
    held = compare(recording, again)
    left = [_divergence_text(name, astray, recording) for name, astray in again.left.items()]
    if as_json:
        echo_json(
            {
                "run": str(again.result.folder),
                **_held_json(held),
                "left": left,
                "doubts": list(doubts),
            }
        )
    else:
        _print(again, held, left)
    return 0 if held is not None and held.is_same and not doubts else 1


def _held_json(held: Held | None) -> dict[str, object]:
    if held is None:
        return {"same": False, "differences": None, "compared": None, "uncompared": [UNSEALED]}
    compared = {
        table: {"rows": rows, "recorded": recorded}
        for table, (rows, recorded) in held.counts.items()
    }
    found = {
        "differences": held.comparison.differences,
        "compared": compared,
        "uncompared": held.uncompared,
    }
    return {"same": held.is_same, **found}


def _print(again: Again, held: Held | None, left: Sequence[str]) -> None:
    note(*left)
    if held is None:
        note(UNSEALED)
    else:
        _print_held(held)
    echo(str(again.result.folder))


def _print_held(held: Held) -> None:
    differences = held.comparison.differences
    echo(*differences)
    note(*held.uncompared)
    note(held.compared)
    if held.is_same:
        note(f"{SAME}, as far as the captures of the cut-off run reach" if held.lacking else SAME)
    elif differences:
        note(f"{len(differences)} differences")
    else:
        note(
            "not proven: a session left its recording"
            if held.left
            else "not proven: the captures hold less than the run"
        )


def _divergence_text(name: str, astray: Divergence, recording: Recording) -> str:
    after = f"{astray.at_s - recording.first.t0_mono:.1f} s after the run's start"
    if astray.is_cut_off:
        return f"{name}: the recording ends {after}, before its session"
    return f"{name}: left the recording {after}: this version acts differently ({astray})"
