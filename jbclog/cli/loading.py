"""Imports for commands, without the garbage collector: imported modules stay, and collections take
a twelfth of the time.
"""

from __future__ import annotations

import gc
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def without_collector() -> Iterator[None]:
    """Switch the collector off; long work within the block switches it on again itself."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def leave_out_plugins() -> None:
    """Keep pydantic from loading plug-ins of other packages, which have no place in checks of
    options and recipes.

    The search opens a file of every installed package, and its module imports parsers of mail and
    archives even if nothing is searched. An empty module takes its place.
    """
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    none = ModuleType("pydantic.plugin._loader")
    none.get_plugins = tuple  # type: ignore[attr-defined]
    sys.modules.setdefault(none.__name__, none)


@contextmanager
def drawing() -> Iterator[None]:
    """Import the drawing libraries, without the collector.

    Matplotlib writes the list of its properties into the documentation of each kind of artist, a
    quarter of its import time, which no command needs. Nor does a command draw in three dimensions,
    for which it imports five modules unless they are blocked.

    Where its cache cannot be written, as in a home that is read-only, matplotlib takes a temporary
    folder by itself. Its advice about that is for programmers, not for operators.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    flat = ModuleType("mpl_toolkits.mplot3d")
    flat.Axes3D = None  # type: ignore[attr-defined]
    sys.modules.setdefault(flat.__name__, flat)
    with without_collector():
        from matplotlib.artist import Artist

        Artist._update_set_signature_and_docstring = classmethod(lambda _: None)  # type: ignore[attr-defined]  # private
        yield
