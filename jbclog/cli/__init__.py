"""The command line: one file a verb. The only package that prints.

Start with `app.py`, then `run.py`. A verb imports heavy packages when it runs, so its help stays
fast; the program's own help loads none of them.
"""

import gc

from jbclog.cli.front_page import is_shown

__all__ = ["main"]


def main() -> None:
    """Run the command `jbclog`.

    The garbage collector begins with the command (`help.py`): what is loaded before stays. At the
    end nothing is looked through once more, because the system takes all memory back.
    """
    if is_shown():
        return
    gc.disable()
    try:
        from jbclog.cli.app import main as run

        run()
    finally:
        gc.freeze()
