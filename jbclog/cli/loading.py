"""Loading what a command needs, without the garbage collector: what is loaded stays, and to look
through it takes a twelfth of the time.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collector() -> Iterator[None]:
    """Switch it off; what takes long within switches it on again itself."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
