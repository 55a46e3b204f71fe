"""The joints of a report: the derived tables as files, figures by port and by unit, and their
chart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from io import SEEK_END, BytesIO
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from jbclog.analysis.derived_files import Origin, derived_files
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.curves import Floats
from jbclog.analysis.figures.style import NARROW, WIDE, Format
from jbclog.analysis.run import Run
from jbclog.analysis.run_alarms import Alarms
from jbclog.analysis.run_derived import derived_tables
from jbclog.analysis.run_joints import OF_SPANS, joints_of_port
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.analysis.verdict.quantiles import censored_quantile
from jbclog.core.text import clean, csv_text
from jbclog.record.folder import derived_file
from jbclog.report.column_csv import csv_lines
from jbclog.report.facts import FigureFacts, JointFacts
from jbclog.report.joint_chart import RecoveryChart, draw_chart, recovery_chart
from jbclog.report.joint_words import never_back
from jbclog.report.text import Row

__all__ = ["COLUMNS", "Joints", "joint_facts", "joints_of", "unit_rows"]

UNIT: Final = "unit"
ROWS_AT_ONCE: Final = 16_384
COLUMNS: Final = tuple(JOINTS_SCHEMA.names[1:])  # columns of tables/joints.csv, all but `run`
METRICS: Final[tuple[str, ...]] = (
    *("joints", "joints_kind_not_known", "joints_not_recovered", "recovered_before_next_percent"),
    *(
        "joint_deficit_c",
        "joint_resting_below_c",
        "recovery_s",
        "recovery_p95_s",
        "idle_error_c",
        "joint_depth_c",
    ),
    *("joint_dwell_s", "joint_heat_permille_s", "joint_heat_j", "joint_energy_permille_s"),
    *(
        "joints_by_heat",
        "joints_by_feeder",
        "joints_fed_alone",
        "feeds_without_draw",
        "draws_without_feed",
    ),
)
OF_JOINTS: Final = "joints"
OF_CHART: Final = ("recovery_s", "deficit_c", "had_s", "recovered")
SHOWN: Final = list(dict.fromkeys(("station", "port", UNIT, *OF_SPANS, *OF_CHART)))
AT_WORK: Final = "power_mean_permille"  # without it the tool never worked and made no joints

Recovery = tuple[float | None, float | None, bool | None]
"""The recovery of a joint in s, the time until the next joint, and whether the tip recovered before
it.
"""


@dataclass(frozen=True, slots=True)
class Joints:
    """All joints of a run: their table with the columns `SHOWN`, the files of all derived tables,
    and the metrics of the run.

    All columns of a hundred thousand joints, a week of a port, take 22 MB as a table.
    """

    table: pa.Table
    files: Mapping[str, bytes]
    metrics: list[Row]
    taken: list[Row]
    # metrics of each port by name
    by_port: Mapping[tuple[object, object], dict[str, Row]]

    def of_port(self, station: str, port: int, columns: Sequence[str]) -> pa.Table:
        """Return these columns of the joints of one port."""
        return joints_of_port(self.table, station, port, columns)

    def metrics_of(self, station: str, port: int) -> dict[str, Row]:
        """Return the metrics of one port by their names."""
        return self.by_port.get((station, port), {})

    def csv(self) -> bytes:
        """Return the table as CSV, encoding a few thousand rows at a time."""
        out = BytesIO(csv_text(COLUMNS, ()).encode())
        out.seek(0, SEEK_END)
        parquet = self.files[derived_file("joints")]
        with pq.ParquetFile(pa.BufferReader(parquet)) as file:
            batches = file.iter_batches(ROWS_AT_ONCE, columns=[*COLUMNS], use_threads=False)
            for number, batch in enumerate(batches):
                out.write(csv_lines(_cleaned(pa.Table.from_batches([batch]))))
                if not number % 8:  # memory between the growing file's pieces
                    pa.default_memory_pool().release_unused()
        return out.getvalue()


def _cleaned(joints: pa.Table) -> pa.Table:
    """Return the joints without invisible characters in what people typed."""
    for name in ("unit", "tip"):
        texts = [text and clean(text) for text in joints[name].to_pylist()]
        place = joints.schema.get_field_index(name)
        joints = joints.set_column(place, name, pa.array(texts, pa.string()))
    return joints


def joints_of(run: Run, alarms: Alarms) -> Joints:
    """Find the joints in the samples; the same run gives the same bytes. Raises `RecordError`."""
    origin = Origin.of(run.folder)
    measures = joints_and_metrics(run)
    files = derived_files(derived_tables(run, measures, alarms), origin)
    metrics = [asdict(row) for row in measures.metrics]
    by_port: dict[tuple[object, object], dict[str, Row]] = {}
    for row in metrics:
        by_port.setdefault((row["station"], row["port"]), {})[str(row["metric"])] = row
    table, taken = measures.joints.select(SHOWN), measures.parameters
    del measures
    pa.default_memory_pool().release_unused()  # memory of the search, between what is kept
    return Joints(table, files, metrics, taken, by_port)


def joint_facts(
    found: Joints, station: str, port: int, file: str, *, crowded: bool
) -> JointFacts | None:
    """Return the figures of one port and its chart, whose file begins with `file`; None for a tool
    that makes no joints.
    """
    metrics = found.metrics_of(station, port)
    if OF_JOINTS not in metrics or not metrics[AT_WORK]["n"]:
        return None
    joints = found.of_port(station, port, OF_CHART)
    recovery, deficits, had = (
        _floats(joints[name]) for name in ("recovery_s", "deficit_c", "had_s")
    )
    late = _floats(pc.equal(joints["recovered"], False).cast(pa.float64())) == 1
    resolution = metrics["recovery_s"]["resolution"]
    chart = recovery_chart(
        recovery,
        resolution if isinstance(resolution, float) else None,
        deficits,
        np.where(late, had, np.nan),
    )
    figure = _figure(chart, f"{station}, port {port}", file, crowded=crowded)
    figures = {name: metrics[name] for name in METRICS if name in metrics}
    taken = next(
        ({**row} for row in found.taken if row["station"] == station and row["port"] == port), {}
    )
    never = never_back(
        int(late.sum()),
        int(np.count_nonzero(~joints["recovered"].is_null().to_numpy())),
        _value(figures, "joint_deficit_c"),
    )
    return JointFacts(figures, len(recovery), taken, never, chart.signals, *chart.why, figure)


def _figure(chart: RecoveryChart, place: str, file: str, *, crowded: bool) -> FigureFacts | None:
    if not chart.is_worth_it:
        return None
    wide = _svg(chart, WIDE)
    return FigureFacts(
        f"figures/{file}-joints.svg",
        chart.caption,
        f"{place}: {chart.caption}",
        wide,
        wide if crowded else _svg(chart, NARROW),
    )


def _svg(chart: RecoveryChart, form: Format) -> str:
    return svg_text(draw_chart(chart, form))


def _value(figures: Mapping[str, Row], name: str) -> float | None:
    value = figures[name]["value"] if name in figures else None
    return value if isinstance(value, float) else None


def _floats(column: pa.ChunkedArray) -> Floats:
    return np.asarray(column.to_numpy(), dtype=np.float64)


def unit_rows(found: Joints) -> list[Row]:
    """Return the joints that were found in each unit, and their recovery, in order of their begin.
    How many a unit has is known only where no gap hides some: `Run.units()`.
    """
    units = found.table[UNIT].to_pylist()
    if not any(units):
        return []
    joints = zip(
        *(found.table[name].to_pylist() for name in ("recovery_s", "had_s", "recovered")),
        strict=True,
    )
    by_unit: dict[str | None, list[Recovery]] = {}
    for unit, joint in zip(units, joints, strict=True):
        by_unit.setdefault(unit, []).append(joint)
    return [
        {UNIT: unit, "joints_found": len(these), **_recovery(these)}
        for unit, these in by_unit.items()
    ]


def _recovery(joints: Sequence[Recovery]) -> Row:
    """Return the median recovery of one unit, and its slowest if all were seen: a recovery cut
    short by the next joint was longer.
    """
    known = [seconds for seconds, _, _ in joints if seconds is not None]
    late = sum(back is False for _, _, back in joints)
    times = [(had, False) if seconds is None else (seconds, True) for seconds, had, _ in joints]
    middle = censored_quantile([one for one in times if one[0] is not None], 0.5)
    return {
        "recovery_n": len(known),
        "not_recovered": late,
        "recovery_p50_s": None if middle is None else round(middle, 3),
        "recovery_slowest_s": max(known) if known and not late else None,
    }
