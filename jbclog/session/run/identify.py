"""Identifies the station, recognizes it after an outage, and reports a lost link."""

from __future__ import annotations

from typing import Final

from jbclog.core.errors import (
    LinkError,
    LinkFlooded,
    NotReceived,
    NotSupported,
    OtherStation,
    OutOfRange,
    Refusal,
    RobotModeOff,
    StartRefused,
    StationError,
)
from jbclog.core.io_requests import Reopen, Steps, Wait
from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.protocol.client.confirmed_reads import (
    NOT_DRIVEN,
    START_TRIES,
    kind_problem,
    pause,
    read_confirmed,
    unanswered_read,
)
from jbclog.protocol.client.interface import expect_quiet
from jbclog.protocol.client.timing import LEAST_ANSWERED, READS, response_time
from jbclog.protocol.commands.family import (
    ROBOT,
    model_not_accepted_text,
    other_model_text,
    unknown_model_text,
)
from jbclog.session.rates import IDENTITY_READS
from jbclog.session.run.context import PortState, SessionContext

# A flooded link counts as lost. A flood is reported once until the station is back. If floods
# recur, the link is tried less and less often, because each try costs a second of listening.

FIRST_SEEK_S: Final = 0.25
SEEK_GROWTH: Final = 1.3  # gentle, so that the search hardly prolongs a short outage
LONGEST_SEEK_S: Final = 5.0
FIRST_AFTER_FLOOD_S: Final = 1.0
FLOOD_GROWTH: Final = 2.0
LONGEST_AFTER_FLOOD_S: Final = 15.0
FORGOTTEN_S: Final = 60.0  # time without a flood after which the next one counts as the first
HOT_C: Final = 60  # a tip last read above this counts as hot


def report_loss(context: SessionContext, cause: LinkError | StationError) -> None:
    """Record the loss."""
    context.facts.outages += 1
    context.connected = False
    if isinstance(cause, RobotModeOff):
        text = (
            "Robot mode was switched off at the station. It is asked again from time to time;"
            " nothing is written to it."
        )
        context.note("robot.off", Severity.ERROR, text)
        return
    if isinstance(cause, LinkFlooded):
        report_flood(context, cause)
        return
    severity, warning = _heat(context)
    if isinstance(cause, OtherStation):
        text = f"The station may be another now: {cause}.{warning}"
        context.note("link.lost", severity, text, since=cause.since)
    else:
        context.note("link.lost", severity, f"The station cannot be reached: {cause}.{warning}")


def report_flood(context: SessionContext, flood: LinkFlooded) -> None:
    """Record a flood, unless one was recorded since the station last answered."""
    if context.is_flooded:
        return
    again = context.flood_ended is not None and context.now - context.flood_ended < FORGOTTEN_S
    context.flood_pause_s = (
        min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S)
        if again
        else FIRST_AFTER_FLOOD_S
    )
    context.is_flooded = True
    severity, warning = _heat(context)
    what = str(flood)
    text = (
        f"{what[0].upper()}{what[1:]}. It counts as lost and is opened again from time to"
        f" time.{warning}"
    )
    context.note(
        "link.flooded",
        severity,
        text,
        since=context.now - flood.seconds,
        value=flood.came,
        limit=flood.limit,
    )


def note_flood_over(context: SessionContext) -> None:
    """Note that the station has been reached again."""
    if context.is_flooded:
        context.is_flooded, context.flood_ended = False, context.now


def first_pause_s(context: SessionContext) -> float:
    """Return the pause before the first try to reconnect."""
    return context.flood_pause_s if context.is_flooded else FIRST_SEEK_S


def next_pause_s(context: SessionContext, pause_s: float) -> float:
    """Return the pause after a failed try that followed a pause of `pause_s`."""
    if not context.is_flooded:
        return min(SEEK_GROWTH * pause_s, LONGEST_SEEK_S)
    context.flood_pause_s = min(FLOOD_GROWTH * context.flood_pause_s, LONGEST_AFTER_FLOOD_S)
    return context.flood_pause_s


def _heat(context: SessionContext) -> tuple[Severity, str]:
    """Return the severity of the loss, and a sentence about what may be hot."""
    hot = [
        port
        for port in context.ports.values()
        if port.touched and (port.temperature_c or 0) > HOT_C
    ]
    tips = ", ".join(f"port {port.number} at {port.temperature_c} °C" for port in hot)
    warning = f" Its {context.family.hot_part} stays as it was last set: {tips}." if hot else ""
    return Severity.CRITICAL if hot else Severity.ERROR, warning


