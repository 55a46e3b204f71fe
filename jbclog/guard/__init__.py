"""THE GUARD. A small process that makes tools safe when the recorder dies or hangs (faults.md, section 9).

Owns: the lease (which tools are hot, and how each is made safe), the watching of its renewal, the end of a recorder that
hangs, the taking over of the lines, what is written down of that, and where such leases are found again.
Never: decides what a safe state is (`safety`), samples, or touches a line while its recorder lives.
May use: `safety`, `station`, `commands`, `drive`, `transport`, `clock`, `effects`, `wire`, `errors`, `foreign`, `shown`,
`same_port`, `locked`, and of `record` the annotations of a sealed run, loaded when there is something to say of one.
Start reading: `watch.py`, then `takeover.py`; `process.py` is the recorder's end of it, `__main__.py` the guard's.
"""
