"""A RUN ONCE MORE. A run whose wires were kept, lived through without any port, or served on ports as virtual stations.

Owns: what a recorded run says of itself (its plan, its rates, when it sampled), the second life of its sessions, the tables
of both lives held against each other, and how fast a recording can be served.
Never: decides what a session does, or how a row is written; makes up an answer that was not recorded.
May use: `dossier`, `plan`, `recipe`, `session`, `drive`, `record`, `sim`, `clock`, `rows`, `effects`, `tape` and
`errors`.
Start reading: `recording.py`, then `again.py` (lived through) and `served.py` (on ports).
"""
