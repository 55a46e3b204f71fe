"""READING FOR THE AUDIT. Asks stations what they count, or takes it from the record of the run that has them.

Owns: which questions an audit asks and how often, what it makes of a station that does not answer, whose
turn it is on a wire; which errors runs saw since; when tips were verified; how a timer calls it.
Never: writes to a station, reads what reading clears (R-TA), disturbs a run, or judges a count: that is the room `audit`.
May use: `reach`, `audit`, `odometer`, `analysis` (the records of runs), `byhand`, `commands`, `quantities`, `record`,
`verifying`, `drive`, `transport`, `rows`, `effects`, `same_port` and `errors`.
Start reading: `asking.py`, the questions as a generator; then `recorded.py` and `past_runs.py` for runs, and `looking.py`, who
pulls them.
"""
