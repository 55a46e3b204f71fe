"""Pure functions of a report that are computed once for each input in a process of the tests, by
the bytes of the input.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import pickle
import sys
from collections.abc import Callable, Iterator
from typing import Any

ONCE_EACH = {
    "jbclog.analysis.joints.identify": ("identify",),
    "jbclog.analysis.joints.sweeps": ("doubt_of",),
    "jbclog.analysis.joints.joints": ("doubt_of",),
    "jbclog.report.gather": ("_overview",),
    "jbclog.report.joints": ("_svg",),
    "jbclog.report.paper": ("pdf_of",),
    "jbclog.report.ports": ("_svg",),
}
"""What takes most of a report, and depends on nothing but its arguments (shown by `test_write.py`,
and by `test_paper.py` in other processes)."""

_known: list[dict[bytes, Any]] = []
_installed: dict[tuple[str, str], Callable[..., Any]] = {}


def install() -> None:
    """For the modules that are imported."""
    for module, names in ONCE_EACH.items():
        if module in sys.modules:  # or no test of this session needs it
            for name in names:
                _install(module, name)


def _install(module: str, name: str) -> None:
    pure = getattr(sys.modules[module], name)
    if (module, name) not in _installed:
        _installed[module, name] = once_each(pure)
    if pure is not _installed[module, name]:
        setattr(sys.modules[module], name, _installed[module, name])


@contextlib.contextmanager
def set_aside() -> Iterator[None]:
    """What is imported meanwhile finds the functions as they are written."""
    for (module, name), found in _installed.items():
        setattr(sys.modules[module], name, found.__wrapped__)  # type: ignore[attr-defined]
    try:
        yield
    finally:
        install()


def once_each(pure: Callable[..., Any]) -> Callable[..., Any]:
    known: dict[bytes, Any] = {}
    _known.append(known)

    @functools.wraps(pure)
    def found(*arguments: Any) -> Any:
        key = hashlib.sha256(pickle.dumps(arguments)).digest()
        if key not in known:
            known[key] = pure(*arguments)
        return known[key]

    return found


def forget() -> None:
    """Have everything computed again."""
    for known in _known:
        known.clear()
