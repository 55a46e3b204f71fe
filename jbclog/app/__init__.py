"""The use cases: what each command does, without options, printing or exit codes.

Start with `run/plan.py` and `run/runner.py`; each other use case is a sub-package or a module.
"""
