"""What differs from one call to the next, and how a transcript writes it."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from jbclog import __version__


def _days() -> str:
    """Yesterday, today and tomorrow: all other days are the same in each call."""
    today = datetime.now(UTC).date()
    return "|".join(str(today + timedelta(days=day)) for day in (-1, 0, 1))


VARYING: Final = {
    "RUN": r"\b20\d{6}T\d{6}Z-[\w-]+?-[a-z0-9]{4}\b",
    "TIME": rf"\b({_days()})[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|\+00:00| UTC)?",
    "DAY": rf"\b({_days()})\b",
    "SO LONG": r"(?<= % within )[\d.]+ (s|min|h|days)\b",  # from the recording until now
    "PROCESS": r"(?<=process )\d+\b",
    "TEMPORARY": r"/[\w/]+/jbclog-\w{8}(?=/)",
    "HASH": r"\b[0-9a-f]{64}\b",
    "FINGERPRINT": r"\b[0-9a-f]{4}(-[0-9a-f]{4}){3,}\b",
    "BYTES": r"\b\d+(?= bytes, the manifest says)|(?<=the manifest says )\d+\b",
    "SPACE": r"\b\d+(\.\d)? [kMGT]B(?= free)",
    "VERSION": rf"\b{re.escape(__version__)}\b",
}
"""By placeholder. The second of several runs or fingerprints in a call is RUN2, and so on."""
NUMBERED: Final = ("RUN", "FINGERPRINT", "HASH")


def without_varying(lines: list[str], folder: Path) -> list[str]:
    """The lines with placeholders; `folder` is the one that the program was called in."""
    text = "\n".join(lines).replace(str(folder), "FOLDER")
    for name, pattern in VARYING.items():
        seen: dict[str, str] = {}

        def placeholder(found: re.Match[str], name: str = name, seen: dict[str, str] = seen) -> str:
            number = len(seen) + 1 if name in NUMBERED and seen else ""
            return seen.setdefault(found[0] if name in NUMBERED else "", f"{name}{number}")

        text = re.sub(pattern, placeholder, text)
    return text.split("\n")
