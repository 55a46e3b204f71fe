"""`jbclog replay`: a recorded run once more, as virtual stations or at once."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.errors import UsageError

if TYPE_CHECKING:
    from jbclog.drive.told import Astray
    from jbclog.replaying import Again, Recording
    from jbclog.rows import EventRow
    from jbclog.session.order import Desk
    from jbclog.sim.tape import TapeStation

SERVED_IN = Path("replayed")
DOUBTFUL = "The recording is not as it was made: what follows rests on those blocks of it alone whose own check sums hold."


@ends_with_errors_told
def replay(
    run: Path = options.RUN,
    folder: Path | None = typer.Option(
        None, "--dir", metavar="DIR", help=f"Where the ports and the line file are made.  [default: {SERVED_IN}]"
    ),
    tcp: str | None = typer.Option(None, metavar="HOST:PORT", help="Serve on TCP, a port a station from this one on."),
    speed: float | None = typer.Option(
        None, min=0.1, max=1000.0, metavar="FACTOR", help="Answer so many times as fast as then.  [default: 1]"
    ),
    out: Path | None = typer.Option(
        None, "--record", metavar="DIR", help="Serve nothing: live through the run at once, record that below DIR, and compare."
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Serve a run that was recorded with --wire as virtual stations.

    Each answers as it did then: with the same bytes after the same time, corrupt, late, or not at all; a link that was lost
    is lost again. DIR/line.toml is the line file for `run`; its path is the first line of stdout.

    With --record there are no ports and no waiting. The run is lived through on its own clock, and its tables come out the
    same; what does not is told, and then the exit code is 1. The last line of stdout is the new run's folder.

    \b
    Example:
      jbclog replay runs/20261121T013000Z-bench-3-k7qd --record again
    """
    from jbclog.replaying import open_recording

    if not run.is_dir():
        raise UsageError(f"{run}: there is no such folder; runs are in `runs/`, or where --out put them")
    if out is not None and (folder, tcp, speed) != (None, None, None):
        raise UsageError("--record serves nothing: leave out --dir, --tcp and --speed")
    recording = open_recording(run)
    doubts = recording.doubts
    for text in doubts:
        note(text)
    if doubts:
        note(DOUBTFUL)
    if out is None:
        _serve(recording, folder or SERVED_IN, tcp, speed or 1.0)
    else:
        raise typer.Exit(_record(recording, out, doubts, as_json=as_json))


# -- on ports -------------------------------------------------------------------------------------------------------------------


def _serve(recording: Recording, folder: Path, tcp: str | None, speed: float) -> None:
    from jbclog.replaying import serve
    from jbclog.sim.setup import SERVED_LINE, tcp_of

    server, stations = serve(recording, folder, tcp_of(tcp) if tcp else None, speed)
    server.stop_on_signals()
    tell(str(folder / SERVED_LINE))
    count = len(stations)
    note(f"{count} recorded station{' is' if count == 1 else 's are'} ready; Ctrl-C ends this. In another terminal:")
    note(f"  {shlex.join(_command(recording, folder / SERVED_LINE, speed))}")
    server.run()
    for station in stations:
        _tell_misses(station)


def _command(recording: Recording, line: Path, speed: float) -> list[str]:
    """The run that asks for the same as then."""
    from jbclog.replaying import plan_of

    plan, told, rate = plan_of(recording), recording.metadata, recording.rate
    if speed != 1.0 and not isinstance(rate, str):
        rate = (rate or plan.stations[0].rate_hz or 1.0) * speed
    options = [("--rate", f"{rate:g}" if isinstance(rate, float) else rate)]
    options += [("--duration", None if recording.sampled_s is None else f"{recording.sampled_s / speed:g}s")]
    options += [("--operator", told.operator), ("--order", told.order), ("--product", told.product)]
    options += [("--unit", unit) for unit in told.units] + [("--tag", f"{name}={text}") for name, text in told.tags.items()]
    words = ["jbclog", "run", "--line", str(line), *(word for name, text in options if text for word in (name, text))]
    return words + ["--allow-omega-write"] * plan.wanted.allow_omega_write


def _tell_misses(station: TapeStation) -> None:
    if station.strange:
        note(f"{station.name}: {station.strange} times it was asked what the recording does not have; it was silent")
    if again := sum(station.repeated.values()):
        note(f"{station.name}: {again} questions came more often than they were recorded")


# -- at once --------------------------------------------------------------------------------------------------------------------


class _Nobody:
    """Looks on and says nothing: what happened then has been told then."""

    def begun(self, folder: Path) -> None: ...

    def happened(self, event: EventRow) -> None: ...

    def second(self, desks: list[Desk]) -> None: ...

    def sealing(self) -> None: ...


def _record(recording: Recording, out: Path, doubts: Sequence[str], *, as_json: bool) -> int:
    from jbclog.replaying import compare, record_again

    again = record_again(recording, out, _Nobody())
    found = compare(recording, again)
    left = [_told(name, astray, recording) for name, astray in again.left.items()]
    if as_json:
        told = {"same": found == [], "differences": found, "left": left, "doubts": list(doubts)}
        tell_json({"run": str(again.result.folder), **told})
    else:
        _tell(again, found, left)
    return 1 if found or doubts or any(not astray.is_cut_off for astray in again.left.values()) else 0


def _tell(again: Again, found: Sequence[str] | None, left: Sequence[str]) -> None:
    for text in left:
        note(text)
    for text in found or ():
        tell(text)
    if found is None:
        note("nothing to compare it with: the run is not sealed; `jbclog recover` finishes it")
    else:
        note(f"{len(found)} differences" if found else "the same decoded tables")
    tell(str(again.result.folder))


def _told(name: str, astray: Astray, recording: Recording) -> str:
    after = f"{astray.at_s - recording.first.t0_mono:.1f} s after the run's start"
    if astray.is_cut_off:
        return f"{name}: the recording ends {after}, before its session did"
    return f"{name}: left the recording {after}: this program does something else there ({astray})"
