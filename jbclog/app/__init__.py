"""The use cases: what a verb of the command line does, without options, printing or exit codes.

Start with `run/plan.py` and `run/runner.py`; each other use case is a sub-package or a module.
"""
