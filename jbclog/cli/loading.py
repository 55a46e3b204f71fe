"""Loading what a command needs, without the garbage collector: what is loaded stays, and to look
through it takes a twelfth of the time.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def without_collector() -> Iterator[None]:
    """Switch it off; what takes long within switches it on again itself."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def leave_out_plugins() -> None:
    """Keep pydantic from its plug-ins: those of other packages have no place in the checks of
    options and recipes.

    To look for them opens a file of every installed package, and even where none is looked for,
    the module that would loads what reads mails and archives. An empty one takes its place.
    """
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    none = ModuleType("pydantic.plugin._loader")
    none.get_plugins = tuple  # type: ignore[attr-defined]
    sys.modules.setdefault(none.__name__, none)


@contextmanager
def drawing() -> Iterator[None]:
    """Load what draws, without the collector.

    Matplotlib writes the list of its properties into the documentation of each kind of artist, a
    quarter of its loading. Nobody reads that in a command. Nor does a command draw in three
    dimensions, for which it loads five modules unless they cannot be had.
    """
    flat = ModuleType("mpl_toolkits.mplot3d")
    flat.Axes3D = None  # type: ignore[attr-defined]
    sys.modules.setdefault(flat.__name__, flat)
    with without_collector():
        from matplotlib.artist import Artist

        Artist._update_set_signature_and_docstring = classmethod(lambda _: None)  # type: ignore[attr-defined]  # private
        yield
