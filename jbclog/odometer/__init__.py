"""THE SOFTWARE ODOMETER. How much a counter went on over years of looks, through resets, roll-overs and exchanged stations.

Owns: what one look at a station saw, each difference between two looks with its kind and the rule that decided it, and the sum
with its bounds wherever it can be known.
Never: reads or writes a file, talks to a station, guesses: what cannot be determined is flagged, and bounded where it can be.
May use: nothing of jbclog.
Start reading: `observed.py`, what a look saw; `odometer.py`, the kinds and rules; then `tracing.py`, `judging.py` and `span.py`.
"""
