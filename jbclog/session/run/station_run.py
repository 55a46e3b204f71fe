"""The story of one station's run, from the first byte to the safe state.

::

    start, in three steps with the other stations -> sample ⇄ outage -> (end, stop, failure) -> make safe -> counters
"""

from __future__ import annotations

from jbclog.core.errors import JbclogError, LinkError, LinkFlooded, StartRefused, StationError
from jbclog.core.io_requests import START_STEPS, LeftOut, NotStarted, RunEnded, Steps
from jbclog.core.rows import Journal, NoJournal, Severity, StationFacts
from jbclog.session.run.anomalies import compare_countdowns
from jbclog.session.run.condition import check_condition
from jbclog.session.run.context import SessionContext
from jbclog.session.run.counters import read_counters
from jbclog.session.run.identify import Absent
from jbclog.session.run.loss import tell_flood
from jbclog.session.run.outage import Gone, outage
from jbclog.session.run.pace import Pace
from jbclog.session.run.safe import make_safe
from jbclog.session.run.sampling import Lost, Sampler
from jbclog.session.run.start import start, tell_failure
from jbclog.session.run.watch import SettingChanged, is_at_work
from jbclog.session.run.writes import listed
from jbclog.session.scheduler import Grid

SEVERITY = {"not_started": Severity.WARNING, "left_out": Severity.WARNING}  # of how a station ended, but for errors


def run_station(context: SessionContext) -> Steps[StationFacts]:
    """Run one station to its end and give what is known of it. Its tools are safe on every way out, or the facts say not.

    Never raises for what a station or a link does; `facts.outcome` and `facts.reason` tell it.
    """
    facts = context.facts
    context.station.permit = listed(context)
    context.station.now = context.order.t0  # until it is told a later one: an end can come before anything else
    try:
        yield from _record(context)
        facts.outcome = "completed"
    except NotStarted as others:
        facts.outcome, facts.reason = "not_started", f"{context.name}: it was ready; the run did not start because of {others}"
    except LeftOut as why:
        facts.outcome, facts.reason = "gone", f"{context.name}: {why}"
    except RunEnded as end:
        facts.outcome, facts.reason = _ended(context, str(end))
    except (Absent, Gone) as error:
        facts.outcome, facts.reason = "gone", str(error)
    except StartRefused as error:
        facts.outcome, facts.reason = "refused", str(error)
    except SettingChanged as error:
        facts.outcome, facts.reason = "stopped", str(error)
    except (LinkError, StationError) as error:
        if isinstance(error, LinkFlooded):
            tell_flood(context, error)
        facts.outcome, facts.reason = "gone", f"{context.name}: {error}"
    except Exception as error:
        _fail(context, error)
    context.tries = 1
    if not context.has_started and facts.outcome != "completed":
        yield from _give_up(context)
    try:
        yield from _close(context)
    except Exception as error:
        _fail(context, error)
    return facts


def _give_up(context: SessionContext) -> Steps[None]:
    """This station does not start: say what was written, and let the others know. One that may be missing is left out."""
    facts = context.facts
    if context.written:
        facts.reason += f"; written before that and left as it is: {', '.join(context.written)}"
    if facts.outcome in ("gone", "refused"):
        facts.reason += f" (step {context.step} of {START_STEPS} of the start)" if context.step > 1 else ""
        facts.outcome = "left_out" if context.order.may_be_missing else facts.outcome
    yield from tell_failure(context)


def _ended(context: SessionContext, why: str) -> tuple[str, str]:
    """Outcome and reason of a station whose run was ended. One that had no time to answer is not away."""
    if context.connected:
        return "completed", why
    if context.facts.first_tick is None:
        return "completed", f"{context.name}: {why} before it had answered"
    return "gone", f"{context.name}: away when the run was ended"


def _record(context: SessionContext) -> Steps[None]:
    pace = yield from start(context)
    context.tries = 1
    sampler = Sampler(context, pace.readings, _grid(context, pace), paced=pace.paced)
    try:
        yield from _sample(context, sampler)
    finally:
        sampler.account()
        context.after_safe = sampler.read_flags_once_more


def _grid(context: SessionContext, pace: Pace) -> Grid:
    """The grid of due times, from the run's zero on. That of a recorded run lies as it did to what came before it."""
    if not pace.paced:
        return Grid(context.now, pace.period_s)
    if context.order.begin is None:
        return Grid(context.order.t0, pace.period_s)
    tick, in_s = context.order.begin
    return Grid(context.now + in_s - tick * pace.period_s, pace.period_s)


def _sample(context: SessionContext, sampler: Sampler) -> Steps[None]:
    tick = sampler.grid.first_from(context.now) if sampler.paced else 0
    context.facts.first_tick = tick
    while not sampler.is_over(tick):
        try:
            tick = yield from sampler.run(tick)
        except Lost as lost:
            tick = yield from outage(context, sampler, context.facts.last_tick or tick, lost)


def _close(context: SessionContext) -> Steps[None]:
    at_work = [port for port in context.ports.values() if is_at_work(context, port)]
    yield from _surely_make_safe(context)
    try:
        if context.connected and context.after_safe is not None and not isinstance(context.journal, NoJournal):
            yield from compare_countdowns(context, at_work)
            yield from context.after_safe()
            yield from read_counters(context)
            yield from check_condition(context)
    except (LinkError, StationError, RunEnded) as error:
        context.note("counters.missed", Severity.WARNING, f"The counters could not be read at the end: {error}.")
    _tell_end(context)
    context.publish()


def _surely_make_safe(context: SessionContext) -> Steps[None]:
    """Nothing ends this early: not the run's end, not a fault of the program, not a record that cannot be kept."""
    journals: list[Journal] = [context.journal, NoJournal()]  # with which it is tried again
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
            context.facts.unsafe.append(f"{context.name}: its tools could not be made safe, {error}")
        return


def _fail(context: SessionContext, error: Exception) -> None:
    """A fault of this program, or of its record; it must not leave a tip hot."""
    known = isinstance(error, JbclogError)
    context.facts.outcome = "failed"
    context.facts.reason = str(error) if known else f"{context.name}: internal error, {type(error).__name__}: {error}"


def _tell_end(context: SessionContext) -> None:
    facts = context.facts
    good = facts.outcome == "completed"
    if facts.reason or not good:
        severity = Severity.INFO if good else SEVERITY.get(facts.outcome, Severity.ERROR)
        context.note(f"station.{facts.outcome}", severity, f"{(facts.reason or facts.outcome).removeprefix(f'{context.name}: ')}.")
