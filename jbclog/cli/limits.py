"""`jbclog limits`: fixed control limits from a phase I study."""

from __future__ import annotations

import os
from pathlib import Path

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import echo, echo_json, note, reports_errors
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import RecordError, UsageError

LEARN, SHOW = "learn", "show"


@reports_errors
def limits(
    words: list[str] = typer.Argument(
        ...,
        metavar="learn RUN... | show FILE",
        help="Runs to learn from, or limits file.",
        show_default=False,
    ),
    metric: str = typer.Option(
        "recovery_s", "--metric", "-m", metavar="NAME", help="Metric of joints."
    ),
    station: str | None = options.STATION_OR_ALL,
    port: int | None = options.PORT,
    out: Path = typer.Option(
        Path("limits.json"),
        "--out",
        "-o",
        metavar="FILE",
        help="Limits file to write; must not exist.",
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Learn fixed control limits from stable runs, or show them.

    Performs a phase I study (Montgomery) of each port, over the joints of the runs in the order
    given. Sets limits where the values are stable and a distribution fits; otherwise gives the
    reason and ends with exit code 1. `jbclog chart --limits` cites the file by its SHA-256.

    \b
    Example:
      jbclog limits learn runs/20261121T013000Z-bench-3-k7qd --metric dwell_s --out dwell.json
    """
    if words[0] == SHOW and len(words) == 2:
        _show(Path(words[1]), as_json=as_json)
    elif words[0] == LEARN and len(words) > 1:
        _learn([Path(word) for word in words[1:]], metric, station, port, out, as_json=as_json)
    else:
        raise UsageError("limits: give learn RUN..., or show FILE")


def _learn(
    runs: list[Path],
    metric: str,
    station: str | None,
    port: int | None,
    out: Path,
    *,
    as_json: bool,
) -> None:
    for run in runs:
        expect_run(run)
    _expect_each_once(runs)
    if out.exists():
        raise UsageError(
            f"--out {out} exists; charts cite limits by their hash, so give another name"
        )
    from jbclog.analysis.charts import joined, joint_metrics, series_of_run
    from jbclog.analysis.control_limits import Source, as_bytes, learn, limits_of
    from jbclog.analysis.run import open_run
    from jbclog.analysis.spc import Refused
    from jbclog.core.durable_files import write_new
    from jbclog.record.manifest import manifest_sha256

    series = joined(
        [each for run in runs for each in series_of_run(open_run(run), metric, station, port)]
    )
    learnt = [(one, learn(one)) for one in series]
    found = [its for _, its in learnt if not isinstance(its, Refused)]
    refused = {
        f"{one.station} port {one.port}": its.text
        for one, its in learnt
        if isinstance(its, Refused)
    }
    for place, why in refused.items():
        note(f"{place}: no limits. {why}")
    if found:
        sources = [Source(Path(os.path.realpath(run)).name, manifest_sha256(run)) for run in runs]
        data = as_bytes(limits_of(metric, joint_metrics()[metric], "joint", found, sources))
        try:
            write_new(out, data)
        except OSError as error:
            raise RecordError(f"{out}: cannot write: {write_failure(error, out)}") from error
        _show(out, as_json=as_json, refused=refused)
    elif as_json:
        echo_json({"file": None, "limits": [], "refused": refused})
    if refused or not found:
        note(f"{len(found)} of {len(learnt)} ports have limits")
        raise typer.Exit(1)


def _expect_each_once(runs: list[Path]) -> None:
    """Raise `UsageError` for a run given twice: its joints would count twice."""
    from jbclog.record.find_runs import Found, once, summary_of

    _, copies = once(one for one in map(summary_of, runs) if isinstance(one, Found))
    if copies:
        raise UsageError(f"{copies[0]}; give each run once")


def _show(path: Path, *, as_json: bool, refused: dict[str, str] | None = None) -> None:
    from dataclasses import asdict

    from jbclog.analysis.control_limits import read_limits

    if not path.exists():
        raise UsageError(f"{path}: no such file; `jbclog limits learn` writes one")
    found, sha256 = read_limits(path)
    if as_json:
        echo_json({"file": str(path), "sha256": sha256, **asdict(found), "refused": refused or {}})
        return
    for one in found.limits:
        edges = f"{one.lower:.4g} to {one.upper:.4g} {found.uom} ({one.distribution}, n {one.n})"
        echo(
            f"{one.station} port {one.port}  {found.metric}  centre {one.centre:.4g}, limits"
            f" {edges}"
        )
    for source in found.sources:
        echo(f"from {source.run}  {source.manifest_sha256}")
    echo(f"{path}: SHA-256 {sha256}")
