"""Pure functions of a report that are computed once for each input in a process of the tests, by
the bytes of the input.
"""

from __future__ import annotations

import functools
import hashlib
import pickle
import sys
from collections.abc import Callable
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


def install() -> None:
    """For the modules that are imported."""
    for module, names in ONCE_EACH.items():
        if module in sys.modules:  # or no test of this session needs it
            for name in names:
                setattr(sys.modules[module], name, once_each(getattr(sys.modules[module], name)))


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
