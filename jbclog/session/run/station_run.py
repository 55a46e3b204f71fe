"""One station's run, from the first byte to the safe state. Start with `run_station`.

::

    start, in three steps with the other stations -> sample ⇄ outage -> whatever ends it
        -> make safe -> counters
"""

from __future__ import annotations

from collections.abc import Mapping

from jbclog.core.errors import (
    JbclogError,
    LinkError,
    LinkFlooded,
    StartRefused,
    StationError,
    cause,
    unexpected_error_text,
)
from jbclog.core.io_requests import START_STEPS, Gather, LeftOut, NotStarted, RunEnded, Steps, Wait
from jbclog.core.rows import Journal, NoJournal, Severity, StationFacts
from jbclog.core.states import StationOutcome
from jbclog.session.run.apply import apply, apply_status, examine
from jbclog.session.run.condition import bring_condition, check_condition, look_at_condition
from jbclog.session.run.context import EXAMINED, HEATED, PREPARED, PortState, SessionContext
from jbclog.session.run.countdown import compare_countdowns
from jbclog.session.run.counters import read_counters
from jbclog.session.run.identify import StationAbsent, identify
from jbclog.session.run.link_loss import report_flood
from jbclog.session.run.omega_states import unreported_states_text
from jbclog.session.run.outage import StationGone, outage, seek_at_end
from jbclog.session.run.pace import SamplingPlan, chosen_text, measure_pace
from jbclog.session.run.safe import make_safe
from jbclog.session.run.sampling import Sampler, StationLost
from jbclog.session.run.setting import listed
from jbclog.session.run.watch import OBSERVERS, SettingChanged, is_at_work
from jbclog.session.scheduler import Grid

# The start has three steps; each is complete on all stations before the next begins on any:
#
# 1. Read and check everything: identity, tools, settings, limits, cooling, rate. Nothing is
#    written.
# 2. Write what cannot heat (`config.recipe.CANNOT_HEAT`).
# 3. Write what can: setpoints, then the tools' status.
#
# If a station fails in the first step, nothing was written anywhere. Later no setting is rolled
# back: the written settings are reported, and each touched tool goes to its safe state; before the
# third step a resting tool is left alone, because an order could heat it. Counters are read last,
# while the tools warm up, because nothing depends on them. Sessions do not know each other: they
# yield `Gather`, and the driver resumes all together, or throws `NotStarted`.


def start(context: SessionContext) -> Steps[SamplingPlan]:
    """Start the station with its recipe, in step with the run's other stations; return its sampling
    plan.

    Raises `StartRefused` if this station fails, `NotStarted` if another does, `LeftOut` if it took
    too long.
    """
    yield from identify(context)
    wanted = yield from examine(context)
    pace = yield from measure_pace(context)
    context.note(
        "station.ready",
        Severity.INFO,
        f"{_ready_text(context)}{chosen_text(context.facts)}.{unreported_states_text(context)}",
    )
    if not context.family.safe_states:
        text = (
            f"An {context.family.title} has no safe state that could be ordered: at the end of the"
            " run it is left as it is."
        )
        context.note("safety.not_available", Severity.WARNING, text)
    condition = yield from look_at_condition(context)
    yield from _wait_for_others(context, EXAMINED)
    yield from apply(context, wanted, heats=False)
    yield from _wait_for_others(context, PREPARED)
    yield from apply(context, wanted, heats=True)
    yield from bring_condition(context, condition)
    yield from apply_status(context)
    yield from _wait_for_others(context, HEATED)
    context.has_started = True
    yield from _read_port_errors(context)
    yield from read_counters(context)
    return pace


def _read_port_errors(context: SessionContext) -> Steps[None]:
    """Read and report the port errors if one of them voids a signal
    (docs/reference/contradictions.md, B-44).

    Raises `LinkError` or `StationError` if the station does not answer.
    """
    if not context.family.port_errors.voids:
        return
    for port in context.ports.values():
        error = yield from context.read_confirmed(
            context.command("port_error"), port.number, known=port.error or 0
        )
        OBSERVERS["port_error"](context, port, error)


def _wait_for_others(context: SessionContext, step: int) -> Steps[None]:
    context.station.unasked((yield Gather(step)))
    context.step = step + 1


