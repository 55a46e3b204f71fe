"""Repeated events as one row on paper, with their number and the time of the last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from jbclog.report.text import RowView

GRAVE: Final = ("error", "critical")
OFTEN: Final = 3  # repetitions from which on they are merged


def merge_repeated(events: Sequence[RowView]) -> list[RowView]:
    """Return the events in their order; of repeated warnings only the first, with `times` and
    `until`.
    """
    alike: dict[tuple[object, ...], list[RowView]] = {}
    for event in events:
        alike.setdefault(_kind(event), []).append(event)
    out: list[RowView] = []
    for event in events:
        these = alike[_kind(event)]
        if event["severity"] in GRAVE or len(these) < OFTEN:
            out.append(event)
        elif event is these[0]:
            out.append({**event, "times": len(these), "until": these[-1]["time"]})
    return out


def _kind(event: RowView) -> tuple[object, ...]:
    return event["station"], event["port"], event["kind"], event["severity"], event["text"]
