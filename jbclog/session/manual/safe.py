"""Make a whole station safe by command, and describe how its tools cool afterwards.

There is no recipe, so each family's default safe state is ordered, and the station's own delays
decide whether a standing tool ever cools. A resting tool is left alone: an order to stand would
wake a sleeping tool, and heat one that is cold in its extractor state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from jbclog.core.errors import LinkError, LinkFlooded, StartRefused, StationError
from jbclog.core.io_requests import reopen, wait
from jbclog.core.quantities import OFF
from jbclog.core.states import SafetyResult
from jbclog.protocol.client.confirmed_reads import read_confirmed
from jbclog.protocol.client.make import client_for
from jbclog.protocol.commands.command import TOOLS_WITH_A_PLACE
from jbclog.protocol.commands.family import Family, family_of
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.ranges import NO_COUNTDOWN
from jbclog.session.manual.contact import (
    NO_TOOL,
    PORTS,
    Contact,
    Target,
    expect_borne_out,
    find_tool,
    open_contact,
)
from jbclog.session.manual.read import believed
from jbclog.session.safety.blind import blind_word, write_unanswered
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety
from jbclog.session.setting_write import Place

# A standing tool keeps its setpoint until its sleep delay has passed, and its sleep temperature
# until the hibernation delay has. An unreadable value is unknown: it counts neither as cooling nor
# as cold.
SLEEPS, HIBERNATES = "sleep", "hibernate"
DELAYS: Final[Mapping[str, str]] = MappingProxyType(
    {SLEEPS: "sleep_delay", HIBERNATES: "hibernation_delay"}
)
NEXT_FROM: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"stand": (SLEEPS, HIBERNATES), "sleep": (HIBERNATES,)}
)
"""Next states of a tool by itself, by its state; from other states there are none."""


@dataclass(frozen=True, slots=True)
class Cooling:
    """What follows the state that a tool rests in.

    `follows`: its next states in order; empty if its heater is off. `in_s`: seconds to the first,
    None if unknown. `never`: states whose delays are off, None if unknown.
    """

    follows: tuple[str, ...] = ()
    in_s: int | None = None
    never: tuple[str, ...] | None = ()

    def text(self) -> str:
        """Format: ``sleeps in 2 min 56 s``; ``will not sleep by itself, its delay is off``; ``its
        heater is off``.
        """
        if not self.follows:
            return "its heater is off"
        first, never = self.follows[0], self.never or ()
        if first in never:
            found = [f"will not {first} by itself, its delay is off"]
        elif self.in_s is None:
            found = [f"when it {first}s is not known"]
        else:
            found = [f"{first}s in {duration(self.in_s)}"]
        found += [
            f"will not {what} by itself, its delay is off"
            for what in self.follows[1:]
            if what in never and first not in never
        ]
        return ", ".join(found)


def duration(seconds: float) -> str:
    """Format seconds: ``2 min 56 s``, ``45 s``, ``30 min``."""
    minutes, rest = divmod(round(seconds), 60)
    parts = [f"{minutes} min"] if minutes else []
    return " ".join([*parts, *([f"{rest} s"] if rest or not minutes else [])])


async def cooling_of(contact: Contact, port: int, code: int | None, state: str) -> Cooling:
    """Return the next states of the tool with this code in `port`; `state` is its resting state.
    Does not raise station errors.
    """
    follows = NEXT_FROM.get(state, ()) if DELAYS[SLEEPS] in contact.family.commands else ()
    if not follows:
        return Cooling()
    never = await _never(contact, Place(port, code), follows)
    return Cooling(follows, await _countdown(contact, port), never)


async def _never(
    contact: Contact, place: Place, follows: tuple[str, ...]
) -> tuple[str, ...] | None:
    if place.tool is not None and place.tool not in TOOLS_WITH_A_PLACE:
        return None
    found = []
    try:
        for what in follows if place.tool is not None else ():
            if (await contact.read_confirmed(contact.family.commands[DELAYS[what]], place)) is OFF:
                found.append(what)
    except (StationError, LinkError):
        return None
    return tuple(found)


async def _countdown(contact: Contact, port: int) -> int | None:
    """Return the station's countdown in seconds; None if there is none or it is unknown."""
    command = contact.family.command_of("delay_s")
    try:
        left = None if command is None else await believed(contact, command, Place(port))
    except (StationError, LinkError):
        return None
    return left if isinstance(left, int) and left not in NO_COUNTDOWN else None


