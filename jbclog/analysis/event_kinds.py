"""The kinds of events in a record (docs/reference/events.md), and how they are chosen."""

from __future__ import annotations

import re
from difflib import get_close_matches
from typing import Final

import pandas as pd

from jbclog.core.errors import UsageError

ANY: Final = "*"
_LISTED: Final = """
alarm.before_run alarm.episode.cleared alarm.episode.failed alarm.episode.raised
alarm.episode.uncertain alarm.high alarm.high.ended alarm.high.not_working alarm.low
alarm.low.ended alarm.low.not_working alarm.unconfirmed alarm.unknown clock.step
control.preparing control.ready counters.missed feeder.clogged feeder.clogged.ended guard.failed
guard.left_over guard.list guard.lost guard.none guard.took_over guard.weak host.busy
host.suspended identity.changed identity.not_known identity.swapped link.back link.contention
link.flooded link.lost notes.missed omega.completed omega.first_stage port.error port.ok
port.state protocol.anomaly read.bcc read.contradicted read.doubted read.format read.implausible
read.nak read.pulled read.timeout record.failed record.new_file record.not_sealed robot.off
robot.on run.end run.failed run.goal run.look_failed run.signal run.start run.uncounted
safety.no_cooldown safety.not_available safety.not_known safety.not_safe safety.safe_state
setting.changed setting.repeated setting.unread solder.shortage solder.shortage.ended
station.completed station.error station.failed station.gone station.left_out
station.model_accepted station.not_started station.ok station.ready station.refused
station.slow station.stopped temperature.in_range temperature.out_of_range tool.absent
tool.changed tool.unknown unit.again unit.begin unit.closed unit.end unit.finish unit.lost
unit.missing unit.next unit.refused unit.repeated wire.failed
"""
KINDS: Final = tuple(_LISTED.split())
NUMBERED: Final = "read.nak"
"""The kind of this name has the number of the refusal behind it."""


def of_kind(events: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Return the events of a kind; ``*`` in it stands for any characters.

    Raises `UsageError` for a kind that neither they nor any other events have.
    """
    parts = [re.escape(part) for part in kind.split(ANY)]
    pattern = ".*".join(parts)
    found = events[events["kind"].str.fullmatch(pattern)].reset_index(drop=True)
    if len(found) or any(re.fullmatch(pattern, name) for name in KINDS):
        return found
    if kind.startswith(NUMBERED):
        return found
    near = get_close_matches(kind[:64], KINDS, n=1)
    meant = f"; did you mean {near[0]}?" if near else "."
    raise UsageError(
        f"events have no kind {kind[:64]!r}{meant} They have {', '.join(KINDS)}; alarm.* stands for"
        " all that begin so"
    )
