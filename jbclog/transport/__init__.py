"""PORTS. The only room that imports `serial`: opens any pyserial URL and moves bytes.

Owns: opening, exclusive use, reading and writing without waiting, closing; every way in which a link breaks, as one
`LinkError`.
Never: knows a frame, decides a time-out, or tries anything twice.
May use: `errors`, `wire`.
Start reading: `port.py`.
"""

from jbclog.transport.opening import open_port
from jbclog.transport.port import Port

__all__ = ["Port", "open_port"]
