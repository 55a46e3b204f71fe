"""`jbclog replay`: a recorded run once more, as virtual stations or at once."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import is_folder
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.replay import Again, Held, Recording
    from jbclog.core.rows import EventRow
    from jbclog.session.run.context import SessionContext
    from jbclog.sim.replayed_station import ReplayedStation
    from jbclog.transport.session_history import Divergence

SERVED_IN = Path("replayed")
DOUBTFUL = "The recording is not as it was made: what follows rests on those blocks of it alone whose own check sums hold."

UNSEALED = "nothing was compared: the run is not sealed; `jbclog recover` finishes it"
SAME = "the same decoded tables"


@ends_with_errors_told
def replay(
    run: Path = options.RUN,
    folder: Path | None = typer.Option(
        None, "--dir", metavar="DIR", help=f"Where the ports and the line file are made.  [default: {SERVED_IN}]"
    ),
    tcp: str | None = typer.Option(None, metavar="HOST:PORT", help="Serve on TCP, a port a station from this one on."),
    out: Path | None = typer.Option(
        None, "--record", metavar="DIR", help="Serve nothing: live through the run at once, record that below DIR, and compare."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Serve a run recorded with --wire as virtual stations.

    Each answers as it did then: with the same bytes after the same time, corrupt, late, or not at all; a link that was lost
    is lost again. No answer from behind a recorded write is given before that write comes; a question that comes once more
    than then gets the last answer before it, and the end shows how often. DIR/line.toml is the line file for `run`;
    its path is the first line of stdout, and the call that records the run again stands on stderr.

    A run recorded from served stations has the same settings, counters and kinds of events, and on each tick the same fast
    signals. What may differ: times, how late a tick was and how long its scan took; the row of a slow signal's reading, and
    whether the last one falls behind the end, for a slow signal is read when the link has time, which is a matter of a
    millisecond; and with corrupt, late or lost answers, the few ticks at which such a slow reading takes the time of the next.
    Of a run with --rate max the number of rows may differ.

    With --record there are no ports and no waiting. The run is lived through on its own clock, and its tables come out the
    same to the last row: samples, events, settings and counters of all stations, but for the moments at which rows were
    written and the events of the recorder itself. It says how many rows were compared. The exit code is 1 where anything
    differs, where nothing was compared, and where the wires kept less than the run, unless the run itself was cut off. The
    last line of stdout is the new run's folder.

    \b
    Example:
      jbclog replay runs/20261121T013000Z-bench-3-k7qd --record again
    """
    from jbclog.app.replay import open_recording

    if not is_folder(run):
        raise UsageError(f"{run}: there is no such folder; runs are in `runs/`, or where --out put them")
    if out is not None and (folder, tcp) != (None, None):
        raise UsageError("--record serves nothing: leave out --dir and --tcp")
    recording = open_recording(run)
    doubts = recording.doubts
    for text in doubts:
        note(text)
    if doubts:
        note(DOUBTFUL)
    if out is None:
        _serve(recording, folder or SERVED_IN, tcp)
    else:
        raise typer.Exit(_record(recording, out, doubts, as_json=as_json))


# -- on ports -------------------------------------------------------------------------------------------------------------------


def _serve(recording: Recording, folder: Path, tcp: str | None) -> None:
    from jbclog.app.replay import serve
    from jbclog.config.line import is_this_host
    from jbclog.sim.setup import SERVED_LINE, tcp_of

    served_on = tcp_of(tcp) if tcp else None
    if served_on is not None and not is_this_host(served_on[0]):
        raise UsageError(f"--tcp {tcp}: a recorded run is served on this machine only, as 127.0.0.1:PORT")
    server, stations = serve(recording, folder, served_on)
    server.stop_on_signals()
    tell(str(folder / SERVED_LINE))
    count = len(stations)
    note(f"{count} recorded station{' is' if count == 1 else 's are'} ready; Ctrl-C ends this. In another terminal:")
    note(f"  {shlex.join(_command(recording, folder / SERVED_LINE))}")
    server.run()
    for station in stations:
        _tell_misses(station)


