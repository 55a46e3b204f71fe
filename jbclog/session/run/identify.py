"""Chapter 1: who answers here, with which ports and tools, and how fast."""

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
from jbclog.protocol.client.family_proof import NOT_DRIVEN, why_not_borne_out
from jbclog.protocol.client.flow import expect_quiet
from jbclog.protocol.client.patient_reads import START_TRIES, pause
from jbclog.protocol.client.turnaround import LEAST_ANSWERED, READS, response_time
from jbclog.protocol.commands.family import ROBOT
from jbclog.protocol.commands.models import not_accepted, other_model, unknown_model
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.identity import learn_identity
from jbclog.session.run.loss import tell_flood

CORRECT_IT = "Correct `model`, or the cable"


class Absent(StartRefused):
    """The station did not answer at the start."""


def identify(desk: SessionContext) -> Steps[None]:
    """Open the port and prove who is there. Raises `StartRefused` with what to do."""
    desk.facts.model = yield from connect(desk, reopen=True, tries=START_TRIES)
    desk.connected = desk.is_proven = True
    desk.tries = START_TRIES
    yield from _learn_family(desk)
    yield from _learn_ports(desk)
    yield from _accept_model(desk)
    yield from measure_turnaround(desk)
    yield from _learn_who(desk)
    desk.publish()


def _learn_who(desk: SessionContext) -> Steps[None]:
    try:
        yield from learn_identity(desk)
    except StationError as error:
        raise StartRefused(f"{desk.name}: cannot read plugged hours: {error}") from error


def connect(desk: SessionContext, *, reopen: bool, tries: int) -> Steps[str | None]:
    """Open the port and read the model name; used at the start and after an outage.

    None where the family does not tell one: then it has answered something else, which proves the protocol and no more.
    """
    desk.station.unasked((yield Wait(0.0)))
    try:
        if reopen:
            desk.station.unasked((yield Reopen()))
        if desk.is_flooded:
            yield from expect_quiet(desk.station)
        return (yield from _answer(desk, tries))
    except LinkError as error:
        desk.is_proven = False
        if isinstance(error, LinkFlooded):
            tell_flood(desk, error)
        raise Absent(f"{desk.name}: {error}") from error


def _answer(desk: SessionContext, tries: int) -> Steps[str | None]:
    for number in range(1, tries + 1):
        try:
            if desk.family_known and not desk.family.models:
                yield from desk.station.read(desk.command(desk.family.harmless[0]))
                return None
            # R-SMN is the same command in every family that has it, so it may be asked before the family is known
            command = next(iter(desk.order.families.values())).commands["model"]
            return str((yield from desk.agreed(command, known=desk.facts.model)))
        except RobotModeOff as error:
            raise StartRefused(f"{desk.name}: Robot mode is off; switch it on in the station's menu") from error
        except StationError as error:
            if number == tries:
                raise Absent(_no_answer(desk, error, tries)) from error
        yield from pause(desk.station, number)
    raise AssertionError("no try at all")


def _no_answer(desk: SessionContext, error: StationError, tries: int) -> str:
    order, is_robot = desk.order, not desk.family_known or desk.family.protocol == ROBOT
    mode = "Robot mode is switched on in its menu, " if is_robot else ""
    addressing = "without addresses" if order.address is None else f"address {order.address:02d}"
    return (
        f"{desk.name}: no usable answer on {order.url} at {order.line.baudrate} {order.line.format}, {addressing} "
        f"({error}, in {tries} {'try' if tries == 1 else 'tries'}); "
        f"check that the station is on, {mode}the cable, and the line format; `jbclog doctor --line` looks for the reason"
    )


def _learn_family(desk: SessionContext) -> Steps[None]:
    model = desk.facts.model or ""
    if desk.order.model is not None:
        if model != desk.order.model:
            raise StartRefused(f"{desk.name}: {not_accepted(desk.order.model, model)}; nothing was written to it. {CORRECT_IT}")
    elif not desk.family_known:
        proven = [family for family in desk.order.families.values() if family.proves(model)]
        if not proven:
            raise StartRefused(f"{desk.name}: {unknown_model(model)}. Nothing was written to it")
        desk.family = max(proven, key=lambda family: family.name != "soldering")
    elif desk.family.models and not desk.family.proves(model):
        raise StartRefused(f"{desk.name}: {other_model(desk.family, model)}")
    if desk.family.name not in desk.recipe.families:
        raise StartRefused(f"{desk.name}: recipe {desk.recipe.name} is not for family {desk.family.name}")
    if "software_version" in desk.family.commands:
        desk.facts.software = yield from _software(desk)


