"""Many short sealed runs of one station, each with its own course: for what looks at runs side by
side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from jbclog.record.manifest import Metadata, iso, read_manifest, write_manifest
from support.records.sealed_run import samples, seal, station, table

ROWS = 300  # 30 s at 10 Hz
BEGIN = datetime(2026, 9, 21, 6, 0, tzinfo=UTC)


def one_run(
    out: Path,
    number: int,
    error_c: float = 0.0,
    *,
    seed: int | None = None,
    name: str = "dde-1",
    rows: int = ROWS,
    still: bool = False,
    run: str | None = None,
    joints_until_s: float | None = None,
    **said: object,
) -> Path:
    """A sealed run, an hour after the one before, whose idle tip is `error_c` off its setting: it
    rests in the second half, or from
    `joints_until_s` on; a
    `still` one without noise; `run` is its name.
    """
    seed = number if seed is None else seed
    columns = samples(rows, name, seed=seed, joints_until_s=joints_until_s or rows / 20)
    settled = np.arange(rows) >= 30
    dither = np.zeros(rows) if still else np.random.default_rng(number).random(rows)
    if still:
        columns["temperature_c"] = np.where(settled, 350.0, columns["temperature_c"])
    columns["temperature_c"] = columns["temperature_c"] + np.where(
        settled, np.floor(error_c + dither), 0
    )
    began = BEGIN + timedelta(hours=number)
    letters = "".join("abcdefghij"[digit] for digit in (number // 10 % 10, number % 10))
    run = run or f"{began:%Y%m%dT%H%M%SZ}-bench-{letters}aa"
    folder = seal(out, [station(name, rows=rows)], table(columns), run=run, **said)
    at = [
        iso(int((began + timedelta(seconds=second)).timestamp() * 1e6)) for second in (0, rows / 10)
    ]
    _retold(folder, at)
    return folder


def _retold(folder: Path, at: Sequence[str]) -> None:
    write_manifest(folder, replace(read_manifest(folder), run=folder.name, start=at[0], stop=at[1]))


def many_runs(out: Path, errors_c: Sequence[float], **said: object) -> list[Path]:
    """A run for each error, in their order."""
    return [one_run(out, number, error, **said) for number, error in enumerate(errors_c)]


def told(**said: object) -> Metadata:
    return Metadata(**said)  # type: ignore[arg-type]  # test helper
