"""The command line: options in, words out, a file a verb. The only package that prints.

Start with `app.py`, then `run.py`. What is heavy is imported in the verb that needs it, so that `--help` stays quick.
"""

from jbclog.cli.app import main

__all__ = ["main"]
