"""The command line: one file a verb. The only package that prints.

Start with `app.py`, then `run.py`. A verb imports heavy packages when it runs, so `--help` stays
fast.
"""

from jbclog.cli.app import main

__all__ = ["main"]
