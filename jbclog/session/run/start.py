"""The start of a station's run, in three steps, each of them done on all stations before the next begins on any.

1. Read and check everything: who answers, its tools, the rate, its settings, limits, cooling. Nothing is written.
2. Write what cannot heat (`recipe.order.CANNOT_HEAT`).
3. Write what can: setpoints, then the tools' status.

A station that fails in the first step is the end of a start that has written nothing. In the others no setting is rolled back:
what was written is named, and each tool that was touched goes to its safe state (`station_run.py`); before the third step one that
rests already is left alone, because an order could heat it. The counters come last, while the
tools warm up: nothing depends on them. The sessions know nothing of each other: they wish to wait (`effects.Gather`), and the
driver answers when all are there, or throws `NotStarted`.
"""

from __future__ import annotations

from jbclog.core.io_requests import Gather, RunEnded, Steps
from jbclog.core.rows import Severity
from jbclog.session.run.apply import apply, apply_status, examine
from jbclog.session.run.condition import bring_condition, look_at_condition
from jbclog.session.run.context import EXAMINED, HEATED, PREPARED, SessionContext
from jbclog.session.run.counters import read_counters
from jbclog.session.run.identify import identify
from jbclog.session.run.omega_states import told_text
from jbclog.session.run.pace import Pace, choose_pace, chosen_text
from jbclog.session.run.provisos import learn_provisos


def start(context: SessionContext) -> Steps[Pace]:
    """Bring the station to its recipe, together with all others of the run; give the rate at which it is sampled.

    Raises `StartRefused` where this station fails, `NotStarted` where another does, `LeftOut` where it was waited for in vain.
    """
    yield from identify(context)
    pace = choose_pace(context)
    context.note("station.ready", Severity.INFO, f"{_ready_text(context)}{chosen_text(context.facts)}.{told_text(context)}")
    if not context.family.safe_states:
        text = f"An {context.family.title} has no safe state that could be ordered: at the end of the run it is left as it is."
        context.note("safety.not_available", Severity.WARNING, text)
    wanted = yield from examine(context)
    condition = yield from look_at_condition(context)
    yield from _wait_for_others(context, EXAMINED)
    yield from apply(context, wanted, heats=False)
    yield from _wait_for_others(context, PREPARED)
    yield from apply(context, wanted, heats=True)
    yield from bring_condition(context, condition)
    yield from apply_status(context)
    yield from _wait_for_others(context, HEATED)
    context.has_started = True
    yield from learn_provisos(context)
    yield from read_counters(context)
    return pace


def _wait_for_others(context: SessionContext, step: int) -> Steps[None]:
    context.station.unasked((yield Gather(step)))
    context.step = step + 1


def tell_failure(context: SessionContext) -> Steps[None]:
    """Let the others know that this station does not start; it does not wait for them."""
    try:
        context.station.unasked((yield Gather(context.step, context.facts.reason)))
    except RunEnded:
        return


def _ready_text(context: SessionContext) -> str:
    facts, answers = context.facts, f"answers in {context.facts.turnaround_us['median'] / 1000:.2f} ms (median)"
    if context.link_is_faster is not None:
        answers += f" ({context.link_is_faster})"
    if not context.family.models:
        return f"{context.family.title}, as the line file says, {answers}"
    tools = ", ".join(f"port {port.number} {context.tool_text(port.tool)}" for port in context.ports.values())
    return f"{facts.model} {answers}, tools: {tools}"