def _notify_failure(context: SessionContext) -> Steps[None]:
    """Notify the other sessions that this station does not start, without waiting for them."""
    try:
        context.station.unasked((yield Gather(context.step, context.facts.reason)))
    except RunEnded:
        return


def _ready_text(context: SessionContext) -> str:
    facts = context.facts
    answers = f"answers in {facts.turnaround_us['median'] / 1000:.2f} ms (median)"
    if context.link_is_faster is not None:
        answers += f" ({context.link_is_faster})"
    if not context.family.models:
        return f"{context.family.title}, as the line file says, {answers}"
    tools = ", ".join(
        f"port {port.number} {context.tool_text(port.tool)}" for port in context.ports.values()
    )
    return f"{facts.model} {answers}, tools: {tools}"


def run_station(context: SessionContext) -> Steps[StationFacts]:
    """Run one station to its end and return its facts. Its tools are safe on every way out, or the
    facts name those that are not.

    Does not raise errors of station and link; `facts.outcome` and `facts.reason` have them.
    """
    facts = context.facts
    context.station.permit = listed(context)
    context.station.now = context.order.t0  # before the first result: the run can end before it
    try:
        yield from _record(context)
        facts.outcome = StationOutcome.COMPLETED
    except Exception as error:
        _note_end(context, error)
    context.tries = 1  # a failed start leaves more
    if not context.has_started and facts.outcome != StationOutcome.COMPLETED:
        yield from _give_up(context)
    try:
        yield from _close(context)
    except Exception as error:
        _fail(context, error)
    return facts


def _note_end(context: SessionContext, error: Exception) -> None:
    """Put outcome and reason into the facts, by the error that ended the recording."""
    facts, name = context.facts, context.name
    match error:
        case NotStarted():
            facts.outcome = StationOutcome.NOT_STARTED
            facts.reason = f"{name}: the run did not start because of {error}"
        case LeftOut():
            facts.outcome, facts.reason = StationOutcome.GONE, f"{name}: {error}"
        case RunEnded():
            facts.outcome, facts.reason = _ended(context, str(error))
        case StationAbsent() | StationGone():
            facts.outcome, facts.reason = StationOutcome.GONE, str(error)
        case StartRefused():
            facts.outcome, facts.reason = StationOutcome.REFUSED, str(error)
        case SettingChanged():
            facts.outcome, facts.reason = StationOutcome.STOPPED, str(error)
        case LinkError() | StationError():
            if isinstance(error, LinkFlooded):
                report_flood(context, error)
            facts.outcome, facts.reason = StationOutcome.GONE, f"{name}: {error}"
        case _:
            _fail(context, error)


def _give_up(context: SessionContext) -> Steps[None]:
    """Handle a station that does not start: report what was written, and notify the others. One
    that may be missing is left out.
    """
    facts = context.facts
    if context.written:
        facts.reason += f"; settings written before that remain: {', '.join(context.written)}"
    if facts.outcome in (StationOutcome.GONE, StationOutcome.REFUSED):
        facts.reason += (
            f" (step {context.step} of {START_STEPS} of the start)" if context.step > 1 else ""
        )
        facts.outcome = StationOutcome.LEFT_OUT if context.order.may_be_missing else facts.outcome
    yield from _notify_failure(context)


def _ended(context: SessionContext, why: str) -> tuple[StationOutcome, str]:
    """Return outcome and reason of a station whose run was ended. One without time to answer does
    not count as gone.
    """
    if context.connected:
        return StationOutcome.COMPLETED, why
    if context.facts.first_tick is None:
        return StationOutcome.COMPLETED, f"{context.name}: {why} before it had answered"
    context.away_when = why
    return StationOutcome.GONE, f"{context.name}: not reachable when the run ended"


def _record(context: SessionContext) -> Steps[None]:
    pace = yield from start(context)
    context.tries = 1  # of decisive reads; the start had more
    sampler = Sampler(context, pace.readings, _grid(context, pace), paced=pace.paced)
    try:
        yield from _sample(context, sampler)
    finally:
        sampler.account()
        context.close_rows = sampler.close
        context.after_safe = sampler.read_flags_once_more


