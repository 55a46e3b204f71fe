"""Writes `report.html`, `report.pdf`, `report.json`, figures, tables and the derived tables into
the folder of a run, each atomically.

The same run and versions give the same bytes: no creation time, no random names, everything sorted.
"""

from __future__ import annotations

import gc
import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import pyarrow as pa

from jbclog.analysis.run import open_run
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_whole
from jbclog.core.errors import RecordError
from jbclog.core.text import cleaned
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read as read_annotations
from jbclog.record.annotations import vouch
from jbclog.record.folder import expect_no_links
from jbclog.report.facts import Facts, FigureFacts
from jbclog.report.gather import gather
from jbclog.report.joints import joints_of
from jbclog.report.page import render
from jbclog.report.paper import report_pdf
from jbclog.report.spreadsheet import csv_tables

DRAWINGS = ("wide", "narrow", "zoom")
COLLECTED = (5000, 10, 5)
PAGE, DATA, PAPER, TABLES = "report.html", "report.json", "report.pdf", "tables"


def write_report(folder: Path | str) -> Path:
    """Write the report of the sealed run in `folder`; return the path of its page.

    Raises `RecordError`.
    """
    folder = Path(folder)
    expect_no_links(folder)
    for name, content in _with_recorded_hash(folder).items():
        _write(folder / name, content)
    return folder / PAGE


def _with_recorded_hash(folder: Path) -> dict[str, bytes]:
    """Return every file of a report, after recording the hash of `report.json`, which has the
    hashes of all others, in the annotations.

    The annotation comes first: after a crash an unchanged report may count as changed, never a
    changed one as unchanged. Raises `RecordError`.
    """
    files = report_files(folder)
    wrong = read_annotations(folder).wrong
    vouch(folder, hashlib.sha256(files[DATA]).hexdigest())
    if read_annotations(folder).wrong == wrong:
        return files
    files = report_files(folder)  # the line replaces one that was cut off: that complaint is gone
    vouch(folder, hashlib.sha256(files[DATA]).hexdigest())
    return files


@contextmanager
def _memory_given_back() -> Iterator[None]:
    """Let Arrow use the system's allocator: its own pool keeps the memory of decoding, twice the
    rows of a long run.
    """
    before = pa.default_memory_pool()
    pa.set_memory_pool(pa.system_memory_pool())
    try:
        yield
    finally:
        pa.set_memory_pool(before)


@contextmanager
def _rarely_collected() -> Iterator[None]:
    """Let the garbage collector look at 5000 new objects at a time, not at 700: joints are tuples,
    half a million in a day of 32 ports, and none of them is garbage.
    """
    before = gc.get_threshold()
    gc.set_threshold(*COLLECTED)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@_memory_given_back()
@_rarely_collected()
def report_files(folder: Path) -> dict[str, bytes]:
    """Return file name -> content for every file of a report.

    Raises `RecordError`, also for a run that is still open.
    """
    run = open_run(folder)
    if not run.manifest.is_sealed:
        raise RecordError(
            f"{folder} is still open: it is being recorded, or a crash left it open; run `jbclog"
            " recover` to finish it"
        )
    alarms = run.alarm_findings()
    joints = joints_of(run, alarms)
    facts = gather(run, joints, alarms)
    document, figures = as_document(facts), figures_of(facts)
    drawn = {figure.file: (figure.wide, figure.narrow) for figure in figures}
    zooms = {figure.file: figure.zoom for figure in figures if figure.zoom is not None}
    paper = report_pdf(facts)
    pa.default_memory_pool().release_unused()  # memory of typesetting, before long tables
    files = {
        **{file: wide.encode() for file, (wide, _) in drawn.items()},
        PAGE: render(document, drawn, zooms).encode(),
        PAPER: paper,
        **joints.files,
        **{
            f"{TABLES}/{name}.csv": content
            for name, content in csv_tables(document, joints).items()
        },
    }
    written = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    vouched = {**document, **tools(), "vouched_in": ANNOTATIONS, "written": written}
    return {
        **files,
        DATA: (json.dumps(vouched, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(),
    }


def tools() -> dict[str, str]:
    """Return what sets the paper and draws the figures, by its key in `report.json`: other versions
    may give other bytes.
    """
    return {
        "paper_by": f"typst {metadata.version('typst')}",
        "drawn_by": f"matplotlib {metadata.version('matplotlib')}",
    }


def figures_of(facts: Facts) -> list[FigureFacts]:
    """Return every figure of a report."""
    ports = [port for station in facts.stations for port in station.ports]
    charts = [port.joints.chart for port in ports if port.joints is not None]
    return [
        one
        for one in (facts.overview, *(one for port in ports for one in port.figures), *charts)
        if one is not None
    ]


def as_document(facts: Facts) -> Mapping[str, object]:
    """Return the facts as plain data without drawings, every text cleaned: the source of
    `report.json` and the page.
    """
    plain = cleaned(_without_drawings(asdict(facts)))
    assert isinstance(plain, dict)
    return plain


def _without_drawings(value: object) -> object:
    """Return the value with only file and texts of each figure."""
    if isinstance(value, dict):
        is_figure = {"file", "wide", "narrow"} <= value.keys()
        return {
            key: _without_drawings(one)
            for key, one in value.items()
            if not (is_figure and key in DRAWINGS)
        }
    return [_without_drawings(one) for one in value] if isinstance(value, list) else value


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise RecordError(f"{path} cannot be written: {write_failure(error, path)}") from error
