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
from jbclog.core.io_requests import (
    START_STEPS,
    LeftOut,
    NotStarted,
    RunEnded,
    Steps,
    gather,
    wait,
)
from jbclog.core.rows import Journal, NoJournal, Severity, StationFacts
from jbclog.core.states import StationOutcome
from jbclog.session.run.apply import apply, apply_status, examine
from jbclog.session.run.condition import bring_condition, check_condition, look_at_condition
from jbclog.session.run.context import SessionContext
from jbclog.session.run.countdown import compare_countdowns
from jbclog.session.run.counters import read_counters
from jbclog.session.run.identify import StationAbsent, identify
from jbclog.session.run.link_loss import report_flood
from jbclog.session.run.omega_states import unreported_states_text
from jbclog.session.run.outage import Outage, StationGone, seek_at_end
from jbclog.session.run.pace import SamplingPlan, chosen_text, measure_pace
from jbclog.session.run.permit import WritePermit
from jbclog.session.run.safe import make_safe
from jbclog.session.run.sampling import Sampler, StationLost
from jbclog.session.run.state import EXAMINED, HEATED, PREPARED, PortState
from jbclog.session.run.watch import OBSERVERS, SettingChanged
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


async def start(context: SessionContext) -> SamplingPlan:
    """Start the station with its recipe, in step with the run's other stations; return its sampling
    plan.

    Raises `StartRefused` if this station fails, `NotStarted` if another does, `LeftOut` if it took
    too long.
    """
    await identify(context)
    wanted = await examine(context)
    pace = await measure_pace(context)
    context.log.note(
        "station.ready",
        Severity.INFO,
        f"{_ready_text(context)}{chosen_text(context.state.facts)}.{unreported_states_text(context)}",
    )
    family = context.state.family
    if not family.safe_states:
        text = (
            f"An {family.title} has no safe state that could be ordered: at the end of the"
            " run it is left as it is."
        )
        context.log.note("safety.not_available", Severity.WARNING, text)
    condition = await look_at_condition(context)
    await _wait_for_others(context, EXAMINED)
    await apply(context, wanted, heats=False)
    await _wait_for_others(context, PREPARED)
    await apply(context, wanted, heats=True)
    await bring_condition(context, condition)
    await apply_status(context)
    await _wait_for_others(context, HEATED)
    context.state.has_started = True
    await _read_port_errors(context)
    await read_counters(context)
    return pace


async def _read_port_errors(context: SessionContext) -> None:
    """Read and report the port errors if one of them voids a signal
    (docs/reference/contradictions.md, B-44).

    Raises `LinkError` or `StationError` if the station does not answer.
    """
    if not context.state.family.port_errors.voids:
        return
    for port in context.state.ports.values():
        error = await context.reads.confirmed(
            context.command("port_error"), port.number, known=port.error or 0
        )
        OBSERVERS["port_error"](context, port, error)


async def _wait_for_others(context: SessionContext, step: int) -> None:
    context.station.unasked(await gather(step))
    context.state.step = step + 1


async def _notify_failure(context: SessionContext) -> None:
    """Notify the other sessions that this station does not start, without waiting for them."""
    try:
        context.station.unasked(await gather(context.state.step, context.state.facts.reason))
    except RunEnded:
        return


def _ready_text(context: SessionContext) -> str:
    state = context.state
    facts = state.facts
    answers = f"answers in {facts.turnaround_us['median'] / 1000:.2f} ms (median)"
    if state.link_is_faster is not None:
        answers += f" ({state.link_is_faster})"
    if not state.family.models:
        return f"{state.family.title}, as the line file says, {answers}"
    tools = ", ".join(
        f"port {port.number} {state.tool_text(port.tool)}" for port in state.ports.values()
    )
    return f"{facts.model} {answers}, tools: {tools}"


def run_station(context: SessionContext) -> Steps[StationFacts]:
    """Run one station to its end and return its facts. Its tools are safe on every way out, or the
    facts name those that are not.

    Does not raise errors of station and link; `facts.outcome` and `facts.reason` have them.
    """
    return _StationRun(context).run()


