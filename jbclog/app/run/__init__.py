"""A run on real ports, from files and options to the sealed folder and the exit code.

Start with `plan.py`, then `runner.py` and `run_record.py`.
"""
