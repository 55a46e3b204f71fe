"""Jobs files: the jobs of a batch, their stations and start times, and the effect of a failure."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from jbclog.config.durations import EXAMPLES, span_s
from jbclog.config.job_order import AT_ALLOWED, OnFailure, circle, read_at
from jbclog.config.schema import (
    NAME_ALLOWED,
    FamilyName,
    FromList,
    Name,
    Table,
    read_file,
    read_table,
    said,
    shared,
    shown,
    unknown,
    without_case,
)
from jbclog.core.errors import Problem, Problems
from jbclog.core.toml import KeyPath, TomlText, parse, read_text, shortened
from jbclog.protocol.commands.family import FAMILIES

IS_NO_BATCH: Final = (
    "this is not a jobs file; one has [batch] with the line, and a [[job]] for each job"
)
GOALS: Final = ("units", "joints")  # a duration beside one of them is the upper bound
END_ALLOWED: Final = (
    'give one end: duration = "15m", units = 40 or joints = 200; a duration given with units or'
    " joints is the time limit"
)
_POLICIES: Final = "one of stop, skip, continue"
LONGEST_TEXT: Final = 200
MOST: Final = 1_000_000


def _span(value: str) -> str:
    if span_s(value) is None:
        raise said(f"{shown(value)} is not allowed; {EXAMPLES}")
    return value


def _at(value: str) -> str:
    if read_at(value) is None:
        raise said(f"{shown(value)} is not allowed; {AT_ALLOWED}")
    return value


def _rate(value: object) -> object:
    if value in ("auto", "fit", "max") or (
        isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= 1000
    ):
        return value
    raise said(f"{shown(value)} is not allowed; {RATES}")


Text = Annotated[str, Field(min_length=1, max_length=LONGEST_TEXT)]
Texts = Annotated[tuple[Text, ...], FromList]
RATES: Final = 'Hz up to 1000, "auto", "fit" or "max"'
TEXT_ALLOWED: Final = f"a text of 1 to {LONGEST_TEXT} characters"
TEXTS_ALLOWED: Final = f"a list of texts of 1 to {LONGEST_TEXT} characters"
Policy = Literal["stop", "skip", "continue"]


class BatchTable(Table):
    line: Path = Field(strict=False, description="a line file's path, from this file's folder")
    on_failure: Policy = Field("stop", description=_POLICIES)


class JobTable(Table):
    """A table `[[job]]`."""

    name: Name = Field(description=NAME_ALLOWED)
    recipe: Path | None = Field(
        None, strict=False, description="a recipe file's path, from this file's folder"
    )
    stations: Annotated[tuple[Name, ...], FromList] | None = Field(
        None, min_length=1, description="a list of stations of the line, by name"
    )
    families: Annotated[tuple[FamilyName, ...], FromList] | None = Field(
        None,
        min_length=1,
        description=f"a list of some of {', '.join(FAMILIES)}: all stations of these",
    )
    duration: Annotated[str, AfterValidator(_span)] | None = Field(None, description=EXAMPLES)
    units: int | None = Field(
        None, ge=1, le=MOST, description=f"how many units, a whole number from 1 to {MOST}"
    )
    joints: int | None = Field(
        None, ge=1, le=MOST, description=f"how many joints, a whole number from 1 to {MOST}"
    )
    units_from: Text | None = Field(
        None, description="a barcode reader's device, or a pipe, that serials are read from"
    )
    at: Annotated[str, AfterValidator(_at)] | None = Field(None, description=AT_ALLOWED)
    after: Annotated[tuple[Name, ...], FromList] = Field(
        (), description="a list of other jobs, by name"
    )
    on_failure: Policy | None = Field(None, description=_POLICIES)
    operator: Text | None = Field(None, description=TEXT_ALLOWED)
    order: Text | None = Field(None, description=TEXT_ALLOWED)
    product: Text | None = Field(None, description=TEXT_ALLOWED)
    serials: Texts = Field((), description=TEXTS_ALLOWED)
    wire_lots: Texts = Field((), description=TEXTS_ALLOWED)
    flux_lots: Texts = Field((), description=TEXTS_ALLOWED)
    tips: Texts = Field((), description="a list of ID, STATION=ID or STATION:PORT=ID")
    tags: dict[Text, Text] = Field({}, description="names and texts")
    rate: Annotated[object, AfterValidator(_rate)] | None = Field(None, description=RATES)
    wire: bool = Field(False, description="true or false: whether every byte is kept with its time")
    allow_omega_write: bool = Field(False, description="true or false")
    allow_missing: bool = Field(
        False,
        description="true or false: whether it starts without stations that are missing or refuse",
    )


class BatchTables(Table):
    batch: BatchTable = Field(description='a table with the line: [batch] line = "line.toml"')
    job: Annotated[tuple[dict[str, object], ...], FromList] = Field(
        min_length=1, description="at least one table [[job]] with a name and an end"
    )


@dataclass(frozen=True, slots=True)
class JobsFile:
    """A checked jobs file. Paths are absolute."""

    source: TomlText
    line: Path
    jobs: tuple[JobTable, ...]
    on_failure: OnFailure

    @property
    def path(self) -> Path:
        return self.source.path

    def policy(self, job: JobTable) -> OnFailure:
        return self.on_failure if job.on_failure is None else OnFailure(job.on_failure)

    def recipe(self, job: JobTable) -> Path | None:
        return None if job.recipe is None else self.path.absolute().parent / job.recipe

    def reader(self, job: JobTable) -> str | None:
        return None if job.units_from is None else str(self.path.absolute().parent / job.units_from)

    def asked(self, job: JobTable) -> str:
        """Format a job's request as a line of JSON, which is stored, and compared when the batch
        resumes.
        """
        given = job.model_dump(mode="json", exclude_defaults=True) | {
            "on_failure": self.policy(job).value
        }
        return json.dumps({"line": str(self.line)} | given, ensure_ascii=False, sort_keys=True)

    def problem(self, place: int, key: KeyPath, text: str) -> Problem:
        """Return a problem of job number `place`."""
        return self.source.problem(("job", place, *key), text)


def load_jobs(path: Path, line: Path | None = None) -> JobsFile:
    """Read a jobs file, optionally for another `line`. Raises Problems with all its mistakes."""
    return parse_jobs(read_text(path), path, line)


def parse_jobs(text: str, path: Path, line: Path | None = None) -> JobsFile:
    """Parse a jobs file; relative paths are relative to the folder of `path`."""
    source = parse(text, str(path))
    if not {"batch", "job"} & source.tables.keys():
        raise Problems([Problem(source.file, None, "", IS_NO_BATCH)])
    tables, problems, _ = read_file(BatchTables, source)
    jobs = [_read_job(source, place, table, problems) for place, table in source.rows("job")]
    problems += _between(source)
    if problems or tables is None:
        raise Problems(shortened(problems))
    placed = (line or path.absolute().parent / tables.batch.line).absolute()
    return JobsFile(
        source,
        placed,
        tuple(job for job in jobs if job is not None),
        OnFailure(tables.batch.on_failure),
    )


def _read_job(
    source: TomlText, place: int, table: dict[str, object], problems: list[Problem]
) -> JobTable | None:
    at: KeyPath = ("job", place)
    job, wrong, _ = read_table(JobTable, source, at, table)
    problems += wrong
    problems += _of_one(source, at, table)
    return job


def _of_one(source: TomlText, at: KeyPath, table: dict[str, object]) -> Iterator[Problem]:
    """Yield conflicts between the keys of a job."""
    goals = [key for key in GOALS if key in table]
    if not goals and "duration" not in table:
        yield source.problem((*at, "duration"), f"missing; {END_ALLOWED}")
    for key in goals[1:]:
        yield source.problem((*at, key), f"cannot be combined with {goals[0]}; {END_ALLOWED}")
    if "stations" in table and "families" in table:
        yield source.problem(
            (*at, "families"),
            "cannot be combined with stations; give one of the two, or none for the whole line",
        )
    if "units" in table and "units_from" not in table:
        yield source.problem(
            (*at, "units_from"),
            "missing; units are counted by their serials: name the reader's device or a pipe",
        )


def _between(source: TomlText) -> Iterator[Problem]:
    """Yield duplicate names, and jobs that wait for unknown jobs or for each other."""
    tables = list(source.rows("job"))
    names = [(place, table.get("name")) for place, table in tables]
    places: dict[str, int] = {}
    for place, name in names:
        if isinstance(name, str):
            places.setdefault(name, place)
    compared = [(place, without_case(name)) for place, name in names]
    yield from shared(source, "job", "name", compared, "is the name of two jobs")
    after = {str(table.get("name")): _after(table) for _, table in tables}
    for place, table in tables:
        for number, other in enumerate(_after(table)):
            if other not in places:
                yield source.problem(
                    ("job", place, "after", number),
                    f"{shown(other)} is {unknown(other, [*places])}",
                )
    around = circle(
        {name: [one for one in others if one in after] for name, others in after.items()}
    )
    if around:
        way = " waits for ".join(around)
        yield source.problem(
            ("job", places.get(around[0], 0), "after"), f"{way}: none of them could begin"
        )


def _after(table: dict[str, object]) -> list[str]:
    others = table.get("after")
    return [one for one in others if isinstance(one, str)] if isinstance(others, list) else []
