"""docs/reference/contradictions.md: what the manuals contradict, misprint or leave open, and what
is made of it.
"""

from __future__ import annotations

from jbclog.protocol.commands.decisions import Decision, decisions
from support.pages.md_table import MADE, codes, table

INTRODUCTION = """
The makers' manuals contradict each other and themselves in places, and leave things out. Each row is one such
place: how jbclog reads it, and why. Code, notes in tables and events of the kind `protocol.anomaly` cite its
number.

Where the alternative shows on the link, a virtual station can play it: the word in the last column is one of
`quirks` in its `[station.sim]`. The client accepts the alternative, records the same samples, and reports it
once as an event. Rows without such a word do not show on the link or are about what is sent; their reason
says so.
"""


def page() -> str:
    """The whole page."""
    rows = [_row(one) for one in decisions().values()]
    head = (
        "no.",
        "contradicted or left open",
        "how it is read",
        "why",
        "families",
        "quirk of a virtual station",
    )
    return f"{MADE}\n\n# Contradictions of the manuals\n{INTRODUCTION}\n{table(head, rows)}\n"


def _row(one: Decision) -> tuple[str, ...]:
    number = f"B-{one.number}" + (" (value doubtful)" if one.doubtful else "")
    return (
        number,
        one.title,
        one.reading,
        one.reason,
        codes(one.families) or "all of JBC",
        codes(one.quirks),
    )
