"""Contradictions, misprints and gaps of the manuals, each with jbclog's interpretation.

Each row of decisions.toml states the contradiction, jbclog's choice, and the reason; then how a
virtual station behaves in the alternative, and the text of the event when a station does.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import msgspec

from jbclog.core.toml import read_own


class Decision(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A row of docs/reference/contradictions.md.

    `reading`: what is sent and how answers are interpreted. `quirks`: alternatives of virtual
    stations, all of them accepted. `met`: text of the first event ``protocol.anomaly`` (code:
    `number`); empty if a run cannot meet it. `doubtful`: the value may be wrong. `usual`: normal
    for its kind of station, so no warning. `families`: empty for all with JBC's protocol.
    """

    number: int
    title: str
    reading: str
    reason: str
    quirks: tuple[str, ...] = ()
    met: str = ""
    doubtful: bool = False
    usual: bool = False
    families: tuple[str, ...] = ()


@cache
def decisions() -> Mapping[int, Decision]:
    """Return the decisions by number. They are read at the first call: a run seldom needs one."""
    table = read_own(Path(__file__).with_name("decisions.toml"))
    rows = msgspec.convert(table["decision"], list[Decision])
    return MappingProxyType({row.number: row for row in rows})
