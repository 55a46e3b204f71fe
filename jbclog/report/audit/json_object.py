"""An audit as one JSON object. What has no upper end, and what is not known, is null: JSON has no infinity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum

from jbclog.maintenance.fleet import FleetAudit, StationAudit, findings

Plain = dict[str, object]


def plain_audit(audit: FleetAudit) -> Plain:
    """Everything in it, with each station's state and what there is to find there."""
    return _fields(audit) | {"stations": [_station(one) for one in audit.stations]}


def _station(station: StationAudit) -> Plain:
    found = sorted(one.value for one in findings(station))
    return {"state": station.state.value, "findings": found} | _fields(station)


def _fields(value: object) -> Plain:
    assert is_dataclass(value)
    return {one.name: plain(getattr(value, one.name)) for one in fields(value)}


def plain(value: object) -> object:
    """As JSON has it."""
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if is_dataclass(value):
        return _fields(value)
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value