def _command(recording: Recording, line: Path) -> list[str]:
    """The run that asks for the same as then. The line file has the rates that came of it, as far as they are known."""
    from jbclog.app.replay import plan_of

    plan, told = plan_of(recording), recording.metadata
    rate = None if recording.rates_hz else recording.first.rate
    options = [("--rate", f"{rate:g}" if isinstance(rate, float) else rate)]
    options += [("--duration", None if recording.sampled_s is None else f"{recording.sampled_s:g}s")]
    options += [("--operator", told.operator), ("--order", told.order), ("--product", told.product)]
    options += [("--unit", unit) for unit in told.units] + [("--tag", f"{name}={text}") for name, text in told.tags.items()]
    options += [("--wire-lot", lot) for lot in told.wire_lots] + [("--flux-lot", lot) for lot in told.flux_lots]
    options += [("--tip", tip) for tip in told.tips]
    words = ["jbclog", "run", "--line", str(line), *(word for name, text in options if text for word in (name, text))]
    return words + ["--allow-omega-write"] * plan.wanted.allow_omega_write + ["--allow-missing"] * plan.wanted.allow_missing


def _tell_misses(station: ReplayedStation) -> None:
    if station.strange:
        note(f"{station.name}: {station.strange} times it was asked what the recording does not have; it was silent")
    if again := sum(station.repeated.values()):
        note(f"{station.name}: {again} questions came more often than they were recorded, and got the last answer before them")
    if station.left_out:
        note(f"{station.name}: {station.left_out} recorded questions did not come, and their answers were left out")


# -- at once --------------------------------------------------------------------------------------------------------------------


class _Nobody:
    """Looks on and says nothing: what happened then has been told then."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, contexts: list[SessionContext]) -> None: ...

    def sealing(self) -> None: ...


def _record(recording: Recording, out: Path, doubts: Sequence[str], *, as_json: bool) -> int:
    from jbclog.app.replay import compare, record_again

    again = record_again(recording, out, _Nobody())
    held = compare(recording, again)
    left = [_told(name, astray, recording) for name, astray in again.left.items()]
    if as_json:
        tell_json({"run": str(again.result.folder), **_held_json(held), "left": left, "doubts": list(doubts)})
    else:
        _tell(again, held, left)
    return 0 if held is not None and held.is_same and not doubts else 1


def _held_json(held: Held | None) -> dict[str, object]:
    if held is None:
        return {"same": False, "differences": None, "compared": None, "uncompared": [UNSEALED]}
    compared = {table: {"rows": rows, "recorded": recorded} for table, (rows, recorded) in held.counts.items()}
    found = {"differences": held.comparison.differences, "compared": compared, "uncompared": held.uncompared}
    return {"same": held.is_same, **found}


def _tell(again: Again, held: Held | None, left: Sequence[str]) -> None:
    for text in left:
        note(text)
    if held is None:
        note(UNSEALED)
    else:
        _tell_held(held)
    tell(str(again.result.folder))


def _tell_held(held: Held) -> None:
    differences = held.comparison.differences
    for text in differences:
        tell(text)
    for text in held.uncompared:
        note(text)
    note(held.compared)
    if held.is_same:
        note("the same decoded tables, as far as the wires of a run that was cut off go" if held.lacking else SAME)
    elif differences:
        note(f"{len(differences)} differences")
    else:
        note("no proof: the wires kept less than the run" if held.uncompared else "no proof: a session left its recording")


def _told(name: str, astray: Divergence, recording: Recording) -> str:
    after = f"{astray.at_s - recording.first.t0_mono:.1f} s after the run's start"
    if astray.is_cut_off:
        return f"{name}: the recording ends {after}, before its session did"
    return f"{name}: left the recording {after}: this program does something else there ({astray})"
