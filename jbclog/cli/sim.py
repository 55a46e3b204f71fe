"""`jbclog sim`: the line's stations as virtual ones."""

from __future__ import annotations

from pathlib import Path

import typer

from jbclog.cli.output import ends_with_errors_told, note, tell


@ends_with_errors_told
def sim(
    line: Path = typer.Argument(..., help="The line file whose stations are served.", show_default=False),
    folder: Path = typer.Option(Path("virtual"), "--dir", help="Where the ports' links and the line file for `run` are made."),
    tcp: str | None = typer.Option(None, help="HOST:PORT: serve on TCP, a port a station from this one on.", show_default=False),
    log: Path | None = typer.Option(None, help="Keep every question and answer here, as JSON lines.", show_default=False),
) -> None:
    """Serve a line's stations as virtual ones, on pseudo-terminals or TCP, until Ctrl-C.

    Absolute device paths of the line file are never touched. What is served is told by DIR/line.toml, the first line of stdout.

    Example: jbclog sim profiles/lines/bench.toml --dir virtual
    """
    from jbclog.recipe.line import load_line
    from jbclog.sim.setup import SERVED_LINE, set_up, tcp_of
    from jbclog.sim.wire_file import NoWireFile, WireFile

    loaded = load_line(line)
    wire_file = WireFile(log) if log else NoWireFile()
    server = set_up(loaded, folder, tcp_of(tcp) if tcp else None, wire_file)
    server.stop_on_signals()
    served = folder / SERVED_LINE
    tell(str(served))
    note(f"{len(loaded.stations)} virtual stations are ready; Ctrl-C ends them. In another terminal:")
    note(f"  jbclog run profiles/recipes/sn100c-tht.toml --line {served} --duration 30s")
    server.run()
    wire_file.close()