# Whether it is still the same station is checked after every disconnection: adapters swap names,
# and people swap cables. The model proves little on a line of equal units, so the software version
# and the plugged hours are compared too: hours never fall, and grow no faster than time
# (docs/reference/faults.md, F-16 and F-17). They are compared at every reading, because two cables
# can be swapped between two requests; model and software are read as often as the counters. Two
# units of one model and software with equal hours cannot be distinguished by anything that the
# manuals print. OMEGA reports none of these.

RESOLUTION_H = 1  # the counters count whole hours
DRIFT = 0.01  # maximum difference between the station's clock and ours
ROLLS_OVER_AT = 100_000  # five digits


def learn_identity(context: SessionContext) -> Steps[None]:
    """Note the plugged hours of each port, with model and software, to recognize the station
    later.
    """
    context.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    for number in context.ports:
        hours = yield from _hours(context, number)
        if hours is not None:
            context.plugged_hours[number] = (hours, context.now)


def recognise(context: SessionContext, model: str | None) -> Steps[bool]:
    """Whether the station with the name `model` is this run's. Another one is reported once, and
    neither read nor written.

    Raises `StationError` or `LinkError` where it cannot be read.
    """
    other = (
        f"a {model}, not the {context.facts.model}"
        if model != context.facts.model
        else (yield from _difference(context))
    )
    if other is None and context.facts.model_accepted:
        other = yield from _other_kind(context)
    context.is_proven = other is None
    if other is not None and other != context.stranger:
        text = (
            f"On {context.order.url} there is now {other} of this run. It is neither read nor"
            " written."
        )
        context.note("identity.changed", Severity.CRITICAL, text, raw=model)
    context.stranger = other
    if context.is_proven:
        context.identity_at = dict.fromkeys(IDENTITY_READS, context.now)
    return context.is_proven


def is_still_there(context: SessionContext) -> Steps[bool]:
    """Whether the standing link gives no sign of another station: a quick look at model and
    software before the safe order.

    Only another answer is a sign. A station that is silent, refuses, or is garbled counts as there:
    it was proven before, and a hot tool must not wait for more.
    """
    try:
        for name in IDENTITY_READS:
            known = _identity(context, name)
            if known is not None and known != (
                yield from read_confirmed(context.station, context.command(name), known=known)
            ):
                return False
    except LinkError:
        return False
    except StationError:
        return True
    return True


def _other_kind(context: SessionContext) -> Steps[str | None]:
    """Describe why a station with an accepted name is of another kind than at the start; None where
    it is not.
    """
    why = yield from unanswered_read(context.station, context.family, min(context.ports))
    return None if why is None else f"a {context.facts.model} of another kind ({why})"


def _difference(context: SessionContext) -> Steps[str | None]:
    """Describe how a station of the same model differs from this run's; None where it does not."""
    model, software = context.facts.model, context.facts.software
    if software is not None:
        found = yield from context.read_confirmed(
            context.command("software_version"), known=software
        )
        if found != software:
            return f"a {model} with software {found}, not the one with {software}"
    for number, (before, then) in context.plugged_hours.items():
        hours = yield from _hours(context, number, before)
        if hours is not None and not _can_be(hours, before, context.now - then):
            return (
                f"a {model} with {hours} plugged hours on port {number}, not the one with {before}"
            )
    return None


def expect_same(context: SessionContext, number: int, hours: Value) -> None:
    """Raise `OtherStation` where plugged hours just read cannot be those of this run's station."""
    before, then = context.plugged_hours.get(number, (None, 0.0))
    if before is None or not isinstance(hours, int):
        return
    if not _can_be(hours, before, context.now - then):
        raise OtherStation(
            f"the plugged hours of port {number} are {hours}, and were {before}", since=then
        )
    context.plugged_hours[number] = hours, context.now


def is_this_identity(context: SessionContext, name: str, value: Value) -> bool:
    """Whether `value` is the model or software that the station had at the start."""
    return value == _identity(context, name)


def _identity(context: SessionContext, name: str) -> str | None:
    """Return the model or software that the station had at the start; None where it reported
    none.
    """
    return context.facts.model if name == IDENTITY_READS[0] else context.facts.software


