"""The limit of memory that a command which reads records sets on itself: a damaged file may ask for
any amount, and should end its command, not the recorder beside it.

Only the command sets it: never the library, a recorder, or what follows a run.
"""

from __future__ import annotations

import os
import resource
from typing import Final

LEAST_BYTES: Final = 4 << 30  # libraries reserve more address space than they use


def limit_bytes() -> int | None:
    """Return the limit of address space: the size of the memory, at least `LEAST_BYTES`, at most
    what the system allows. None if the system has no such limit.
    """
    try:
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    except (AttributeError, OSError, ValueError):
        return None
    allowed = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    return min([max(memory, LEAST_BYTES), *allowed])


def limit_memory() -> None:
    """Limit the address space of this process to `limit_bytes`, where the system has a limit."""
    limit = limit_bytes()
    if limit is None:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    except (OSError, ValueError):  # a system that has the limit in name only
        return
