"""``python -m jbclog.sim LINE --dir DIR``: serves a line's stations in a process of its own.

Writes the path of the line file that it made to stdout as soon as all ports are there, and ends with SIGINT
or SIGTERM; with ``--until-eof`` also when its stdin is closed, so that it cannot outlive who started it.
"""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from jbclog.errors import UsageError
from jbclog.recipe.line import load_line
from jbclog.sim.serve import Server
from jbclog.sim.setup import SERVED_LINE, Tcp, set_up
from jbclog.sim.wire_file import NoWireFile, WireFile


def tcp_of(text: str) -> Tcp:
    """``HOST:PORT``; the stations take this port and the following ones, or any free ones where it is 0."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not HOST:PORT")
    return host.strip("[]") or "127.0.0.1", int(port)


def end_on_signals(server: Server) -> None:
    """Let SIGINT and SIGTERM end the serving in good order."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())


def main() -> int:
    parser = argparse.ArgumentParser(prog="jbclog.sim", description="Serve a line's stations as virtual ones.")
    parser.add_argument("line", type=Path)
    parser.add_argument("--dir", type=Path, required=True)
    parser.add_argument("--tcp", type=tcp_of)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--until-eof", action="store_true")
    options = parser.parse_args()
    wire_file = WireFile(options.log) if options.log else NoWireFile()
    try:
        server = set_up(load_line(options.line), options.dir, options.tcp, wire_file)
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    end_on_signals(server)
    if options.until_eof:
        server.stop_at_end_of(sys.stdin.fileno())
    sys.stdout.write(f"{(options.dir / SERVED_LINE).absolute()}\n")
    sys.stdout.flush()
    server.run()
    wire_file.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
