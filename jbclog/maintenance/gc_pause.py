"""Python's search for circles of garbage, put off while a long ledger is read and judged.

It goes through all that there is again and again while millions of small values are made, which is half of the time; and there is
nothing in it to be found. What is not used any more is freed at once as ever.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Without it, where it is on. Of the whole program: other threads are without it meanwhile, too."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
