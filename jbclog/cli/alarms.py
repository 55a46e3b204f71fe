"""`jbclog alarms`: list and acknowledge the alarm episodes of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import echo, echo_json, note, reports_errors, run_facts
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.run_alarms import Alarms

ACK = "ack"


@reports_errors
def alarms(
    words: list[str] = typer.Argument(
        ...,
        metavar="RUN | ack RUN EPISODE",
        help="Run folder; after `ack` also an episode.",
        show_default=False,
    ),
    by: str | None = typer.Option(
        None,
        "--by",
        metavar="WHO",
        help="Person who acknowledges.  [required with ack]",
        show_default=False,
    ),
    reason: str | None = typer.Option(
        None, "--reason", metavar="TEXT", help="Reason.  [required with ack]", show_default=False
    ),
    as_json: bool = options.AS_JSON,
) -> None:
    """Show a run's alarms as episodes, or acknowledge one.

    Compares three detectors: A the station's flag, B the samples with on-delay and deadband, C
    every sample beyond the limit. Start and end are intervals between two readings. Notes where the
    detectors disagree, and lists floods, chattering and stale alarms of each station (ISA-18.2).
    Exit code 1: an alarm of A or B is not acknowledged.

    `ack` records who, when and why in annotations.jsonl, for the whole incident; the record does
    not change.

    \b
    Example:
      jbclog alarms runs/20261121T013000Z-bench-3-k7qd
    """
    is_ack = len(words) > 1 and words[0] == ACK
    if is_ack and len(words) == 3:
        _acknowledge(Path(words[1]), words[2], by, reason, as_json=as_json)
    elif not is_ack and len(words) == 1:
        if by is not None or reason is not None:
            raise UsageError("alarms: --by and --reason belong to `alarms ack RUN EPISODE`")
        _show(Path(words[0]), as_json=as_json)
    else:
        raise UsageError(
            "alarms: give RUN, or ack RUN EPISODE; `jbclog alarms RUN` lists the episodes"
        )


def _alarms_of(run: Path) -> Alarms:
    expect_run(run)
    from jbclog.analysis.run import open_run

    return open_run(run).alarm_findings()


def _show(run: Path, *, as_json: bool) -> None:
    found = _alarms_of(run)
    waiting = [one for one in found.incidents if found.is_waiting(one)]
    if as_json:
        facts = {
            "alarms": found.rows(),
            "figures": found.figure_rows(),
            "findings": found.findings(),
        }
        echo_json({**run_facts(run), **facts, "not_acknowledged": [one.name for one in waiting]})
    else:
        from jbclog.cli.alarm_lines import lines

        echo(*(lines(found) or [f"{run}: no alarms"]))
    note(*_wrong_annotations(run))
    if waiting:
        note(
            f"{len(waiting)} not acknowledged: jbclog alarms ack {run} {waiting[0].name} --by WHO"
            " --reason TEXT"
        )
        raise typer.Exit(1)


def _wrong_annotations(run: Path) -> list[str]:
    """Return the errors of the file of acknowledgements; none for an open run."""
    from jbclog.core.errors import RecordError
    from jbclog.record.annotations import read

    try:
        return read(run).complaints()
    except RecordError:
        return []


def _acknowledge(
    run: Path, episode: str, by: str | None, reason: str | None, *, as_json: bool
) -> None:
    from jbclog.analysis.run_alarms import ACKNOWLEDGED
    from jbclog.record.annotations import append
    from jbclog.record.chains import short_head

    who, why = options.signed("alarms ack", by, reason)
    found = _alarms_of(run)
    incident = found.incident_of(episode)
    if incident is None:
        raise UsageError(f"{episode}: {run} has no such episode; `jbclog alarms {run}` lists them")
    before = found.acknowledgement(incident)
    if before is not None:
        raise UsageError(
            f"{episode}: already acknowledged by {before.who} at {before.time} ({before.why})"
        )
    head = append(run, who=who, what=episode, why=why, kind=ACKNOWLEDGED)
    if as_json:
        echo_json({**run_facts(run), "episode": episode, "head": head})
    else:
        echo(f"{run}: {episode} acknowledged (annotations fingerprint {short_head(head)})")
