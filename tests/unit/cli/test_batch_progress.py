"""What a person sees of a batch: its live table, its jobs' events, the table at its end."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from jbclog.app.batch.job_dir import JobProgress, PortProgress
from jbclog.app.batch.state import Attempt, State
from jbclog.cli import batch_progress
from jbclog.cli.options import Color
from jbclog.cli.progress import event_line
from jbclog.cli.terminal import Column, Printer, fitting
from jbclog.config.jobs_file import parse_jobs
from jbclog.core.rows import EventRow, Severity

RUN = "20261123T163556Z-bench-wfe6"
JOBS = (
    '[batch]\nline = "line.toml"\n[[job]]\nname = "top-side"\nrecipe = "r.toml"\nduration ='
    ' "90s"\norder = "88123"\n'
)


def shift(progress: JobProgress) -> Any:
    """A batch of one job, which was recorded."""
    attempt = Attempt(
        1,
        "2026-11-23T16:35:54+00:00",
        run=RUN,
        state=State.NOT_FINE,
        stop="2026-11-23T16:36:10+00:00",
        exit_code=1,
    )
    attempt.verdict = "INCONCLUSIVE"
    job = SimpleNamespace(
        name="top-side", attempts=[attempt], last=attempt, state=State.NOT_FINE, is_over=True
    )
    state = SimpleNamespace(jobs={"top-side": job}, running=lambda: [job])
    folder = SimpleNamespace(progress=lambda: progress, folder=Path("jobs"))
    file = parse_jobs(JOBS, Path("night.toml"))
    plan = SimpleNamespace(specs={"top-side": None}, stations={"top-side": ["dde-1"]}, file=file)
    return SimpleNamespace(
        state=state, plan=plan, processes=SimpleNamespace(job_dir=lambda name, number: folder)
    )


def end_table(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int | None
) -> tuple[list[str], str]:
    monkeypatch.setattr("sys.stdout.isatty", lambda: width is not None)
    monkeypatch.setattr(
        batch_progress.shutil,
        "get_terminal_size",
        lambda *_, **__: os.terminal_size((width or 1, 24)),
    )
    batch_progress.print_table(shift(JobProgress()), Path("runs"))
    out, err = capsys.readouterr()
    return out.splitlines(), err


@pytest.mark.parametrize(
    ("width", "heads"),
    [
        (None, ["job", "stations", "result", "exit", "verdict", "started", "duration", "run"]),
        (200, ["job", "stations", "result", "exit", "verdict", "started", "duration", "run"]),
        (80, ["job", "result", "exit", "verdict", "run"]),
        (60, ["job", "result", "verdict"]),
    ],
)
def test_the_table_at_the_end_fits_the_terminal_and_is_whole_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    width: int | None,
    heads: Sequence[str],
) -> None:
    lines, notes = end_table(monkeypatch, capsys, width)
    assert lines[0].split() == heads
    assert len(lines) == 2
    assert width is None or max(map(len, lines)) <= width
    has_run = "run" in heads
    assert (f"runs/{RUN}" in lines[1]) is has_run
    assert notes == (
        "" if has_run else "the runs are in runs; `jbclog runs runs --tag batch=night` lists them\n"
    )


def test_a_running_job_has_its_order_unit_and_coverage() -> None:
    port = PortProgress("dde-1", 1, 350.0, 350.0, "working")
    now = JobProgress(40.0, "recording", 1, [port], unit="SN-7", due=1000, obtained=997)
    text = io.StringIO()
    screen = batch_progress.Screen.__new__(batch_progress.Screen)
    batch_progress.Lines.__init__(screen, shift(now), Printer(Color.NEVER))
    screen._asked = {job.name: job for job in screen._batch.plan.file.jobs}
    screen._printer.console = Console(file=text, width=150)
    following = SimpleNamespace(wait=[])
    screen._printer.console.print(screen._table(screen._batch.state, following))  # type: ignore[arg-type]
    (row,) = (line for line in text.getvalue().splitlines() if "top-side" in line)
    cells = [cell.strip() for cell in re.split("│", row)[1:-1]]
    progress = "40 s of 1:30, 50 s left"
    assert cells == [
        "top-side",
        "dde-1",
        "88123",
        "SN-7",
        progress,
        "recording",
        "working 350 °C",
        "1",
        "99.7 %",
        "3",
    ]


def test_a_column_without_a_cell_goes_before_all_others() -> None:
    columns = [
        Column("job"),
        Column("order", dropped=1),
        Column("unit", dropped=2),
        Column("lost", dropped=3),
    ]
    assert [one.name for one in fitting(columns, [("a", "88123", "", "1")], 24)[0]] == [
        "job",
        "order",
        "lost",
    ]
    assert [one.name for one in fitting(columns, [("a", "88123", "SN-1", "1")], 24)[0]] == [
        "job",
        "unit",
        "lost",
    ]


def test_an_event_of_a_job_begins_with_its_time_as_every_line_does() -> None:
    event = EventRow(0, "alarm", Severity.ERROR, "too hot", "dde-1")
    assert event_line(event, "top-side") == "00:00:00Z  error     top-side: dde-1: too hot"