async def temperature_of(contact: Contact, port: int) -> float | None:
    """Return the temperature of the tool in `port` by two answers; None if it is unknown, or there
    is no tool.
    """
    command = contact.family.command_of("temperature_c")
    try:
        if command is None or await find_tool(contact, port) == NO_TOOL:
            return None
        value = await believed(contact, command, Place(port))
    except (StationError, LinkError):
        return None
    return float(value) if isinstance(value, int | float) else None


async def temperatures(
    target: Target, model: str | None, ports: tuple[int, ...]
) -> dict[int, float]:
    """Return the known temperatures of these tools; none for another station."""
    try:
        contact = await open_contact(target)
    except (StationError, StartRefused):
        return {}
    if contact.model != model:
        return {}
    found = {}
    for port in ports:
        celsius = await temperature_of(contact, port)
        if celsius is not None:
            found[port] = celsius
    return found


SWITCH_OFF: Final = "switch the station off"


@dataclass(slots=True)
class MadeSafe:
    """One tool: its name (None if unknown), the state read back, and why it is not safe, if so.

    `rested`: it was in that state already. `ordered`: the last state ordered; `fell_back`: why it
    is not the default. `temperature_c`: now, None if unknown; `last_c`: as last read. `cooling`:
    its next states. `is_cold`: after waiting, whether it was seen below the limit; None without
    waiting.
    """

    port: int
    tool_name: str | None
    state: str | None = None
    rested: bool = False
    ordered: str | None = None
    fell_back: str = ""
    suction: bool = False
    temperature_c: float | None = None
    last_c: float | None = None
    cooling: Cooling | None = None
    is_cold: bool | None = None
    problem: str | None = None

    @property
    def is_safe(self) -> bool:
        return self.state is not None and self.problem is None


@dataclass(slots=True)
class StationMadeSafe:
    """The result for one station so far. `problem` concerns it as a whole; `note` is for
    information.

    `feeder` is ``stopped``, ``running`` (it could not be stopped) or None if there is none. `empty`
    lists ports without a tool. `is_unanswered`: its port could be opened, and nothing usable came.
    """

    target: Target
    model: str | None = None
    family: str | None = None
    tools: list[MadeSafe] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    feeder: str | None = None
    problem: str | None = None
    note: str | None = None
    is_unanswered: bool = False

    @property
    def is_safe(self) -> bool:
        return (
            self.problem is None
            and self.feeder != FeederState.RUNNING
            and all(tool.is_safe for tool in self.tools)
        )


async def make_safe(target: Target, made: StationMadeSafe) -> None:
    """Put every tool of a station in its safe state, after stopping its feeder. Raises
    `StartRefused` and `LinkError`.
    """
    try:
        contact = await open_contact(target)
    except LinkFlooded as flood:
        if target.family is None or not target.family.safe_states:
            raise
        await _order_over_flood(target, target.family, made, flood)
        return
    family = contact.family = await _proven(contact, made)
    made.model = contact.model
    made.family = family.name
    if not family.safe_states:
        made.problem = (
            f"an {family.title} has no safe state, it takes no order that would make it safe: stop"
            f" it at its own panel, or {SWITCH_OFF}"
        )
        return
    tools = await _find_tools(contact, made)
    task = SafetyTask(
        contact.client,
        family,
        family.safe_states[0],
        [ToolSafety(port, suction=None) for port in tools],
        family.has_feeder,
        lambda: _is_still_there(contact),
        spare=True,
    )
    await secure(task)
    _store_feeder(task, made)
    for tool, result in zip(task.tools, made.tools, strict=True):
        _store_result(task, tool, result)
        await _report(contact, task, tool, result, tools[tool.port])


async def _order_over_flood(
    target: Target, family: Family, made: StationMadeSafe, flood: LinkFlooded
) -> None:
    """Order the safe state on every port of line file or family, unproven, over a flooded link."""
    client = client_for(family, target.line, target.address)
    client.unasked(await wait(0.0))
    client.flow.is_flooded = True
    ports = target.ports or family.ports or PORTS

    async def prove() -> bool:
        model = str(await read_confirmed(client, family.commands["model"]))
        return family.proves(model) if target.model is None else model == target.model

    tools = [ToolSafety(port) for port in ports]
    task = SafetyTask(
        client, family, family.safe_states[0], tools, family.has_feeder, prove, is_proven=False
    )
    await secure(task)
    made.family = family.name
    made.note = str(flood)
    made.tools = [MadeSafe(port, None) for port in ports]
    _store_feeder(task, made)
    for tool, result in zip(task.tools, made.tools, strict=True):
        _store_result(task, tool, result)


def _store_feeder(task: SafetyTask, made: StationMadeSafe) -> None:
    if task.family.has_feeder:
        made.feeder = FeederState.RUNNING if task.feeds else FeederState.STOPPED


