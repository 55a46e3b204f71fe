"""Open the port and identify the station: model, family, ports."""

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
from jbclog.core.io_requests import Reopen, do, wait
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import NOT_DRIVEN, START_TRIES, kind_problem, pause
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.commands.family import (
    ROBOT,
    model_not_accepted_text,
    other_model_text,
    unknown_model_text,
)
from jbclog.session.run.context import SessionContext
from jbclog.session.run.identity import learn_identity
from jbclog.session.run.link_loss import report_flood
from jbclog.session.run.state import Identity, PortState

CORRECT_IT = "Correct `model`, or the cable"


class StationAbsent(StartRefused):
    """The station did not answer at the start."""


async def identify(context: SessionContext) -> None:
    """Open the port and identify the station. Raises `StartRefused` with the next step."""
    state = context.state
    state.facts.model = await connect(context, reopen=True, tries=START_TRIES)
    state.connected = state.is_proven = True
    context.reads.tries = START_TRIES
    await _learn_family(context)
    await _learn_ports(context)
    await _accept_model(context)
    await _learn_identity(context)
    context.publish()


async def _learn_identity(context: SessionContext) -> None:
    try:
        await learn_identity(context)
    except StationError as error:
        raise StartRefused(f"{context.name}: cannot read plugged hours: {error}") from error


async def connect(context: SessionContext, *, reopen: bool, tries: int) -> str | None:
    """Open the port and read the model name, at the start and after an outage.

    None if the family reports none: then another answer proves only the protocol.
    """
    context.station.unasked(await wait(0.0))
    try:
        if reopen:
            context.station.unasked(await do(Reopen()))
        if context.state.reconnection.is_flooded:
            await expect_quiet(context.station)
        return await _answer(context, tries)
    except LinkError as error:
        context.state.is_proven = False
        if isinstance(error, LinkFlooded):
            report_flood(context, error)
        raise StationAbsent(f"{context.name}: {error}") from error


async def _answer(context: SessionContext, tries: int) -> str | None:
    state = context.state
    for number in range(1, tries + 1):
        try:
            if state.family_known and not state.family.models:
                await context.station.read(context.command(state.family.harmless[0]))
                return None
            # R-SMN is the same in every family that has it, so it works before the family is known
            command = next(iter(context.order.families.values())).commands["model"]
            return str(await context.reads.confirmed(command, known=state.facts.model))
        except RobotModeOff as error:
            raise StartRefused(
                f"{context.name}: Robot mode is off; switch it on in the station's menu"
            ) from error
        except StationError as error:
            if number == tries:
                raise StationAbsent(_no_answer(context, error, tries)) from error
        await pause(context.station, number)
    raise AssertionError("no try at all")


def _no_answer(context: SessionContext, error: StationError, tries: int) -> str:
    order, is_robot = (
        context.order,
        not context.state.family_known or context.state.family.protocol == ROBOT,
    )
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


async def _learn_family(context: SessionContext) -> None:
    state = context.state
    model = state.facts.model or ""
    state.answers_as = Identity(state.facts.model)
    if context.order.model is not None:
        if model != context.order.model:
            raise StartRefused(
                f"{context.name}: {model_not_accepted_text(context.order.model, model)}; nothing"
                f" was written to it. {CORRECT_IT}"
            )
    elif not state.family_known:
        proven = [family for family in context.order.families.values() if family.proves(model)]
        if not proven:
            raise StartRefused(
                f"{context.name}: {unknown_model_text(model)}. Nothing was written to it"
            )
        state.family = max(proven, key=lambda family: family.name != "soldering")
    elif state.family.models and not state.family.proves(model):
        raise StartRefused(f"{context.name}: {other_model_text(state.family, model)}")
    recipe = context.order.recipe
    if state.family.name not in recipe.families:
        raise StartRefused(
            f"{context.name}: recipe {recipe.name} is not for family {state.family.name}"
        )
    state.answers_as = None
    if "software_version" in state.family.commands:
        state.facts.software = await _software(context)


async def _accept_model(context: SessionContext) -> None:
    """Confirm by reads the family that the line file names for an accepted model name, which alone
    does not prove the kind.
    """
    state = context.state
    model = context.order.model
    if model is None:
        return
    port = next(
        (one.number for one in state.ports.values() if one.has_tool),
        min(state.ports),
    )
    why = await kind_problem(context.station, state.family, port)
    if why is not None:
        raise StartRefused(
            f"{context.name}: model {model} is driven as {state.family.name} by the line file,"
            f" but {why}. {NOT_DRIVEN}"
        )
    state.facts.model_accepted = True
    text = (
        f"The station says model {model} and is driven as {state.family.name}, as the line file's"
        " key `model` accepts."
    )
    context.log.note("station.model_accepted", Severity.INFO, text, raw=model)


async def _software(context: SessionContext) -> str | None:
    """Read the software version; None if the station has none and refuses, or if it cannot be read.

    The latter is a warning, because the station is then recognized without it.
    """
    try:
        return str(await context.reads.confirmed(context.command("software_version")))
    except StationError as error:
        if isinstance(error, Refusal) and not isinstance(error, NotReceived | RobotModeOff):
            context.state.not_supported.add("software_version")
            return None
        text = (
            f"The software version could not be read ({error}): after an outage the station is"
            " identified without it."
        )
        context.log.note("identity.not_known", Severity.WARNING, text)
        return None


async def _learn_ports(context: SessionContext) -> None:
    """Find the ports: those named by the line file must answer R-CT; otherwise all that answer
    count.
    """
    state = context.state
    named = context.order.ports or state.family.ports
    if not state.family.tools:
        state.ports.update({number: PortState(number) for number in named or ()})
        state.facts.ports = list(state.ports)
        return
    for number in named or range(1, 5):
        try:
            tool = await context.reads.confirmed(context.command("tool"), number)
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
        state.ports[number] = PortState(number, tool if isinstance(tool, int) else None)
    if not state.ports:
        raise StartRefused(f"{context.name}: none of its ports answers R-CT")
    state.facts.ports = list(state.ports)
    _require_tools(context)


def _require_tools(context: SessionContext) -> None:
    for port in context.state.ports.values():
        if port.has_tool:
            continue
        if context.order.recipe.run.require_tool:
            raise StartRefused(
                f"{context.name}: no tool in port {port.number}; put one in, take the port out of"
                " `ports`, or set require_tool = false"
            )
        context.log.note(
            "tool.absent",
            Severity.WARNING,
            f"No tool in port {port.number}; it is recorded as no_tool.",
            port=port.number,
        )
