"""What tests share: virtual stations, independent models, faults, campaigns.
`python tests/support NAME` runs a module of it.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent


def program(name: str, *words: object) -> list[str]:
    """The command that runs a module of this package in a process of its own, as
    ``program("faults.odd_host", "step=2")``.
    """
    return [sys.executable, str(HERE), name, *map(str, words)]
