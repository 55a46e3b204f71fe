"""From a jobs file to jobs: what each is to do, checked as a whole before the first of them begins."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from jbclog.app.run.plan import Metadata, Plan, RunOptions
from jbclog.app.run.runner import Job
from jbclog.config.durations import span_s
from jbclog.config.job_order import Turn, read_at
from jbclog.config.jobs_file import JobsFile, JobTable
from jbclog.config.line import AUTO, Line, load_line
from jbclog.config.toml_reader import shortened
from jbclog.core.errors import Problem, Problems, UsageError
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
    """A job, where it reads the serials of its units, and the one that was read already."""

    job: Job
    units_from: str | None = None
    first_unit: str | None = None


@dataclass(frozen=True, slots=True)
class Orders:
    """What a jobs file comes to: an order and a turn for each job, in the file's order, and what is in order but worth a note."""

    file: JobsFile
    line: Line
    orders: dict[str, JobSpec]
    turns: tuple[Turn, ...]
    stations: dict[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()


def orders_of(file: JobsFile, out: Path) -> Orders:
    """What the jobs are to do, below `out`. Raises `Problems` with everything that is wrong with any of them (exit 2)."""
    line = load_line(file.line)
    problems: list[Problem] = []
    planned: list[Problem] = []
    chosen: dict[str, tuple[str, ...]] = {}
    orders: dict[str, JobSpec] = {}
    notes: dict[str, None] = {}
    for place, job in enumerate(file.jobs):
        known = len(problems)
        chosen[job.name] = tuple(_chosen(file, line, place, job, problems))
        orders[job.name] = JobSpec(_job(file, job, chosen[job.name], out), file.reader(job))
        plan = _plan(file, place, orders[job.name], planned) if len(problems) == known else None
        notes |= dict.fromkeys((*(plan.notes if plan else ()), *_not_there_yet(job.name, orders[job.name])))
    if problems or planned:
        raise Problems(shortened([*problems, *_each_once(planned)]))
    turns = tuple(_turn(file, job, chosen[job.name]) for job in file.jobs)
    return Orders(file, line, orders, turns, chosen, tuple(notes))


def _chosen(file: JobsFile, line: Line, place: int, job: JobTable, problems: list[Problem]) -> Sequence[str]:
    """The names of the job's stations, in the line's order."""
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
        text = f"no station of the line {line.name} is of these families"
        text += '; those that are "auto" are known when they answer: name them in stations' if auto else ""
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
    wanted = RunOptions(
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
    return Job(wanted, out.absolute(), job.name)


def _rate(value: object) -> float | str | None:
    return float(value) if isinstance(value, int | float) else cast(str | None, value)


def _plan(file: JobsFile, place: int, order: JobSpec, problems: list[Problem]) -> Plan | None:
    """Everything that can be known to be wrong with a job, with its place in the jobs file."""
    source = order.units_from
    if source is not None and is_plain_file(source):
        text = f'"{source}" is a plain file, whose lines do not come one after the other; give them as serials = [...]'
        problems.append(file.problem(place, ("units_from",), text))
    try:
        return order.job.plan()
    except Problems as error:
        problems += [file.problem(place, (), in_keys(str(problem))) for problem in error.problems]
    except UsageError as error:
        problems.append(file.problem(place, (), in_keys(str(error))))
    return None


def _not_there_yet(name: str, order: JobSpec) -> list[str]:
    """A reader may be plugged in until its job begins, as a station may; who starts a night wants to know it before."""
    source = order.units_from
    return [] if source is None or Path(source).exists() else [f"{name}: its reader {source} is not there yet"]


def in_keys(text: str) -> str:
    """A sentence about what a run was not told, with the keys of a jobs file for the options of the command line."""
    text = _TAG.sub(r'tags = { \1 = "…" }', text)
    for option, key in KEYS.items():
        text = text.replace(f"{option} …", key)
    return text.replace("--tip ", "tips: ")


def _each_once(problems: list[Problem]) -> list[Problem]:
    """What is wrong with a recipe is wrong with each job that has it, and told of the first."""
    first: dict[str, Problem] = {}
    for problem in problems:
        first.setdefault(problem.text, problem)
    return [*first.values()]


def _turn(file: JobsFile, job: JobTable, stations: Sequence[str]) -> Turn:
    reader = () if job.units_from is None else (f"the reader {file.reader(job)}",)
    at = None if job.at is None else read_at(job.at)
    return Turn(job.name, frozenset((*stations, *reader)), job.after, file.policy(job), at)
