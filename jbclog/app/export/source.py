"""Input of an export: the tables of a run piece by piece, and facts about their origin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final

import pyarrow as pa

from jbclog import __version__
from jbclog.analysis.derived_schemas import ALARMS_SCHEMA, JOINTS_SCHEMA
from jbclog.analysis.run import Run
from jbclog.analysis.run_metrics import joints_of
from jbclog.analysis.verdict import RULES
from jbclog.core.errors import RecordError
from jbclog.core.rows import TABLES
from jbclog.core.text import clean, warn
from jbclog.record.annotations import late_serials
from jbclog.record.annotations import read as read_annotations
from jbclog.record.check import check
from jbclog.record.find_runs import SEALED, ending
from jbclog.record.manifest import manifest_sha256
from jbclog.record.schema import SCHEMAS

SCHEMA_OF: Final[Mapping[str, pa.Schema]] = {
    **{table: SCHEMAS[table] for table in TABLES},
    "joints": JOINTS_SCHEMA,
    "alarms": ALARMS_SCHEMA,
}
"""Columns of each table that can be exported, with units."""

CHECKED: Final = "hashes, counts and chains agree"
NOT_CHECKED: Final = "not checked (--unchecked)"


def expect_whole(run: Run, *, with_report: bool = True) -> None:
    """Raise `RecordError` if `jbclog check` finds anything, or the run is not sealed."""
    found = check(run.folder, with_report=with_report)
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        text = (
            f"{run.folder}: not exported, because its check finds: {found[0]}{more}; `jbclog check`"
            " lists all findings"
        )
        raise RecordError(f"{text}, --unchecked exports what can be read")


def _warn_of(damage: str) -> None:
    warn(f"{damage}; the rows of this group are left out")


class Source:
    """A run to export. `tables` are those to export, in the order of `SCHEMA_OF`."""

    def __init__(self, run: Run, tables: Sequence[str] = (), *, is_checked: bool) -> None:
        self.run, self.is_checked = run, is_checked
        self.tables = [name for name in SCHEMA_OF if not tables or name in tables]

    def pieces(self, table: str) -> Iterator[pa.Table]:
        """Yield the rows of a table in order, at most one row group at a time; no piece is empty.

        Raises `RecordError`. An unchecked export leaves damaged row groups out, with a warning for
        each.
        """
        on_damage = None if self.is_checked else _warn_of
        pieces = (
            self.run.groups(table, SCHEMAS[table].names, on_damage=on_damage)
            if table in SCHEMAS
            else iter([self._computed(table)])
        )
        return (piece for piece in pieces if piece.num_rows)

    @cached_property
    def joints(self) -> pa.Table:
        """The joints. Raises `RecordError`."""
        return joints_of(self.run)

    @cached_property
    def facts(self) -> dict[str, str]:
        """Origin of the data: name -> text without hidden characters, in display order."""
        facts = {**self._run_facts(), **self._stated(), **self._notes()}
        facts["integrity"] = CHECKED if self.is_checked else NOT_CHECKED
        facts["times"] = "UTC"
        facts["exported by"] = f"jbclog {__version__}, methods {RULES}"
        return {clean(name): clean(text) for name, text in facts.items() if text}

    @property
    def title(self) -> str:
        """One line: run and version of jbclog."""
        return clean(f"exported by jbclog {__version__} from run {self.run.name}")

    def _computed(self, table: str) -> pa.Table:
        return self.joints if table == "joints" else self.run.alarm_findings().table()

    def _run_facts(self) -> dict[str, str]:
        manifest = self.run.manifest
        is_sealed = manifest.is_sealed
        recipes = [
            f"{one.name} revision {one.revision} (SHA-256 {one.sha256})" for one in manifest.recipes
        ]
        return {
            "run": self.run.name,
            "fingerprint": (
                manifest_sha256(self.run.folder) if is_sealed else "none: the run is not sealed"
            ),
            "state": (
                ending(manifest.exit_status, SEALED)
                if is_sealed
                else "not sealed: being recorded, or cut off by a crash"
            ),
            "lost": manifest.lost.text if manifest.lost is not None else "",
            "start": manifest.start or "",
            "stop": manifest.stop or "",
            "verdict": f"{manifest.verdict} (rules {manifest.rules})" if manifest.verdict else "",
            "line": manifest.line.name if manifest.line is not None else "",
            "recipe": "; ".join(recipes),
        }

    def _stated(self) -> dict[str, str]:
        """Return what people stated; the name of a tag has a prefix, so that it replaces no
        fact.
        """
        said = self.run.manifest.metadata
        several = {"wire lots": said.wire_lots, "flux lots": said.flux_lots, "tips": said.tips}
        single = {"operator": said.operator, "order": said.order, "product": said.product}
        texts = {name: text or "" for name, text in single.items()} | {
            name: ", ".join(texts) for name, texts in several.items()
        }
        return (
            texts
            | {"units": ", ".join(self._serials())}
            | {f"tag {name}": text for name, text in said.tags.items()}
        )

    def _serials(self) -> list[str]:
        late = late_serials(self.run.folder) if self.run.manifest.is_sealed else []
        return list(dict.fromkeys([*self.run.manifest.serials(), *late]))

    def _notes(self) -> dict[str, str]:
        """Return the annotations of a sealed run. Acknowledgements are also in the table of
        alarms.
        """
        if not self.run.manifest.is_sealed:
            return {}
        said = read_annotations(self.run.folder).said
        return {
            f"note {one.seq}": f"{one.time} {one.kind} by {one.who}: {one.what} ({one.why})"
            for one in said
        }
