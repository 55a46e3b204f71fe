"""Open the port and identify the station: model, family, ports, response time."""

from __future__ import annotations

from jbclog.core.errors import (
    LinkError,
    LinkFlooded,
    NotReceived,
    NotSupported,
    OutOfRange,
    Refusal,
    RobotModeOff,
    StartRefused,
    StationError,
)
from jbclog.core.io_requests import Reopen, Steps, Wait
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import NOT_DRIVEN, START_TRIES, kind_problem, pause
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.client.timing import LEAST_ANSWERED, READS, response_time
from jbclog.protocol.commands.family import (
    ROBOT,
    model_not_accepted_text,
    other_model_text,
    unknown_model_text,
)
from jbclog.session.run.context import Identity, PortState, SessionContext
from jbclog.session.run.identity import learn_identity
from jbclog.session.run.link_loss import report_flood

CORRECT_IT = "Correct `model`, or the cable"


class StationAbsent(StartRefused):
    """The station did not answer at the start."""


def identify(context: SessionContext) -> Steps[None]:
    """Open the port and identify the station. Raises `StartRefused` with the next step."""
    context.facts.model = yield from connect(context, reopen=True, tries=START_TRIES)
    context.connected = context.is_proven = True
    context.tries = START_TRIES
    yield from _learn_family(context)
    yield from _learn_ports(context)
    yield from _accept_model(context)
    yield from _learn_identity(context)
    context.publish()


def _learn_identity(context: SessionContext) -> Steps[None]:
    try:
        yield from learn_identity(context)
    except StationError as error:
        raise StartRefused(f"{context.name}: cannot read plugged hours: {error}") from error


def connect(context: SessionContext, *, reopen: bool, tries: int) -> Steps[str | None]:
    """Open the port and read the model name, at the start and after an outage.

    None if the family reports none: then another answer proves only the protocol.
    """
    context.station.unasked((yield Wait(0.0)))
    try:
        if reopen:
            context.station.unasked((yield Reopen()))
        if context.is_flooded:
            yield from expect_quiet(context.station)
        return (yield from _answer(context, tries))
    except LinkError as error:
        context.is_proven = False
        if isinstance(error, LinkFlooded):
            report_flood(context, error)
        raise StationAbsent(f"{context.name}: {error}") from error


def _answer(context: SessionContext, tries: int) -> Steps[str | None]:
    for number in range(1, tries + 1):
        try:
            if context.family_known and not context.family.models:
                yield from context.station.read(context.command(context.family.harmless[0]))
                return None
            # R-SMN is the same in every family that has it, so it works before the family is known
            command = next(iter(context.order.families.values())).commands["model"]
            return str((yield from context.read_confirmed(command, known=context.facts.model)))
        except RobotModeOff as error:
            raise StartRefused(
                f"{context.name}: Robot mode is off; switch it on in the station's menu"
            ) from error
        except StationError as error:
            if number == tries:
                raise StationAbsent(_no_answer(context, error, tries)) from error
        yield from pause(context.station, number)
    raise AssertionError("no try at all")


def _no_answer(context: SessionContext, error: StationError, tries: int) -> str:
    order, is_robot = context.order, not context.family_known or context.family.protocol == ROBOT
    mode = "Robot mode is switched on in its menu, " if is_robot else ""
    addressing = "without addresses" if order.address is None else f"address {order.address:02d}"
    sharers = order.sharers()
    first = f"{sharers}; " if sharers else ""
    return (
        f"{context.name}: {first}no usable answer on {order.url} at {order.line.baudrate}"
        f" {order.line.format}, {addressing} ({error}, in {tries}"
        f" {'try' if tries == 1 else 'tries'}); check that the station is on, {mode}the cable, and"
        " the line format; `jbclog doctor --line` looks for the reason"
    )


def _learn_family(context: SessionContext) -> Steps[None]:
    model = context.facts.model or ""
    context.answers_as = Identity(context.facts.model)
    if context.order.model is not None:
        if model != context.order.model:
            raise StartRefused(
                f"{context.name}: {model_not_accepted_text(context.order.model, model)}; nothing"
                f" was written to it. {CORRECT_IT}"
            )
    elif not context.family_known:
        proven = [family for family in context.order.families.values() if family.proves(model)]
        if not proven:
            raise StartRefused(
                f"{context.name}: {unknown_model_text(model)}. Nothing was written to it"
            )
        context.family = max(proven, key=lambda family: family.name != "soldering")
    elif context.family.models and not context.family.proves(model):
        raise StartRefused(f"{context.name}: {other_model_text(context.family, model)}")
    if context.family.name not in context.recipe.families:
        raise StartRefused(
            f"{context.name}: recipe {context.recipe.name} is not for family {context.family.name}"
        )
    context.answers_as = None
    if "software_version" in context.family.commands:
        context.facts.software = yield from _software(context)