def _accept_model(desk: SessionContext) -> Steps[None]:
    """Bear out by reads a family that the line file names for the model name: that one never proves the kind of station."""
    model = desk.order.model
    if model is None:
        return
    port = next((one.number for one in desk.ports.values() if one.has_tool), min(desk.ports))
    why = yield from why_not_borne_out(desk.station, desk.family, port)
    if why is not None:
        raise StartRefused(f"{desk.name}: model {model} is driven as {desk.family.name} by the line file, but {why}. {NOT_DRIVEN}")
    desk.facts.model_accepted = True
    text = f"The station says model {model} and is driven as {desk.family.name}, as the line file's key `model` accepts."
    desk.note("station.model_accepted", Severity.INFO, text, raw=model)


def _software(desk: SessionContext) -> Steps[str | None]:
    """The software version; None where the station refuses the question, which is how it says that it does not know it, or where
    it could not be read. That is a warning, because what is not known identifies nobody.
    """
    try:
        return str((yield from desk.agreed(desk.command("software_version"))))
    except StationError as error:
        if isinstance(error, Refusal) and not isinstance(error, NotReceived | RobotModeOff):
            desk.not_supported.add("software_version")
            return None
        text = f"The software version could not be read ({error}): after an outage the station is identified without it."
        desk.note("identity.not_known", Severity.WARNING, text)
        return None


def _learn_ports(desk: SessionContext) -> Steps[None]:
    """Ports that the line file names must answer R-CT; without a name, those that do are meant."""
    named = desk.order.ports or desk.family.ports
    if not desk.family.tools:
        desk.ports.update({number: PortState(number) for number in named or ()})
        desk.facts.ports = list(desk.ports)
        return
    for number in named or range(1, 5):
        try:
            tool = yield from desk.agreed(desk.command("tool"), number)
        except (NotSupported, OutOfRange) as error:
            if named:
                raise StartRefused(f"{desk.name}: it has no port {number} ({error}); correct `ports` in the line file") from error
            continue
        except (Refusal, StationError) as error:
            raise StartRefused(f"{desk.name}: cannot read tool of port {number}: {error}") from error
        desk.ports[number] = PortState(number, tool if isinstance(tool, int) else None)
    if not desk.ports:
        raise StartRefused(f"{desk.name}: none of its ports answers R-CT")
    desk.facts.ports = list(desk.ports)
    _require_tools(desk)


def _require_tools(desk: SessionContext) -> None:
    for port in desk.ports.values():
        if port.has_tool:
            continue
        if desk.recipe.run.require_tool:
            raise StartRefused(
                f"{desk.name}: no tool in port {port.number}; put one in, take the port out of `ports`, or set require_tool = false"
            )
        desk.note("tool.absent", Severity.WARNING, f"No tool in port {port.number}; it is recorded as no_tool.", port=port.number)


def measure_turnaround(desk: SessionContext) -> Steps[None]:
    """Ask harmless questions and keep how long the station itself takes to answer, in µs."""
    measured, answered = yield from response_time(desk.station, desk.family, min(desk.ports))
    if measured is None or answered < LEAST_ANSWERED:
        raise StartRefused(f"{desk.name}: only {answered} of {READS} questions were answered; the link is too bad to run on")
    desk.facts.turnaround_us = {"median": round(measured.median, 1), "p99": round(measured.longest, 1), "n": answered}
    for name in measured.ignored:
        desk.not_supported.add(desk.family.signal_of(name) or name)
    desk.link_is_faster = measured.faster_text(desk.order.line)
    if measured.is_faster:
        desk.facts.turnaround_us["faster_by"] = round(measured.wire - measured.whole, 1)
