"""Limits for the lists in a manifest: a few megabytes must not cost gigabytes and minutes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Final

from jbclog.core.rows import StationFacts

MOST: Final = {
    "stations": 512,  # 250 are claimed
    "recipes": 1024,  # two a station
    "units": 200_000,  # a week of one every 5 s has 121 000
    "files": 20_000,  # tables of 8 million rows a part, two captures a station
    "verdict rules": 100_000,
    "verifications": 8192,  # 16 ports a station
    "goals": 100,
    "clock steps": 1000,
    "host entries": 1000,
    "tags": 1000,
    "wire lots": 1000,
    "flux lots": 1000,
    "tips": 8192,
    "stated units": 200_000,
    "stations in the accounting": 512,
    "signals in the accounting": 200_000,  # 250 stations of 4 ports have 30 000
}
"""Maximum number of entries of each list, far above the longest run."""
MOST_OF_STATION: Final = 1000  # entries of each list of a station

LONGEST_NAME: Final = 200  # a line file allows 64; each figure and table contains them


def expect_counts(counts: Mapping[str, int], stations: Iterable[StationFacts]) -> None:
    """Raise ValueError for a list that is too long; `counts` has those of `Manifest.counts`."""
    for name, count in counts.items():
        if count > MOST[name]:
            raise ValueError(f"{count} {name}, at most {MOST[name]}")
    for station in stations:
        if len(station.name) > LONGEST_NAME:
            raise ValueError(
                f"a station's name of {len(station.name)} characters, at most {LONGEST_NAME}"
            )
        for one in fields(station):
            value = getattr(station, one.name)
            if isinstance(value, list | dict) and len(value) > MOST_OF_STATION:
                raise ValueError(
                    f"{len(value)} entries of {one.name} at one station, at most {MOST_OF_STATION}"
                )
