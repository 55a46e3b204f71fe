"""``python -m jbclog.sim LINE --dir DIR``: serve a line file's stations in a separate process.

Writes the path of its line file to stdout as soon as all ports exist, and ends on SIGINT or
SIGTERM; with ``--until-eof`` also when its stdin is closed, so that it does not outlive its parent.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from jbclog.config.line import load_line
from jbclog.core.errors import UsageError
from jbclog.sim.serve import ByteLog, NoByteLog
from jbclog.sim.setup import SERVED_LINE, set_up, tcp_of


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="jbclog.sim", description="Serve a line's stations as virtual ones."
    )
    parser.add_argument("line", type=Path)
    parser.add_argument("--dir", type=Path, required=True)
    parser.add_argument("--tcp")
    parser.add_argument("--log", type=Path)
    parser.add_argument("--until-eof", action="store_true")
    options = parser.parse_args()
    wire_file = ByteLog(options.log) if options.log else NoByteLog()
    try:
        tcp = tcp_of(options.tcp) if options.tcp else None
        server = set_up(load_line(options.line), options.dir, tcp, wire_file)
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    server.stop_on_signals()
    if options.until_eof:
        server.stop_at_end_of(sys.stdin.fileno())
    sys.stdout.write(f"{(options.dir / SERVED_LINE).absolute()}\n")
    sys.stdout.flush()
    server.run()
    wire_file.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
