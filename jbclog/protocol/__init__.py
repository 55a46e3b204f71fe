"""The stations' protocols, without I/O: frames, command tables and clients.

Start with `frame.py`, then `commands/robot.py`, then `client/robot.py`.
"""
