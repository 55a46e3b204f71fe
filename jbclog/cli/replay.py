"""`jbclog replay`: serve a recorded run as virtual stations, or reproduce it without ports."""

from __future__ import annotations

import shlex
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
    from jbclog.sim.replayed_station import ReplayedStation
    from jbclog.transport.session_history import Divergence

SERVED_IN = Path("replayed")
DOUBTFUL = "The recording was changed: only blocks with a correct checksum are used."

UNSEALED = "not compared: the run is not sealed; finish it with `jbclog recover`"
SAME = "decoded tables are equal"


@reports_errors
def replay(
    run: Path = options.RUN,
    folder: Path | None = typer.Option(
        None,
        "--dir",
        metavar="DIR",
        help=f"Folder for ports and line file.  [default: {SERVED_IN}]",
    ),
    tcp: str | None = options.TCP,
    out: Path | None = typer.Option(
        None, "--record", metavar="DIR", help="Reproduce the run at once below DIR and compare."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Replay a run recorded with --capture, or reproduce it.

    Serves virtual stations that answer with the recorded bytes after the recorded time, including
    corrupt, late and missing answers and lost links. A station gives no answer from after a
    recorded write until that write comes. A repeated query gets the previous answer; the end shows
    how many. DIR/line.toml is the line file for `run`: its path is the first line of stdout; the
    command that records the run again is printed on stderr.

    A run recorded from served stations has the same settings, counters, kinds of events and fast
    signals on each tick. These may
    differ: times, how late a tick was and how long its scan took; the row of a slow reading, which
    is taken when the link is free; and, with corrupt, late or lost answers, the few ticks that such
    a reading delays. With --rate max the number of rows may differ.

    --record uses no ports and does not wait: it reproduces the samples, events, settings and
    counters of all stations to the last row, except when rows were written and the recorder's own
    events, and prints how many rows were compared. Exit code 1: a difference, nothing compared, or
    captures that hold less than a run that was not cut off. The last line of stdout is the new run
    folder.

    \b
    Example:
      jbclog replay runs/20261121T013000Z-bench-3-k7qd --record again
    """
    from jbclog.app.replay import open_recording

    if not is_folder(run):
        raise UsageError(NO_FOLDER.format(run))
    if out is not None and (folder, tcp) != (None, None):
        raise UsageError("--record serves no stations: omit --dir and --tcp")
    recording = open_recording(run)
    doubts = recording.doubts
    note(*doubts)
    if doubts:
        note(DOUBTFUL)
    if out is None:
        _serve(recording, folder or SERVED_IN, tcp)
    else:
        raise typer.Exit(_record(recording, out, doubts, as_json=as_json))


# -- serve -----------------------------------------------------------------------------------------


def _serve(recording: Recording, folder: Path, tcp: str | None) -> None:
    from jbclog.app.replay import serve
    from jbclog.config.line import is_this_host
    from jbclog.sim.setup import SERVED_LINE, tcp_of

    served_on = tcp_of(tcp) if tcp else None
    if served_on is not None and not is_this_host(served_on[0]):
        raise UsageError(f"--tcp {tcp}: must be on this machine, such as 127.0.0.1:PORT")
    server, stations = serve(recording, folder, served_on)
    server.stop_on_signals()
    echo(str(folder / SERVED_LINE))
    count = len(stations)
    note(
        f"{count} recorded station{' is' if count == 1 else 's are'} ready; stop with Ctrl-C. In"
        " another terminal:"
    )
    note(f"  {shlex.join(_command(recording, folder / SERVED_LINE))}")
    server.run()
    for station in stations:
        _print_misses(station)


def _command(recording: Recording, line: Path) -> list[str]:
    """Return the command that repeats the run. Known rates are in the line file."""
    from jbclog.app.replay import plan_of

    plan, metadata = plan_of(recording), recording.metadata
    rate = None if recording.rates_hz else recording.first.rate
    options = [("--rate", f"{rate:g}" if isinstance(rate, float) else rate)]
    options += [
        ("--duration", None if recording.sampled_s is None else f"{recording.sampled_s:g}s")
    ]
    options += [
        ("--operator", metadata.operator),
        ("--order", metadata.order),
        ("--product", metadata.product),
    ]
    options += [("--unit", unit) for unit in metadata.units] + [
        ("--tag", f"{name}={text}") for name, text in metadata.tags.items()
    ]
    options += [("--wire-lot", lot) for lot in metadata.wire_lots] + [
        ("--flux-lot", lot) for lot in metadata.flux_lots
    ]
    options += [("--tip", tip) for tip in metadata.tips]
    words = [
        "jbclog",
        "run",
        "--line",
        str(line),
        *(word for name, text in options if text for word in (name, text)),
    ]
    return (
        words
        + ["--allow-omega-write"] * plan.wanted.allow_omega_write
        + ["--allow-missing"] * plan.wanted.allow_missing
    )


def _print_misses(station: ReplayedStation) -> None:
    if station.strange:
        note(f"{station.name}: {_queries(station.strange)} not in the recording, and got no answer")
    if again := sum(station.repeated.values()):
        note(
            f"{station.name}: {_queries(again)} came more often than recorded, and got the previous"
            " answer"
        )
    if station.left_out:
        note(
            f"{station.name}: {_queries(station.left_out)} of the recording did not come; the"
            " answers were skipped"
        )


def _queries(count: int) -> str:
    return "1 query" if count == 1 else f"{count} queries"


# -- reproduce -------------------------------------------------------------------------------------


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
            "not proven: the captures hold less than the run"
            if held.uncompared
            else "not proven: a session left its recording"
        )


def _divergence_text(name: str, astray: Divergence, recording: Recording) -> str:
    after = f"{astray.at_s - recording.first.t0_mono:.1f} s after the run's start"
    if astray.is_cut_off:
        return f"{name}: the recording ends {after}, before its session"
    return f"{name}: left the recording {after}: this version acts differently ({astray})"
