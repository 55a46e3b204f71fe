"""`jbclog` for a shell, in a process that `warm_start` forks: the process here hands on signals and
how that one ended.

It is run without `site`, and so imports only what the interpreter has.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import sys


def main(address: str) -> None:
    server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    server.connect(address)
    status, ending = os.pipe()
    here = os.getcwd()  # noqa: PTH109  # pathlib takes as long as all else
    asked = {"words": sys.argv[1:], "cwd": here, "environment": dict(os.environ), "bound": True}
    socket.send_fds(server, [json.dumps(asked).encode()], [0, 1, 2, ending])
    child = int(server.recv(64))
    os.close(ending)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, lambda number, _frame: os.kill(child, number))
    for descriptor in (0, 1, 2):  # a reader sees their end when that process ends
        os.close(descriptor)
    ended = os.waitstatus_to_exitcode(struct.unpack("=i", os.read(status, 4))[0])
    if ended < 0:
        if -ended != signal.SIGKILL:  # whose handler cannot be set
            signal.signal(-ended, signal.SIG_DFL)
        os.kill(os.getpid(), -ended)
    os._exit(ended)
