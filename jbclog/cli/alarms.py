"""`jbclog alarms`: the alarm episodes of a run, and acknowledging them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.run_alarms import Alarms

ACK = "ack"


@ends_with_errors_told
def alarms(
    words: list[str] = typer.Argument(
        ..., metavar="RUN | ack RUN EPISODE", help="A run's folder; behind `ack` also the name of an episode.", show_default=False
    ),
    by: str | None = typer.Option(None, "--by", metavar="WHO", help="Who acknowledges it.", show_default=False),
    reason: str | None = typer.Option(None, "--reason", metavar="TEXT", help="Why.", show_default=False),
    as_json: bool = options.AS_JSON,
) -> None:
    """Show a run's alarms as episodes, or acknowledge one.

    Each as three sources have it: A the station's flag, B our samples with the alarm's delay and a deadband, C every sample
    beyond the limit. Onset and end are intervals between two readings. Where the three disagree, a sentence says how; floods,
    chatter and stale alarms of each station follow. Ends with 1 while an alarm of A or B is not acknowledged.

    `ack` writes who, when and why to annotations.jsonl, for the whole incident; the record stays as it is.

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
        raise UsageError("alarms: give RUN, or ack RUN EPISODE; `jbclog alarms RUN` shows the names of its episodes")


def _alarms_of(run: Path) -> Alarms:
    expect_run(run)
    from jbclog.analysis.run import open_run

    return open_run(run).alarm_findings()


def _show(run: Path, *, as_json: bool) -> None:
    found = _alarms_of(run)
    waiting = [one for one in found.incidents if found.is_waiting(one)]
    if as_json:
        facts = {"alarms": found.rows(), "figures": found.figure_rows(), "findings": found.findings()}
        tell_json({"run": str(run), **facts, "not_acknowledged": [one.name for one in waiting]})
    else:
        from jbclog.cli.alarm_lines import lines

        for line in lines(found) or [f"{run}: no temperature beyond a limit, no flag that counts"]:
            tell(line)
    for wrong in _wrong_annotations(run):
        note(wrong)
    if waiting:
        note(f"{len(waiting)} not acknowledged: jbclog alarms ack {run} {waiting[0].name} --by WHO --reason TEXT")
        raise typer.Exit(1)


def _wrong_annotations(run: Path) -> list[str]:
    """Where the file of acknowledgements was changed or cut, a sentence each; a run that is not sealed has none."""
    from jbclog.core.errors import RecordError
    from jbclog.record.annotations import read

    try:
        return read(run).complaints()
    except RecordError:
        return []


def _acknowledge(run: Path, episode: str, by: str | None, reason: str | None, *, as_json: bool) -> None:
    from jbclog.analysis.run_alarms import ACKNOWLEDGED
    from jbclog.record.annotations import append
    from jbclog.record.chains import short_head

    who, why = _given("--by", by), _given("--reason", reason)
    found = _alarms_of(run)
    incident = found.incident_of(episode)
    if incident is None:
        raise UsageError(f"{episode}: {run} has no such episode; `jbclog alarms {run}` shows their names")
    before = found.acknowledgement(incident)
    if before is not None:
        raise UsageError(f"{episode}: acknowledged already by {before.who} at {before.time} ({before.why})")
    head = append(run, who=who, what=episode, why=why, kind=ACKNOWLEDGED)
    if as_json:
        tell_json({"run": str(run), "episode": episode, "head": head})
    else:
        tell(f"{run}: {episode} acknowledged (head of the annotations {short_head(head)})")


def _given(option: str, text: str | None) -> str:
    """Raises `UsageError` where there is nothing, or what could not be shown as it is."""
    if text is None or not text.strip():
        raise UsageError(f"alarms ack: {option} is needed: who acknowledges it, and why")
    options.check_text(option, text)
    return text