def expect_identity(context: SessionContext, name: str, value: Value) -> None:
    """Raise `OtherStation` where a model or software just read is not that of this run's
    station.
    """
    if not is_this_identity(context, name, value):
        since = context.identity_at.get(name, context.order.t0)
        raise OtherStation(
            f"its {name.replace('_', ' ')} is {value}, and was {_identity(context, name)}",
            since=since,
        )
    context.identity_at[name] = context.now


def expect_still_same(context: SessionContext) -> Steps[None]:
    """Read model and software again over the standing link, before a change that was just found is
    recorded as the station's.

    Raises `OtherStation` where another answers, and what reading raises: then the change is not
    known to be the station's.
    """
    for name in IDENTITY_READS:
        known = _identity(context, name)
        if known is None:
            continue
        try:
            found = yield from context.read_confirmed(context.command(name), known=known)
        except NotSupported as error:
            since = context.identity_at.get(name, context.order.t0)
            raise OtherStation(
                f"it no longer knows its {name.replace('_', ' ')}", since=since
            ) from error
        expect_identity(context, name, found)


def _can_be(hours: int, before: int, seconds: float) -> bool:
    """Whether a counter can go from `before` to `hours` in that time."""
    return (hours - before) % ROLLS_OVER_AT <= seconds / 3600 * (1 + DRIFT) + RESOLUTION_H


def _hours(context: SessionContext, number: int, known: int | None = None) -> Steps[int | None]:
    """Read the plugged hours of a port; None where the station has none."""
    counter = context.family.hours
    if counter is None:
        return None
    try:
        hours = yield from context.read_confirmed(
            context.command(counter), number, known=known, grows=True
        )
    except NotSupported:
        return None
    return hours if isinstance(hours, int) else None


CORRECT_IT = "Correct `model`, or the cable"


class StationAbsent(StartRefused):
    """The station did not answer at the start."""


def identify(context: SessionContext) -> Steps[None]:
    """Open the port and identify the station. Raises `StartRefused` with what to do."""
    context.facts.model = yield from connect(context, reopen=True, tries=START_TRIES)
    context.connected = context.is_proven = True
    context.tries = START_TRIES
    yield from _learn_family(context)
    yield from _learn_ports(context)
    yield from _accept_model(context)
    yield from measure_turnaround(context)
    yield from _learn_who(context)
    context.publish()


def _learn_who(context: SessionContext) -> Steps[None]:
    try:
        yield from learn_identity(context)
    except StationError as error:
        raise StartRefused(f"{context.name}: cannot read plugged hours: {error}") from error


def connect(context: SessionContext, *, reopen: bool, tries: int) -> Steps[str | None]:
    """Open the port and read the model name, at the start and after an outage.

    None where the family reports none: then another answer proves the protocol and nothing more.
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
            # every family that has R-SMN has the same, so it works before the family is known
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
    return (
        f"{context.name}: no usable answer on {order.url} at {order.line.baudrate}"
        f" {order.line.format}, {addressing} ({error}, in {tries}"
        f" {'try' if tries == 1 else 'tries'}); check that the station is on, {mode}the cable, and"
        " the line format; `jbclog doctor --line` looks for the reason"
    )


def _learn_family(context: SessionContext) -> Steps[None]:
    model = context.facts.model or ""
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
    """Read the software version; None where the station refuses, because it has none, or where it
    cannot be read.

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
    """Find the ports: those named by the line file must answer R-CT; otherwise all that do
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


def measure_turnaround(context: SessionContext) -> Steps[None]:
    """Measure the response time with harmless reads, in µs."""
    measured, answered = yield from response_time(
        context.station, context.family, min(context.ports)
    )
    if measured is None or answered < LEAST_ANSWERED:
        raise StartRefused(
            f"{context.name}: only {answered} of {READS} questions were answered; the link is too"
            " bad to run on"
        )
    context.facts.turnaround_us = {
        "median": round(measured.median, 1),
        "p99": round(measured.longest, 1),
        "n": answered,
    }
    for name in measured.ignored:
        context.not_supported.add(context.family.signal_of(name) or name)
    context.link_is_faster = measured.faster_text(context.order.line)
    if measured.is_faster:
        context.facts.turnaround_us["faster_by"] = round(measured.wire - measured.whole, 1)
