"""What a planner sees of counters that never fall, against figures that were computed before falls
became questions (`data/counters`).

Five simulated stations over 40 weeks or 24 months: one whose clock was set back, some so young that
they could hide a reset, one whose starts may have rolled over between two looks.
"""

from __future__ import annotations

import json
from pathlib import Path

from jbclog.config.tasks_file import load_tasks
from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import read_book
from jbclog.report.audit.files import plain_audit

DATA = Path(__file__).parents[2] / "data" / "counters"
TASKS = Path(__file__).parents[3] / "profiles" / "tasks" / "bench.toml"


def test_no_digit_changes_for_a_fleet_without_falls() -> None:
    expected = json.loads((DATA / "without_falls.json").read_text(encoding="utf-8"))
    book = read_book(DATA / "without_falls.jsonl")
    assert book.wrong == []
    last: dict[str, Observation] = {}
    for look in book.observations:
        last[look.station] = look
    now = max(look.time for look in last.values())
    audit = plain_audit(fleet_of(book, list(last.values()), now, load_tasks(TASKS)))
    del audit["ledger"]
    for station in audit["stations"]:  # type: ignore[attr-defined]
        assert station.pop("question") == ""
    assert audit == expected
    rules = {
        mark["rule"]
        for station in expected["stations"]
        for meter in station["meters"]
        for mark in meter["counter_total"]["marks"]
    }
    assert rules == {"can_hide_reset", "can_have_rolled_over"}