class _StationRun:
    """One station's run. `sampler` is None until the start is over."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._facts = context.state.facts
        self._sampler: Sampler | None = None
        self._ended_while_away: str | None = None  # why, if the station was not there then

    async def run(self) -> StationFacts:
        context, facts = self._context, self._facts
        context.station.permit = WritePermit(context)
        context.station.now = context.order.t0  # before the first result: the run can end before it
        try:
            await self._record()
            facts.outcome = StationOutcome.COMPLETED
        except Exception as error:
            self._note_end(error)
        context.reads.tries = 1  # a failed start leaves more
        if not context.state.has_started and facts.outcome != StationOutcome.COMPLETED:
            await self._give_up()
        try:
            await self._close()
        except Exception as error:
            self._fail(error)
        return facts

    async def _record(self) -> None:
        context = self._context
        plan = await start(context)
        context.reads.tries = 1  # of decisive reads; the start had more
        # without pause there are no due times: the grid only gives the pace
        t0 = context.order.t0 if plan.paced else context.now
        grid = Grid(t0, plan.period_s)
        self._sampler = sampler = Sampler(context, plan.readings, grid, paced=plan.paced)
        tick = grid.first_from(context.now) if plan.paced else 0
        self._facts.first_tick = tick
        try:
            while not sampler.is_over(tick):
                try:
                    tick = await sampler.run(tick)
                except StationLost as lost:
                    last_tick = self._facts.last_tick or tick
                    tick = await Outage(context, sampler, lost).bridge(last_tick)
        finally:
            sampler.account()

    # -- the end -----------------------------------------------------------------------------------

    def _note_end(self, error: Exception) -> None:
        """Put outcome and reason into the facts, by the error that ended the recording."""
        name = self._context.name
        match error:
            case NotStarted():
                reason = f"{name}: the run did not start because of {error}"
                self._end(StationOutcome.NOT_STARTED, reason)
            case LeftOut():
                self._end(StationOutcome.GONE, f"{name}: {error}")
            case RunEnded():
                self._note_run_ended(str(error))
            case StationAbsent() | StationGone():
                self._end(StationOutcome.GONE, str(error))
            case StartRefused():
                self._end(StationOutcome.REFUSED, str(error))
            case SettingChanged():
                self._end(StationOutcome.STOPPED, str(error))
            case LinkError() | StationError():
                if isinstance(error, LinkFlooded):
                    report_flood(self._context, error)
                self._end(StationOutcome.GONE, f"{name}: {error}")
            case _:
                self._fail(error)

    def _end(self, outcome: StationOutcome, reason: str) -> None:
        self._facts.outcome = outcome
        self._facts.reason = reason

    def _note_run_ended(self, why: str) -> None:
        """A station without time to answer does not count as gone."""
        if self._context.state.connected:
            self._end(StationOutcome.COMPLETED, why)
        elif self._facts.first_tick is None:
            reason = f"{self._context.name}: {why} before it had answered"
            self._end(StationOutcome.COMPLETED, reason)
        else:
            self._ended_while_away = why
            reason = f"{self._context.name}: not reachable when the run ended"
            self._end(StationOutcome.GONE, reason)

    def _fail(self, error: Exception) -> None:
        """Report a bug, or a failed record; neither must leave a tip hot."""
        reason = str(error)
        if not isinstance(error, JbclogError):
            reason = f"{self._context.name}: internal error, {unexpected_error_text(error)}"
        self._end(StationOutcome.FAILED, reason)

    async def _give_up(self) -> None:
        """Handle a station that does not start: report what was written, and notify the others. One
        that may be missing is left out.
        """
        state, facts = self._context.state, self._facts
        if state.written:
            facts.reason += f"; settings written before that remain: {', '.join(state.written)}"
        if facts.outcome in (StationOutcome.GONE, StationOutcome.REFUSED):
            if state.step > EXAMINED:
                facts.reason += f" (step {state.step} of {START_STEPS} of the start)"
            if self._context.order.may_be_missing:
                facts.outcome = StationOutcome.LEFT_OUT
        await _notify_failure(self._context)

    async def _close(self) -> None:
        context = self._context
        ports = context.state.ports.values()
        at_work = [port for port in ports if context.state.is_at_work(port)]
        await self._make_safe_uninterrupted()
        if self._sampler is not None:
            self._sampler.close()
        await self._note_return()
        if context.state.connected and not isinstance(context.log.journal, NoJournal):
            await self._read_last(at_work)
        self._report_end()
        context.publish()

    async def _note_return(self) -> None:
        """Count a station as there that was away when the run was ended, and confirmed since then
        that its tools are safe. One without a safe state, an OMEGA, can only answer: it is given
        the time that a run gives at its own end (`outage.py`). Any other is let go: `jbclog safe`
        may need its port for tools that this run did not touch.
        """
        context, facts = self._context, self._facts
        if self._ended_while_away is None or facts.outcome != StationOutcome.GONE:
            return
        if context.state.family.safe_states:
            is_back, how = bool(facts.safe_state) and not facts.unsafe, "confirmed its safe state"
        else:
            context.station.unasked(await wait(0.0))  # the end may have come in a long wait
            context.publish()  # gone until it answers: `jbclog safe` does not wait for it
            is_back, how = await seek_at_end(context, reopen=True), "answered again"
        if is_back:
            context.state.connected = True
            reason = f"{self._ended_while_away} while it did not answer; it {how} after that"
            self._end(StationOutcome.COMPLETED, reason)

    async def _read_last(self, at_work: list[PortState]) -> None:
        """Read what is due once the tools are safe, if the station was sampled."""
        if self._sampler is None:
            return
        context = self._context
        try:
            await compare_countdowns(context, at_work)
            await self._sampler.read_flags_once_more()
            await read_counters(context)
            await check_condition(context)
        except (LinkError, StationError, RunEnded) as error:
            text = f"The counters could not be read at the end: {error}."
            context.log.note("counters.missed", Severity.WARNING, text)

    async def _make_safe_uninterrupted(self) -> None:
        """Make the tools safe without interruption by the run's end, a bug or a failed record.

        After a bug, tries once more, then once without a journal, which may be what fails.
        """
        context = self._context
        journals: list[Journal] = [context.log.journal, NoJournal()]  # of the two further tries
        while True:
            try:
                await make_safe(context)
            except RunEnded:
                continue
            except Exception as error:
                self._fail(error)
                if journals:
                    context.log.journal = journals.pop(0)
                    continue
                self._facts.unsafe.append(
                    f"{context.name}: its tools could not be made safe: {cause(error)}"
                )
            return

    def _report_end(self) -> None:
        facts = self._facts
        is_good = facts.outcome == StationOutcome.COMPLETED
        if is_good and not facts.reason:
            return
        severity = Severity.INFO if is_good else _SEVERITY.get(facts.outcome, Severity.ERROR)
        text = (facts.reason or facts.outcome).removeprefix(f"{self._context.name}: ")
        self._context.log.note(f"station.{facts.outcome}", severity, f"{text}.")


_SEVERITY: Mapping[str, Severity] = {
    StationOutcome.NOT_STARTED: Severity.WARNING,
    StationOutcome.LEFT_OUT: Severity.WARNING,
}  # else error
