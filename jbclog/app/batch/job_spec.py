"""Plans the jobs of a jobs file and checks all of them before the first one starts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from jbclog.app.run.options import Metadata, RunOptions
from jbclog.app.run.plan import Plan
from jbclog.app.run.runner import Job
from jbclog.config.durations import span_s
from jbclog.config.job_order import Turn, read_at
from jbclog.config.jobs_file import JobsFile, JobTable
from jbclog.config.line import AUTO, Line, load_line
from jbclog.core.errors import Problem, Problems, UsageError
from jbclog.core.toml import shortened
from jbclog.transport.typed_lines import is_plain_file

KEYS: Final = {
    "--operator": 'operator = "…"',
    "--order": 'order = "…"',
    "--product": 'product = "…"',
    "--unit": 'serials = ["…"]',
    "--tip": 'tips = ["…"]',
    "--wire-lot": 'wire_lots = ["…"]',
    "--flux-lot": 'flux_lots = ["…"]',
}
_TAG: Final = re.compile(r"--tag (\S+)=…")


@dataclass(frozen=True, slots=True)
class JobSpec:
    """A job, its source of unit serials, and the serial already read from it."""

    job: Job
    units_from: str | None = None
    first_unit: str | None = None


@dataclass(frozen=True, slots=True)
class BatchPlan:
    """The jobs of a jobs file in order: a spec and a turn for each, and notes for the user."""

    file: JobsFile
    line: Line
    specs: dict[str, JobSpec]
    turns: tuple[Turn, ...]
    stations: dict[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()


def plan_batch(file: JobsFile, out: Path) -> BatchPlan:
    """Plan the jobs, which record below `out`. Raises `Problems` with all problems (exit 2)."""
    line = load_line(file.line)
    problems: list[Problem] = []
    planned: list[Problem] = []
    chosen: dict[str, tuple[str, ...]] = {}
    specs: dict[str, JobSpec] = {}
    notes: dict[str, None] = {}
    for place, job in enumerate(file.jobs):
        known = len(problems)
        chosen[job.name] = tuple(_chosen(file, line, place, job, problems))
        specs[job.name] = JobSpec(_job(file, job, chosen[job.name], out), file.reader(job))
        plan = _plan(file, place, specs[job.name], planned) if len(problems) == known else None
        notes |= dict.fromkeys(
            (*(plan.notes if plan else ()), *_missing_reader(job.name, specs[job.name]))
        )
    if problems or planned:
        raise Problems(shortened([*problems, *_each_once(planned)]))
    turns = tuple(_turn(file, job, chosen[job.name]) for job in file.jobs)
    return BatchPlan(file, line, specs, turns, chosen, tuple(notes))


def _chosen(
    file: JobsFile, line: Line, place: int, job: JobTable, problems: list[Problem]
) -> Sequence[str]:
    """Return the names of the job's stations, in the line's order."""
    names = [spec.name for spec in line.stations]
    if job.stations is not None:
        for number, name in enumerate(job.stations):
            if name not in names:
                text = f'"{name}" is not on the line {line.name}; it has {", ".join(names)}'
                problems.append(file.problem(place, ("stations", number), text))
        return [name for name in names if name in job.stations]
    if job.families is None:
        return names
    found = [spec.name for spec in line.stations if spec.family in job.families]
    if not found:
        auto = any(spec.family == AUTO for spec in line.stations)
        text = f"the line {line.name} has no station of these families"
        text += (
            '; families of "auto" stations are known only when they answer: name them in stations'
            if auto
            else ""
        )
        problems.append(file.problem(place, ("families",), text))
    return found


def _job(file: JobsFile, job: JobTable, stations: Sequence[str], out: Path) -> Job:
    tags = {"batch": file.path.stem, "job": job.name} | job.tags
    metadata = Metadata(
        job.operator,
        job.order,
        job.product,
        job.serials,
        tags,
        job.wire_lots,
        job.flux_lots,
        job.tips,
        reads_units=job.units_from is not None,
    )
    options = RunOptions(
        file.line,
        file.recipe(job),
        tuple(stations),
        None if job.duration is None else span_s(job.duration),
        _rate(job.rate),
        metadata,
        wire=job.wire,
        allow_omega_write=job.allow_omega_write,
        allow_missing=job.allow_missing,
        until_units=job.units,
        until_joints=job.joints,
    )
    return Job(options, out.absolute(), job.name)


def _rate(value: object) -> float | str | None:
    return float(value) if isinstance(value, int | float) else cast(str | None, value)


def _plan(file: JobsFile, place: int, spec: JobSpec, problems: list[Problem]) -> Plan | None:
    """Plan a job; add its problems, each with its place in the jobs file."""
    source = spec.units_from
    if source is not None and is_plain_file(source):
        text = (
            f'"{source}" is a regular file: its lines arrive all at once; list them as serials ='
            " [...]"
        )
        problems.append(file.problem(place, ("units_from",), text))
    try:
        return spec.job.plan()
    except Problems as error:
        problems += [file.problem(place, (), in_keys(str(problem))) for problem in error.problems]
    except UsageError as error:
        problems.append(file.problem(place, (), in_keys(str(error))))
    return None


def _missing_reader(name: str, spec: JobSpec) -> list[str]:
    """Return a note if a job's reader is missing: it may be plugged in before the job starts."""
    source = spec.units_from
    return (
        []
        if source is None or Path(source).exists()
        else [f"{name}: its reader {source} is not connected yet"]
    )


def in_keys(text: str) -> str:
    """Replace the options of the command line in a message by the keys of a jobs file."""
    text = _TAG.sub(r'tags = { \1 = "…" }', text)
    for option, key in KEYS.items():
        text = text.replace(f"{option} …", key)
    return text.replace("--tip ", "tips: ")


def _each_once(problems: list[Problem]) -> list[Problem]:
    """Keep the first of equal problems: a mistake in a recipe appears in each job that uses it."""
    first: dict[str, Problem] = {}
    for problem in problems:
        first.setdefault(problem.text, problem)
    return [*first.values()]


def _turn(file: JobsFile, job: JobTable, stations: Sequence[str]) -> Turn:
    reader = () if job.units_from is None else (f"the reader {file.reader(job)}",)
    at = None if job.at is None else read_at(job.at)
    return Turn(job.name, frozenset((*stations, *reader)), job.after, file.policy(job), at)
