"""`jbclog alarms`: the alarm episodes of a run, and acknowledging them."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.analysis.alarms import Detector, Episode, Figures, Incident, State
from jbclog.cli import options
from jbclog.cli.options import expect_run
from jbclog.cli.output import ends_with_errors_told, note, tell, tell_json
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.analysis.run_alarms import Alarms

# -- alarms table -------------------------------------------------------------------------------------------------------------
# Alarm episodes as lines of text: an incident, below it each witness, then the figures of each station.

WITNESS = {Detector.STATION: "flag", Detector.SAMPLES: "samples", Detector.AFTERWARDS: "excursion"}


def lines(found: Alarms) -> list[str]:
    """Everything; empty where there was nothing."""
    body = [line for incident in found.incidents for line in _incident(found, incident)]
    return [
        *body,
        *(_figures(one) for one in found.figures if one.count and one.detector is not Detector.AFTERWARDS),
        *found.live,
        *found.astray(),
    ]


def _incident(found: Alarms, one: Incident) -> Iterator[str]:
    first, limit = one.episodes[0], next((each.limit_c for each in one.episodes if each.limit_c is not None), None)
    beyond = "" if limit is None else f", limit {limit:g} °C"
    day = datetime.fromtimestamp(one.begin_us / 1e6, UTC).date()
    where = f"{one.number}  {first.station} port {first.port}, {day} UTC"
    yield f"{where}: {first.side} temperature{beyond}; {_witnesses(one)}; {_state(one)}"
    for episode in one.episodes:
        yield f"   {episode.id}  {WITNESS[episode.detector]}: {_span(episode)}"
    if one.finding:
        yield f"   They do not agree: {one.finding}."
    given = found.acknowledgement(one)
    if given is not None:
        yield f"   Acknowledged by {given.who} at {given.time[:19]}Z: {given.why}"
    elif found.is_waiting(one):
        yield "   Not acknowledged."


def _witnesses(one: Incident) -> str:
    return " ".join(f"{detector}{_times(len(those))}" for detector, those in one.by.items() if those)


def _times(count: int) -> str:
    return f"×{count}" if count > 1 else ""


def _state(one: Incident) -> str:
    states = {episode.state for episode in one.episodes}
    return str(next(state for state in (State.ACTIVE, State.UNCERTAIN, State.CLEARED) if state in states))


def _span(one: Episode) -> str:
    begins = f"began {_between(one.onset_earliest_us, one.onset_us)}"
    seconds = "" if one.seconds is None else f", {one.seconds:.1f} s"
    ends = "" if one.end_us is None else f", ended {_between(one.end_earliest_us, one.end_us)}{seconds} ({one.end_reason})"
    peak = "" if one.peak_c is None else f", {'hottest' if one.side == 'high' else 'coldest'} {one.peak_c:g} °C"
    borne_out = "" if one.is_confirmed else ", borne out by no sample"
    return f"{begins}{ends}{peak}{borne_out}{', not read for too long meanwhile' if one.is_uncertain else ''}"


def _between(earliest_us: int | None, latest_us: int) -> str:
    latest = _clock(latest_us)
    return latest if earliest_us in (None, latest_us) else f"{_clock(earliest_us)} to {latest}"


def _clock(micros: int | None) -> str:
    seconds, micros = divmod(micros or 0, 1_000_000)
    minutes, second = divmod(seconds, 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours % 24:02d}:{minute:02d}:{second:02d}.{micros // 1000:03d}"


def _figures(one: Figures) -> str:
    parts = [f"{one.count} alarm{'s' * (one.count != 1)}, at most {one.most_in_10_min} in 10 minutes"]
    parts.append(f"{len(one.floods)} flood{'s' * (len(one.floods) != 1)}" if one.floods else "no flood")
    parts += [f"{name} chatters ({count} in a minute)" for name, count in one.chattering.items()]
    parts += [f"{count} {word}" for count, word in ((one.fleeting, "fleeting"), (one.stale, "stale")) if count]
    parts += [f"one in {_long(one.apart.value)} on average"] if one.apart.value is not None else []
    parts += [_acknowledged(one)] if one.ack_p50.value is not None and one.ack_p95.value is not None else []
    parts.append("most from " + ", ".join(f"{source.name} ({source.percent:g} %)" for source in one.top[:3]))
    return f"{one.station}, {one.detector} ({WITNESS[one.detector]}): {'; '.join(parts)}"


def _acknowledged(one: Figures) -> str:
    half, most = _long(one.ack_p50.value or 0.0), _long(one.ack_p95.value or 0.0)
    return f"{one.ack_p50.n} acknowledged, half of them within {half} and 95 % within {most}"


def _long(seconds: float) -> str:
    """``12 s``, ``8.5 min``, ``31 h``."""
    return f"{seconds:.3g} s" if seconds < 99.5 else f"{seconds / 60:.2g} min" if seconds < 5940 else f"{seconds / 3600:.3g} h"


# -- alarms -------------------------------------------------------------------------------------------------------------------

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

    Each as three witnesses have it: A the station's flag, B our samples with the alarm's delay and a dead band, C every sample
    beyond the limit. Onset and end are intervals between two readings. On what they do not agree is said in a sentence, and
    below stand floods, chatter and stale alarms of each station. Ends with 1 while an alarm of A or B is not acknowledged.

    `ack` writes who, when and why to annotations.jsonl, for the whole incident and for good; the record stays as it is.

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
