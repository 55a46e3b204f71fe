"""Taking over: every line at once, each in a thread, each tool made safe by the rules of `safety`.

A line is asked who is there before anything is written: an adapter may have gone and another come. What was done is in
the diary and on stderr, tool by tool, as soon as it is known.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from jbclog.core.errors import Refusal, UsageError, unexpected_error_text
from jbclog.core.io_requests import Steps
from jbclog.core.serial_line import LineFormat
from jbclog.core.states import SafetyResult
from jbclog.guard.action_log import ActionLog
from jbclog.guard.lease import StationLease
from jbclog.guard.messages import say
from jbclog.guard.saving import Saving
from jbclog.protocol.client.interface import Client
from jbclog.protocol.client.make import client_for
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.safety.secure import secure
from jbclog.session.safety.tools import SafetyTask, ToolSafety
from jbclog.transport import blocking
from jbclog.transport.opening import allow_ports, open_port
from jbclog.transport.port import Port

INFO, WARNING, ERROR, CRITICAL = "info", "warning", "error", "critical"
HOT = "it may be hot: switch the station off"
OPENING = 5  # descriptors of a port while it is being opened
ENDED_S = 8.0  # a port whose driver hangs must not keep what came of the others from being told


class TakeOver:
    """Makes safe what these leases hold, and tells the diary. `left` are those of them that still hold something.

    `again`: it was tried before, and what could not be done then was told. `spare`: a tool that rests already is left alone.
    `flooded` are the stations that were told over a flooded link; one that is told again and again would never sleep.
    """

    def __init__(
        self,
        stations: Sequence[StationLease],
        action_log: ActionLog,
        *,
        again: bool = False,
        spare: bool = False,
        flooded: Collection[str] = (),
    ) -> None:
        self.flooded = set(flooded)
        self._left = {station.name: station for station in stations if station.holds}  # until it is known better
        self._action_log = action_log
        self._again = again
        self._spare = spare

    @property
    def left(self) -> list[StationLease]:
        return list(self._left.values())

    def run(self) -> list[StationLease]:
        """Do it; give what is left."""
        stations, end = self.left, time.monotonic() + ENDED_S
        with suppress(UsageError):  # then some will have to be opened again
            allow_ports(OPENING * len(stations))
        savings = [Saving(partial(self._one, station)) for station in stations]
        for saving in savings:
            saving.begin()
        for saving in savings:
            saving.do_unless_begun()
        for saving in savings:
            saving.await_done(max(end - time.monotonic(), 0.0))
        return self.left

    def _one(self, lease: StationLease) -> None:
        try:
            task = self._surely_secured(lease)
        except Exception as error:  # one station that cannot be saved must not keep the others from it
            self._tell(lease, "guard.failed", CRITICAL, f"the guard failed, {unexpected_error_text(error)}; {HOT}")
            return
        if task.flood is not None and all(tool.reached == SafetyResult.SENT for tool in task.tools):
            self.flooded.add(lease.name)
        self._take_note(lease, task)
        for tool in task.tools:
            self._tell_tool(lease, task, tool)
        if task.feeds:
            self._tell(lease, "safety.not_safe", CRITICAL, "the guard could not stop the feeder; switch the station off")

    def _surely_secured(self, lease: StationLease) -> SafetyTask:
        """What `secure` made of it. A fault of this program may be one of a moment: memory was refused, say."""
        try:
            return self._secured(lease)
        except Exception:
            return self._secured(lease)

    def _secured(self, lease: StationLease) -> SafetyTask:
        task = self._task(lease)
        blocking.run(secure(task), lambda: _open(lease), sleep=time.sleep)
        return task

    def _take_note(self, lease: StationLease, task: SafetyTask) -> None:
        remaining = replace(lease, ports=tuple(tool.port for tool in task.tools if not tool.is_safe), feeds=task.feeds)
        if remaining.holds:
            self._left[lease.name] = remaining
        else:
            del self._left[lease.name]

    def _task(self, lease: StationLease) -> SafetyTask:
        family = FAMILIES[lease.family]
        client = client_for(family, _format(lease), lease.address)
        tools = [ToolSafety(port, suction=port in lease.suction) for port in lease.ports]
        return SafetyTask(
            client,
            family,
            lease.safe_state,
            tools,
            lease.feeds,
            lambda: _is_the_one(client, lease),
            is_proven=False,
            spare=self._spare,
            is_stranger=lease.name in self.flooded,
        )

    def _tell_tool(self, lease: StationLease, task: SafetyTask, tool: ToolSafety) -> None:
        if tool.is_safe and tool.status is not None:
            state = task.family.status.shown(tool.status)
            text = "was in its safe state already" if tool.was_spared else "was put in its safe state by the guard"
            why, severity = (f"; {tool.fell_back}", WARNING) if tool.fell_back else ("", INFO)
            self._tell(lease, "safety.safe_state", severity, f"the tool {text}, as read back: {state}{why}", tool.port)
            return
        what = (
            "was told its safe state by the guard and does not confirm it"
            if tool.reached == SafetyResult.SENT
            else "could not be made safe"
        )
        what += "" if task.flood is None else " (its link is flooded)"
        self._tell(lease, "safety.not_safe", CRITICAL, f"the tool {what}; {HOT}", tool.port)

    def _tell(self, lease: StationLease, kind: str, severity: str, text: str, port: int | None = None) -> None:
        if self._again and severity == CRITICAL:
            return
        self._action_log.write(kind, severity, f"{text[0].upper()}{text[1:]}.", lease.name, port)
        say(f"{lease.name if port is None else f'{lease.name} port {port}'}: {text}")


def _format(lease: StationLease) -> LineFormat:
    return LineFormat(lease.baudrate, lease.format)


def _open(lease: StationLease) -> Port:
    return open_port(lease.url, _format(lease))


def _is_the_one(client: Client, lease: StationLease) -> Steps[bool]:
    """Whether the station names the model, and where it tells one the software, that the lease was given for."""
    family = FAMILIES[lease.family]
    commands = family.commands
    if not (lease.model_accepted or family.proves(lease.model or "")):
        return False
    if (yield from client.read(commands["model"])) != lease.model:
        return False
    if lease.software is None:
        return True
    try:
        return (yield from client.read(commands["software_version"])) == lease.software
    except Refusal:
        return False
