"""THE COMMAND LINE. A file a verb, thin: options in, one call, sentences out. The only room that prints.

Owns: options, help, progress, the wording of results, exit codes as the shell sees them.
Never: decides anything about soldering, stations or records.
May use: every room; what is heavy is imported in the verb that needs it, so that `jbclog --help` stays quick.
Start reading: `app.py`, then `run.py`.
"""

from jbclog.cli.app import main

__all__ = ["main"]
