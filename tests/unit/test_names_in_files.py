"""One name for one thing in every JSON and CSV file, and in what the commands print as JSON: `unit`
is a workpiece's serial, `uom` a unit of measure; everything has `start` and `stop`; a limit is a
`limit_value`.
"""

from __future__ import annotations

import ast
import dataclasses
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from jbclog.analysis.control_limits import Limits
from jbclog.analysis.verdict.rule import Rule
from jbclog.app.batch.job_dir import JobProgress, JobResult
from jbclog.app.batch.state import Attempt, Entry
from jbclog.app.publish import Outcome
from jbclog.guard.lease import StationLease
from jbclog.live.states import RunState
from jbclog.maintenance.fleet import FleetAudit
from jbclog.maintenance.suspect_runs import Suspect
from jbclog.record.find_runs import Found
from jbclog.record.wire_recorder import Head
from jbclog.report.audit.files import COLUMNS
from jbclog.report.facts import Facts
from jbclog.report.spreadsheet import TABLES
from jbclog.session.manual.danger import Snapshot
from support.pages import manifest, other_files

FORBIDDEN = {"limit", "begin", "end", "serial", "onset", "set_c", "started", "ended", "unit"}
A_SERIAL = {("Unit", "unit"), ("RunState", "unit"), ("JobProgress", "unit")}
"""Where `unit` is the serial of a workpiece."""
WRITTEN: tuple[type, ...] = (
    *manifest.OBJECTS.values(),
    *other_files.OBJECTS.values(),
    *(Facts, Rule, FleetAudit, Suspect, Limits, Snapshot, StationLease, Head, Found, Outcome),
    *(Entry, Attempt, JobProgress, JobResult, RunState),
)
"""What is written to a file, or printed as JSON, key by key; also what stands in them."""
HOME = Path(__file__).parents[2] / "jbclog"
PRINTING = ("analysis", "app", "cli", "guard", "live", "maintenance", "record", "report", "session")
SERIALS = {
    (f"{module}.py", "unit")
    for module in ("analysis/run_metrics", "analysis/run_tables", "app/run/options")
}
"""Modules whose key `unit` is a serial, or a recipe's key for one."""
OLD_NAMES = HOME / "record" / "old_names.py"


def inside(kind: object, met: set[object]) -> Iterator[type]:
    """Yield the types with fields that stand in a type, and itself."""
    if kind in met:
        return
    met.add(kind)
    for part in typing.get_args(kind):
        yield from inside(part, met)
    if not isinstance(kind, type):
        return
    if dataclasses.is_dataclass(kind) or issubclass(kind, msgspec.Struct):
        yield kind
        for part in typing.get_type_hints(kind).values():
            yield from inside(part, met)


def written() -> list[type]:
    met: set[object] = set()
    return [kind for root in WRITTEN for kind in inside(root, met)]


@pytest.mark.parametrize("kind", written(), ids=lambda kind: kind.__name__)
def test_keys_of_what_is_written(kind: type) -> None:
    keys = {name for name in typing.get_type_hints(kind) if not name.startswith("_")}
    assert {key for key in keys & FORBIDDEN if (kind.__name__, key) not in A_SERIAL} == set()


def test_what_stands_inside_is_looked_at() -> None:
    names = {kind.__name__ for kind in written()}
    assert {"PortFacts", "Meter", "Difference", "TaskState", "Setting", "Fixed"} <= names


@pytest.mark.parametrize("table", [*TABLES, "audit"])
def test_columns_of_csv(table: str) -> None:
    columns = {*COLUMNS} if table == "audit" else {*TABLES[table]}
    assert columns & FORBIDDEN == ({"unit"} if table in ("joints", "units") else set())


@pytest.mark.parametrize("package", PRINTING)
def test_keys_of_plain_data(package: str) -> None:
    """What is made as a dict has no type to look at."""
    found = set()
    for path in {*(HOME / package).rglob("*.py")} - {OLD_NAMES}:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            keys = node.keys if isinstance(node, ast.Dict) else []
            texts = {key.value for key in keys if isinstance(key, ast.Constant)}
            found |= {(path.relative_to(HOME).as_posix(), text) for text in texts & FORBIDDEN}
    assert found - SERIALS == set()
