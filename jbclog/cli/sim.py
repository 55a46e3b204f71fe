"""`jbclog sim`: serve the stations of a line as virtual ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_file_place
from jbclog.cli.output import echo, note, reports_errors
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.sim.serve import ByteLog


@reports_errors
def sim(
    line: Path = typer.Argument(..., metavar="LINE", help="Line file.", show_default=False),
    folder: Path = typer.Option(
        Path("virtual"), "--dir", metavar="DIR", help="Folder for ports and line file."
    ),
    tcp: str | None = options.TCP,
    no_joints: bool = typer.Option(
        False, "--no-joints", help="Let the tips rest, for example to try `jbclog verify`."
    ),
    log: Path | None = typer.Option(
        None, metavar="FILE", help="Log of every query and answer (JSON lines)."
    ),
) -> None:
    """Serve a line's stations as virtual ones, until Ctrl-C.

    Creates a port below DIR for each station, and DIR/line.toml, the line file for `plan` and
    `run`; its path is the first line of stdout. Never touches absolute device paths in LINE.

    \b
    Example:
      jbclog sim profiles/lines/bench.toml --dir virtual
    """
    from jbclog.config.line import load_line
    from jbclog.sim.setup import SERVED_LINE, set_up, tcp_of, without_joints

    loaded = without_joints(load_line(line)) if no_joints else load_line(line)
    wire_file = _wire_file(log)
    server = set_up(loaded, folder, tcp_of(tcp) if tcp else None, wire_file)
    server.stop_on_signals()
    served = folder / SERVED_LINE
    echo(str(served))
    note(f"{_count(len(loaded.stations))} ready; stop with Ctrl-C. In another terminal:")
    note(*_first_run(line, served))
    server.run()
    wire_file.close()


def _first_run(line: Path, served: Path) -> list[str]:
    """Return the command that records the served line to an accepted run."""
    from jbclog.app.run.first_run import FIRST_DURATION, fitting_recipe
    from jbclog.config.line import load_line

    stations = load_line(served).stations
    command = f"--line {served} --duration {FIRST_DURATION}"
    if all(station.recipe for station in stations):
        return [f"  jbclog run {command}"]
    recipe = fitting_recipe(line, served)
    if recipe is not None:
        return [f"  jbclog run {recipe} {command}"]
    families = ", ".join(sorted({station.family for station in stations}))
    return [
        f"  jbclog run RECIPE {command}",
        f"with a recipe for {families}; `jbclog init` writes a first one",
    ]


def _wire_file(log: Path | None) -> ByteLog:
    from jbclog.sim.serve import ByteLog, NoByteLog

    expect_file_place("--log", log)
    if log is None:
        return NoByteLog()
    try:
        return ByteLog(log)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"--log {log}: cannot write: {getattr(error, 'strerror', None) or error}"
        ) from error


def _count(stations: int) -> str:
    return "1 virtual station is" if stations == 1 else f"{stations} virtual stations are"
