"""What happened again and again, told once on paper: the same event of the same place with how often and until when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

Row = Mapping[str, object]

GRAVE: Final = ("error", "critical")
OFTEN: Final = 3  # from so many on


def told_once(events: Sequence[Row]) -> list[Row]:
    """The events in their order; of warnings that came often the first, with `times` and `until`."""
    alike: dict[tuple[object, ...], list[Row]] = {}
    for event in events:
        alike.setdefault(_kind(event), []).append(event)
    out: list[Row] = []
    for event in events:
        these = alike[_kind(event)]
        if event["severity"] in GRAVE or len(these) < OFTEN:
            out.append(event)
        elif event is these[0]:
            out.append({**event, "times": len(these), "until": these[-1]["time"]})
    return out


def _kind(event: Row) -> tuple[object, ...]:
    return event["station"], event["port"], event["kind"], event["severity"], event["text"]
