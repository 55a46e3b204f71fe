"""WHAT IS WRONG with this machine's set-up, and the one step that mends each thing.

Owns: looking at disk, clock, USB ports and permissions; holding what stations say against what a line file says of them.
Never: writes to a station, opens a port that a run or another program holds, or mends anything itself.
May use: `search`, `finding`, `recipe`, `record` (which run holds a port, files that last), `transport` (names of ports)
and `commands`.
Start reading: `examine.py`, then `disk.py`, `clock.py` and `ports.py` for the machine and `stations.py` for a line.
"""
