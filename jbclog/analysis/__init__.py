"""READING RUNS. A run folder as pandas DataFrames, whether it is sealed, being recorded, or was cut off.

Owns: opening a run, its tables by station, port and time, and the plain plot of a run; many runs, a metric over them, and two side
by side.
Never: writes into a run's folder or makes a recorder wait; is imported by what records.
May use: `record`, `judge`, `episodes`, `features`, `spc`, `rows`, `tape`, `foreign` and `errors`; pandas, and matplotlib through
its objects (no pyplot).
Start reading: `run.py`.
"""

from jbclog.analysis.run import Run, open_run
from jbclog.analysis.runs import Runs, open_runs

__all__ = ["Run", "Runs", "open_run", "open_runs"]
