"""PORTS. The only room that imports `serial`: opens any pyserial URL and moves bytes.

Owns: opening, exclusive use, reading and writing without waiting, closing; every way in which a link breaks, as one
`LinkError`.
Never: knows a frame, decides a time-out, or tries anything twice.
May use: `errors`, `wire`, `tape`.
Start reading: `port.py`, then `opening.py`; `tee.py` notes every byte, `read_only.py` refuses what is no
question, `descriptors.py` makes room for many ports.
"""

from jbclog.transport.opening import is_pseudo_terminal, open_port
from jbclog.transport.port import Port
from jbclog.transport.read_only import ReadOnly
from jbclog.transport.tee import Tee

__all__ = ["Port", "ReadOnly", "Tee", "is_pseudo_terminal", "open_port"]
