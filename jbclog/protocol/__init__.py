"""The stations' protocols, without I/O: frames, a command table for each family, and the client of
one station.

Start with `frame.py`, then `commands/robot.py`, then `client/robot.py`.
"""
