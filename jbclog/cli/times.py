"""Times that people type and read: local with their zone on a terminal, UTC in a pipe, a file and
JSON. A time is read as it is shown.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from typing import Final

from jbclog.core.errors import UsageError

MINUTES: Final = "%Y-%m-%d %H:%M"
DAY: Final = "2026-11-21"
NOTHING: Final = "-"


def are_local(*, as_json: bool) -> bool:
    """Return True if the command shows and reads local times: its output goes to a terminal."""
    return sys.stdout.isatty() and not as_json


def typed_moment(
    option: str, text: str | None, *, is_local: bool, is_end: bool = False
) -> datetime | None:
    """Return a typed day or time; with `is_end` a day's end. Without a zone it is local if
    `is_local`, else UTC. Raises `UsageError`.
    """
    if text is None:
        return None
    typed, _, zone = text.strip().rpartition(" ")
    if not zone.isalpha():  # ``CET``, as a time is shown
        typed, zone = text.strip(), ""
    try:
        moment = datetime.fromisoformat(typed)
        if is_end and len(typed) <= len(DAY):
            moment += timedelta(days=1)
        return _in_utc(moment, zone, is_local=is_local)
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{option} {text}: give a day such as {DAY}, or a time such as {DAY}T08:00"
        ) from None


def _in_utc(moment: datetime, zone: str, *, is_local: bool) -> datetime:
    """Convert to UTC. `zone`: UTC or a name of the local zone, which may have two; "" for none.
    Raises ValueError for another one.
    """
    if moment.tzinfo is not None and not zone:
        return moment.astimezone(UTC)
    if zone == "UTC" or not (zone or is_local):
        return moment.replace(tzinfo=UTC)
    for fold in (0, 1):  # the hour that comes twice when summer time ends
        local = moment.replace(fold=fold).astimezone()
        if not zone or local.tzname() == zone:
            return local.astimezone(UTC)
    raise ValueError(zone)


def shown_moment(iso: str | None, *, is_local: bool) -> str:
    """Return a time of a record: ``2026-11-21 09:30 CET`` if `is_local`, else in UTC,
    ``2026-11-21 08:30``.
    """
    if iso is None:
        return NOTHING
    if not is_local:
        return iso[:16].replace("T", " ")
    try:
        moment = datetime.fromisoformat(iso)
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        return moment.astimezone().strftime(f"{MINUTES} %Z")
    except (ValueError, OverflowError, OSError):  # of a damaged record
        return iso


def head_of_times(name: str, *, is_local: bool) -> str:
    """Return the head of a column of times, whose cells have their zone if they are local."""
    return name if is_local else f"{name} UTC"


def range_text(since: datetime | None, until: datetime | None) -> str:
    """Return the range of a search, with its ends in local time and UTC; "" for none."""
    if since is not None and until is not None:
        return f" from {_both(since)} to {_both(until)}"
    if since is not None:
        return f" from {_both(since)} on"
    if until is not None:
        return f" before {_both(until)}"
    return ""


def _both(moment: datetime) -> str:
    local = moment.astimezone()
    utc = moment.astimezone(UTC)
    if local.utcoffset() == timedelta(0):
        return utc.strftime(f"{MINUTES} UTC")
    is_same_day = local.date() == utc.date()
    utc_form = "%H:%M" if is_same_day else MINUTES
    return f"{local:{MINUTES} %Z} ({utc:{utc_form}} UTC)"
