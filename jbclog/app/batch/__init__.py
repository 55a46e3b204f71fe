"""A queue of jobs: starts each job when it is due, follows it, and resumes a stopped batch.

Start with `executor.py`, then `state.py`; `processes.py` starts jobs and `child.py` is one of them.
"""
