"""BYTES. Frames of JBC's robot protocol and of OMEGA's: built, checked, found in a stream.

Owns: the frames, their check bytes and sums, and the readers that find frames in any chunks of bytes.
Never: opens a port, looks at a clock, or knows what a command means.
May use: nothing of jbclog but `errors`.
Start reading: `frame.py`, then `reader.py`; `omega.py` is the other protocol.
"""