def _store_result(task: SafetyTask, tool: ToolSafety, result: MadeSafe) -> None:
    """Store what a tool confirmed."""
    status = task.family.status
    if tool.ordered is not None:
        result.ordered = status.state(tool.ordered)
    if tool.is_safe and tool.status is not None:
        result.state = status.state(tool.status)
    else:
        result.problem = _unconfirmed(tool, task)


async def order_unanswered(target: Target, made: StationMadeSafe) -> None:
    """Stop the feeder, and order the family's safe state once on every port of line file or family,
    without asking which station it is. Raises `LinkError`.
    """
    family = target.family
    if family is None:
        return
    word = blind_word(family, suction=False, mixed=False)
    if word is None:
        return
    client = client_for(family, target.line, target.address)
    client.unasked(await wait(0.0))
    client.unasked(await reopen())
    if family.has_feeder:
        await write_unanswered(client, family, "stop_feeding", 0)
        made.feeder = FeederState.RUNNING  # as far as anybody knows
    state = family.status.state(word)
    for port in target.ports or family.ports or PORTS:
        problem = f"{state} was ordered once without an answer, not confirmed: {SWITCH_OFF}"
        if not await write_unanswered(client, family, "status", word, port):
            problem = f"{state} could not be sent: {SWITCH_OFF}"
        made.tools.append(MadeSafe(port, None, ordered=state, problem=problem))


def _unconfirmed(tool: ToolSafety, task: SafetyTask) -> str:
    what = "could not be made safe"
    if tool.reached == SafetyResult.SENT:
        what = "was ordered to rest and does not confirm it"
    if task.flood is not None:
        what += " (its link is flooded)"
    return f"it {what}; it may be hot: {SWITCH_OFF}"


async def _proven(contact: Contact, made: StationMadeSafe) -> Family:
    """Return the family that the station itself proves, regardless of the line file; for an
    accepted model name, the family that reads prove. Raises `StartRefused` for any other station.
    """
    if contact.is_proven:
        await expect_borne_out(contact)
        return contact.family
    found = family_of(contact.model or "")
    if found is None:
        raise StartRefused(
            f"{contact.stranger()}; nothing was written to it. It may be hot: {SWITCH_OFF}"
        )
    made.note = (
        f"the line file says family {contact.family.name}, the station says model {contact.model}"
        " and was spoken to as such"
    )
    return found


async def _is_still_there(contact: Contact) -> bool:
    return await contact.client.read(contact.family.commands["model"]) == contact.model


async def _find_tools(contact: Contact, made: StationMadeSafe) -> dict[int, int | None]:
    """Find the tools of all ports. None is a tool that could not be read; it counts as one."""
    tools: dict[int, int | None] = {}
    for port in contact.family.ports or PORTS:
        try:
            code = await find_tool(contact, port)
        except (StationError, LinkError):
            tools[port] = None
        else:
            if code == NO_TOOL:
                made.empty.append(port)
            elif code is not None:
                tools[port] = code
    made.tools = [
        MadeSafe(port, None if code is None else contact.family.tool_name(code))
        for port, code in tools.items()
    ]
    return tools


async def _report(
    contact: Contact, task: SafetyTask, tool: ToolSafety, made: MadeSafe, code: int | None
) -> None:
    made.rested = tool.was_spared
    made.fell_back = tool.fell_back
    if task.flood is None:
        made.temperature_c = made.last_c = await temperature_of(contact, tool.port)
    if made.state is None or tool.status is None:
        return
    made.suction = contact.family.status.sucks(tool.status)
    made.cooling = await cooling_of(contact, tool.port, code, made.state)
    made.problem = _stays_hot(made.cooling, code)


def _stays_hot(cooling: Cooling, code: int | None) -> str | None:
    """Describe why a standing tool never cools: a delay that is off or unreadable. None if it
    cools.

    A tool left in its extractor state was seen to cool.
    """
    if cooling.follows and code is not None and code not in TOOLS_WITH_A_PLACE:
        return (
            f"whether it will cool down is not known, because no command can address tool {code}:"
            f" look at it, or {SWITCH_OFF}"
        )
    if cooling.never is None:
        return (
            "whether it will cool down is not known, because its delays cannot be read: look at"
            f" it, or {SWITCH_OFF}"
        )
    off = [DELAYS[what].replace("_", " ") for what in cooling.never]
    if not off:
        return None
    verb = "is" if len(off) == 1 else "are"
    return f"its {' and '.join(off)} {verb} off, so it never cools down: {SWITCH_OFF}"
