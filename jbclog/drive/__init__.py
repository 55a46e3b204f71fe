"""WHO PULLS. Drivers that take a session's wishes, do them, and send back what was heard.

Owns: waiting, writing to ports and reading from them, for one session (`blocking`), for hundreds in one process
(`reactor`), and for none but the virtual clock (`virtual`); keeping what a session was told, and telling it again (`told`);
hearing the system's signals (`signals`); lines that people and barcode readers type meanwhile (`typed`).
Never: knows what a frame is, or a station.
May use: `transport`, `clock`, `effects`, `tape`, `errors`.
Start reading: `blocking.py`, which is the meaning of the others.
"""