def _grid(context: SessionContext, pace: SamplingPlan) -> Grid:
    """Return the grid of due times, from the run's zero."""
    if not pace.paced:
        return Grid(context.now, pace.period_s)
    return Grid(context.order.t0, pace.period_s)


def _sample(context: SessionContext, sampler: Sampler) -> Steps[None]:
    tick = sampler.grid.first_from(context.now) if sampler.paced else 0
    context.facts.first_tick = tick
    while not sampler.is_over(tick):
        try:
            tick = yield from sampler.run(tick)
        except StationLost as lost:
            tick = yield from outage(context, sampler, context.facts.last_tick or tick, lost)


def _close(context: SessionContext) -> Steps[None]:
    at_work = [port for port in context.ports.values() if is_at_work(context, port)]
    yield from _make_safe_uninterrupted(context)
    context.close_rows()
    yield from _note_return(context)
    if context.connected and not isinstance(context.journal, NoJournal):
        yield from _read_last(context, at_work)
    _report_end(context)
    context.publish()


def _note_return(context: SessionContext) -> Steps[None]:
    """Count a station as there that was away when the run was ended, and confirmed since then that
    its tools are safe. One without a safe state, an OMEGA, can only answer: it is given the time
    that a run gives at its own end (`outage.py`). Any other is let go: `jbclog safe` may need its
    port for tools that this run did not touch.
    """
    facts = context.facts
    if context.away_when is None or facts.outcome != StationOutcome.GONE:
        return
    if context.family.safe_states:
        is_back, how = bool(facts.safe_state) and not facts.unsafe, "confirmed its safe state"
    else:
        context.station.unasked((yield Wait(0.0)))  # the end may have come in a long wait
        context.publish()  # gone until it answers: `jbclog safe` does not wait for it
        is_back, how = (yield from seek_at_end(context, reopen=True)), "answered again"
    if is_back:
        context.connected, facts.outcome = True, StationOutcome.COMPLETED
        facts.reason = f"{context.away_when} while it did not answer; it {how} after that"


def _read_last(context: SessionContext, at_work: list[PortState]) -> Steps[None]:
    """Read what is due once the tools are safe, if the station was sampled."""
    if context.after_safe is None:
        return
    try:
        yield from compare_countdowns(context, at_work)
        yield from context.after_safe()
        yield from read_counters(context)
        yield from check_condition(context)
    except (LinkError, StationError, RunEnded) as error:
        context.note(
            "counters.missed",
            Severity.WARNING,
            f"The counters could not be read at the end: {error}.",
        )


def _make_safe_uninterrupted(context: SessionContext) -> Steps[None]:
    """Make the tools safe without interruption by the run's end, a bug or a failed record.

    After a bug, tries once more, then once without a journal, which may be what fails.
    """
    journals: list[Journal] = [context.journal, NoJournal()]  # of the two further tries
    while True:
        try:
            yield from make_safe(context)
        except RunEnded:
            continue
        except Exception as error:
            _fail(context, error)
            if journals:
                context.journal = journals.pop(0)
                continue
            context.facts.unsafe.append(
                f"{context.name}: its tools could not be made safe: {cause(error)}"
            )
        return


def _fail(context: SessionContext, error: Exception) -> None:
    """Report a bug, or a failed record; neither must leave a tip hot."""
    known = isinstance(error, JbclogError)
    context.facts.outcome = StationOutcome.FAILED
    context.facts.reason = (
        str(error) if known else f"{context.name}: internal error, {unexpected_error_text(error)}"
    )


_SEVERITY: Mapping[str, Severity] = {
    StationOutcome.NOT_STARTED: Severity.WARNING,
    StationOutcome.LEFT_OUT: Severity.WARNING,
}  # else error


def _report_end(context: SessionContext) -> None:
    facts = context.facts
    good = facts.outcome == StationOutcome.COMPLETED
    if facts.reason or not good:
        severity = Severity.INFO if good else _SEVERITY.get(facts.outcome, Severity.ERROR)
        context.note(
            f"station.{facts.outcome}",
            severity,
            f"{(facts.reason or facts.outcome).removeprefix(f'{context.name}: ')}.",
        )
