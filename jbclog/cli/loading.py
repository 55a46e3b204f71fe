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


@contextmanager
def drawing() -> Iterator[None]:
    """Load what draws, without the collector.

    Matplotlib writes the list of its properties into the documentation of each kind of artist, a
    quarter of its loading. Nobody reads that in a command.
    """
    with without_collector():
        from matplotlib.artist import Artist

        Artist._update_set_signature_and_docstring = classmethod(lambda _: None)  # type: ignore[attr-defined]  # private
        yield
