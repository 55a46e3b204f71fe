"""A queue of jobs: start each when it is its turn, follow it, resume where the batch was stopped.

Start with `executor.py`, then `state.py`; `processes.py` starts jobs and `child.py` is one of them.
"""
