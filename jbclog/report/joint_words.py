"""The joints of a report's ports in rows and words, from the facts as plain data: for the page and for paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

Row = Mapping[str, object]


def jointed(report: Mapping[str, object]) -> list[Row]:
    """A row for each port that has joints: `station`, `port` and `joints`."""
    return [
        {"station": station["name"], "port": port["port"], "joints": port["joints"]}
        for station in _rows(report["stations"])
        for port in _rows(station["ports"])
        if port["joints"] is not None
    ]


REFUSED: Final = {
    "too_few": "too few of them",
    "unresolved": "their spread is that of the resolution",
    "autocorrelated": "neighbours are alike",
}


def remark(row: Row) -> str:
    """What the chart says in short, and where the count may not be whole."""
    joints = row["joints"]
    assert isinstance(joints, Mapping)
    count = joints["figures"]["joints"]
    return f"{_chart(joints)}{' Joints in gaps are not known.' if count['value'] is None else ''}"


def _chart(joints: Row) -> str:
    if joints["signals"] is None:
        refused = REFUSED.get(str(joints["refused_kind"]), "see its caption")
        return "No joints were found." if not joints["found"] else f"Without limits: {refused}."
    if not joints["signals"]:
        return "No point out of the ordinary."
    return f"{joints['signals']} point{'s' if joints['signals'] != 1 else ''} out of the ordinary."


def _rows(value: object) -> Sequence[Row]:
    return value if isinstance(value, list | tuple) else ()
