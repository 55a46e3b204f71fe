"""BYTES. Frames of JBC's robot protocol: built, checked, found in a stream.

Owns: the frame, its check byte, and the reader that finds frames in any chunks of bytes.
Never: opens a port, looks at a clock, or knows what a command means.
May use: nothing of jbclog but `errors`.
Start reading: `frame.py`, then `reader.py`.
"""
