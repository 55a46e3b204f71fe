"""VIRTUAL STATIONS. What stands on the other end of the cable in the demo and in the tests.

Owns: the physics of tip, port, feeder and counters (`tip.py`, `joints.py`, `state.py`, `parts.py`, `port.py`,
`feeder.py`, `plant.py`) and of hot air (`air.py`, `airstation.py`); the protocol face over the same command tables that
the client uses (`questions.py`, `device.py`, `face.py` and behind it `soldering.py`, `readings.py`, `writings.py` and
`airface.py`); faults and quirks by name (`faults.py`, `quirks.py`); one whole virtual
station without any I/O (`virtual.py`, `build.py`, `wire_log.py`; of OMEGA `omega.py` and `omega_plant.py`; `make.py`
chooses); a recorded station played from its tape (`exchanges.py`, `looks.py`, `tape.py`); and serving a line on
pseudo-terminals or TCP (`setup.py`, `serve.py`, `links.py`, `terminal_line.py`, `uart.py`, `waiting.py`, `wire_file.py`,
`process.py`).
Never: is imported by anything on the run path; touches an absolute device path; prints.
May use: `protocol`, `commands`, `quantities`, `wire`, `recipe` (line files), `tape`, `clock` and `errors`.
Start reading: `virtual.py`, then `device.py`, `face.py` and `plant.py`; `serve.py` for the ports.

Physics knows nothing of the protocol and is passed the time. Where no manual says what a station does, the
virtual one does what its docstring says, and that proves nothing about a real one.
"""
