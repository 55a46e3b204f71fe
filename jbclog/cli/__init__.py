"""The command line, a file per command. The only package that prints.

Start with `app.py`, then `run.py`. A command imports heavy packages when it runs, so its help stays
fast; the program's own help imports none of them.
"""

import gc

from jbclog.cli.front_page import is_shown

__all__ = ["main"]


def main() -> None:
    """Run the command `jbclog`.

    The garbage collector starts with the command (`help.py`); modules imported before are never
    collected. There is no collection at exit, because the system takes all memory back.
    """
    if is_shown():
        return
    gc.disable()
    try:
        from jbclog.cli.app import main as run

        run()
    finally:
        gc.freeze()
