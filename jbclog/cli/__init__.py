"""The command line: one file a verb. The only package that prints.

Start with `app.py`, then `run.py`. A verb imports heavy packages when it runs, so its help stays
fast; the program's own help loads none of them.
"""

from jbclog.cli.front_page import is_shown

__all__ = ["main"]


def main() -> None:
    """Run the command `jbclog`."""
    if not is_shown():
        from jbclog.cli.app import main as run

        run()