def _accept_model(context: SessionContext) -> Steps[None]:
    """Confirm by reads the family that the line file names for an accepted model name, which alone
    does not prove the kind.
    """
    model = context.order.model
    if model is None:
        return
    port = next((one.number for one in context.ports.values() if one.has_tool), min(context.ports))
    why = yield from kind_problem(context.station, context.family, port)
    if why is not None:
        raise StartRefused(
            f"{context.name}: model {model} is driven as {context.family.name} by the line file,"
            f" but {why}. {NOT_DRIVEN}"
        )
    context.facts.model_accepted = True
    text = (
        f"The station says model {model} and is driven as {context.family.name}, as the line file's"
        " key `model` accepts."
    )
    context.note("station.model_accepted", Severity.INFO, text, raw=model)


def _software(context: SessionContext) -> Steps[str | None]:
    """Read the software version; None if the station has none and refuses, or if it cannot be read.

    The latter is a warning, because the station is then recognized without it.
    """
    try:
        return str((yield from context.read_confirmed(context.command("software_version"))))
    except StationError as error:
        if isinstance(error, Refusal) and not isinstance(error, NotReceived | RobotModeOff):
            context.not_supported.add("software_version")
            return None
        text = (
            f"The software version could not be read ({error}): after an outage the station is"
            " identified without it."
        )
        context.note("identity.not_known", Severity.WARNING, text)
        return None


def _learn_ports(context: SessionContext) -> Steps[None]:
    """Find the ports: those named by the line file must answer R-CT; otherwise all that answer
    count.
    """
    named = context.order.ports or context.family.ports
    if not context.family.tools:
        context.ports.update({number: PortState(number) for number in named or ()})
        context.facts.ports = list(context.ports)
        return
    for number in named or range(1, 5):
        try:
            tool = yield from context.read_confirmed(context.command("tool"), number)
        except (NotSupported, OutOfRange) as error:
            if named:
                raise StartRefused(
                    f"{context.name}: it has no port {number} ({error}); correct `ports` in the"
                    " line file"
                ) from error
            continue
        except (Refusal, StationError) as error:
            raise StartRefused(
                f"{context.name}: cannot read tool of port {number}: {error}"
            ) from error
        context.ports[number] = PortState(number, tool if isinstance(tool, int) else None)
    if not context.ports:
        raise StartRefused(f"{context.name}: none of its ports answers R-CT")
    context.facts.ports = list(context.ports)
    _require_tools(context)


def _require_tools(context: SessionContext) -> None:
    for port in context.ports.values():
        if port.has_tool:
            continue
        if context.recipe.run.require_tool:
            raise StartRefused(
                f"{context.name}: no tool in port {port.number}; put one in, take the port out of"
                " `ports`, or set require_tool = false"
            )
        context.note(
            "tool.absent",
            Severity.WARNING,
            f"No tool in port {port.number}; it is recorded as no_tool.",
            port=port.number,
        )


def measure_turnaround(context: SessionContext, *, apart_s: float = 0.0) -> Steps[None]:
    """Measure the response time in µs, from the signals of a port read so far and from harmless
    reads `apart_s` apart. A repeated measurement uses the harmless reads alone.
    """
    port = min(context.ports)
    seen = [] if context.answer_times is None else context.answer_times[port]
    context.answer_times = None
    measured, answered = yield from response_time(
        context.station, context.family, port, seen, apart_s=apart_s
    )
    if measured is None or answered < LEAST_ANSWERED:
        raise StartRefused(
            f"{context.name}: only {answered} of {READS} questions were answered; the link is too"
            " unreliable to start"
        )
    context.facts.turnaround_us = {
        "median": round(measured.median, 1),
        "p99": round(measured.longest, 1),
        "n": len(measured.took),
    }
    for name in measured.ignored:
        context.not_supported.add(context.family.signal_of(name) or name)
    context.link_is_faster = measured.faster_text(context.order.line)
    if measured.is_faster:
        context.facts.turnaround_us["faster_by"] = round(measured.wire - measured.whole, 1)
