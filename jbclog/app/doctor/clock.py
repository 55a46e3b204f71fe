"""The host's clock: what it says, and whether anybody keeps it right."""

from __future__ import annotations

import ctypes
from datetime import UTC, datetime

from jbclog.app.doctor.result import Fine, Looked
from jbclog.session.discovery.found import Finding

WHERE = "clock"
STEP = "have a time server keep it: `sudo timedatectl set-ntp true`"
RELEASED = datetime(2026, 1, 1, tzinfo=UTC)  # nothing can be recorded before this program was made
UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
ROOM = 256  # bytes; struct timex has 208


def look_at_clock(utc_s: float, is_kept: bool | None) -> Looked:
    """`utc_s` is what the clock says, in seconds since 1970; `is_kept` whether the system calls it right, where it tells."""
    now = datetime.fromtimestamp(utc_s, UTC)
    if now < RELEASED:
        return Finding("clock.wrong", WHERE, f"it says {now:%Y-%m-%d %H:%M} UTC, which cannot be", STEP)
    if is_kept is False:
        return Finding("clock.unkept", WHERE, "no time server keeps it, so times in records can be off", STEP)
    return Fine("clock", WHERE, f"{now:%Y-%m-%d %H:%M} UTC" + (", kept by a time server" if is_kept else ""))


def clock_is_kept() -> bool | None:
    """What the kernel says of its clock; None where there is nobody to ask."""
    try:
        told = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(ROOM))
    except (OSError, AttributeError, TypeError):  # another system
        return None
    return None if told < 0 else bool(told != UNSYNCHRONISED)
