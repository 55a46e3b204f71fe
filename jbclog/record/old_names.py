"""What 0.1.0 (schema 1) called things that have another name now. Readers alone use it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

OLD_SCHEMA: Final = 1
OLD_KEYS: Final = {"started": "start", "ended": "stop"}
"""Keys of a manifest."""
OLD_KEYS_OF_LISTS: Final = {
    "units": {"serial": "unit", "begin": "start", "end": "stop"},
    "stations": {"tools": "tool_names"},
    "verdict_rules": {"limit": "limit_value", "unit": "uom"},
}
"""Keys of the entries of a manifest's lists."""
OLD_COLUMNS: Final[Mapping[str, Mapping[str, str]]] = {
    "samples": {"set_c": "setpoint_c"},
    "events": {"limit": "limit_value"},
    "settings": {"tool": "tool_name", "unit": "uom"},
    "counters": {"unit": "uom"},
}
"""Columns by table. A column of samples is also the name of its signal, in reasons and in the
manifest.
"""


def with_new_keys(manifest: Any) -> Any:
    """Return a manifest of schema 1, as parsed from its JSON, with the keys of today. What is none
    stays as it is.
    """
    if not isinstance(manifest, dict):
        return manifest
    renamed = _renamed(manifest, OLD_KEYS)
    for key, names in OLD_KEYS_OF_LISTS.items():
        entries = renamed.get(key)
        if isinstance(entries, list):
            renamed[key] = [_renamed(entry, names) for entry in entries]
    return renamed


def facts_with_new_keys(facts: Any) -> Any:
    """Return a station's facts of schema 1, as parsed from their JSON, with the keys of today."""
    return _renamed(facts, OLD_KEYS_OF_LISTS["stations"])


def _renamed(entry: Any, names: Mapping[str, str]) -> Any:
    if not isinstance(entry, dict):
        return entry
    return {names.get(key, key): value for key, value in entry.items()}
