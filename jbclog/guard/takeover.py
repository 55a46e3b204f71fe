"""Taking over: every line at once, each in a thread, each tool made safe by the rules of `safety`.

A line is asked who is there before anything is written: an adapter may have gone and another come. What was done is in
the diary and on stderr, tool by tool, as soon as it is known.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from threading import Thread

from jbclog.commands.family import FAMILIES
from jbclog.drive import blocking
from jbclog.effects import Steps
from jbclog.errors import Refusal
from jbclog.guard.diary import Diary
from jbclog.guard.lease import StationLease
from jbclog.safety.secure import SENT, Task, Tool, secure
from jbclog.station.client import Client
from jbclog.station.make import client_for
from jbclog.transport import Port, open_port
from jbclog.wire import LineFormat

INFO, ERROR, CRITICAL = "info", "error", "critical"
HOT = "it may be hot: switch the station off"


def take_over(stations: Sequence[StationLease], diary: Diary) -> list[StationLease]:
    """Make safe what these leases hold; give those of them that still hold something."""
    left: dict[str, StationLease] = {}
    threads = [Thread(target=_one, args=(station, diary, left), daemon=True) for station in stations if station.holds]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return list(left.values())


def _one(lease: StationLease, diary: Diary, left: dict[str, StationLease]) -> None:
    left[lease.name] = lease  # until it is known better
    try:
        task = _task(lease)
        blocking.run(secure(task), lambda: _open(lease), sleep=time.sleep)
    except Exception as error:  # one station that cannot be saved must not keep the others from it
        _say(diary, lease, "guard.failed", CRITICAL, f"the guard failed, {type(error).__name__}: {error}; {HOT}")
        return
    for tool in task.tools:
        _tell(diary, lease, task, tool)
    if task.feeds:
        _say(diary, lease, "safety.not_safe", CRITICAL, "the guard could not stop the feeder; switch the station off")
    remaining = replace(lease, ports=tuple(tool.port for tool in task.tools if not tool.is_safe), feeds=task.feeds)
    if remaining.holds:
        left[lease.name] = remaining
    else:
        del left[lease.name]


def _task(lease: StationLease) -> Task:
    family = FAMILIES[lease.family]
    client = client_for(family, _format(lease), lease.address)
    tools = [Tool(port) for port in lease.ports]
    return Task(client, family, lease.safe_state, tools, lease.feeds, lambda: _is_the_one(client, lease), is_proven=False)


def _format(lease: StationLease) -> LineFormat:
    return LineFormat(lease.baudrate, lease.format)


def _open(lease: StationLease) -> Port:
    return open_port(lease.url, _format(lease))


def _is_the_one(client: Client, lease: StationLease) -> Steps[bool]:
    """Whether the station names the model, and where it tells one the software, that the lease was given for."""
    commands = FAMILIES[lease.family].commands
    if (yield from client.read(commands["model"])) != lease.model:
        return False
    if lease.software is None:
        return True
    try:
        return (yield from client.read(commands["software_version"])) == lease.software
    except Refusal:
        return False


def _tell(diary: Diary, lease: StationLease, task: Task, tool: Tool) -> None:
    if tool.is_safe and tool.status is not None:
        state = task.family.status.state(tool.status)
        _say(diary, lease, "safety.safe_state", INFO, f"the guard put the tool in its safe state, as read back: {state}", tool.port)
        return
    what = "was told its safe state by the guard and does not confirm it" if tool.reached == SENT else "could not be made safe"
    _say(diary, lease, "safety.not_safe", CRITICAL, f"the tool {what}; {HOT}", tool.port)


def _say(diary: Diary, lease: StationLease, kind: str, severity: str, text: str, port: int | None = None) -> None:
    place = lease.name if port is None else f"{lease.name} port {port}"
    diary.write(kind, severity, f"{text[0].upper()}{text[1:]}.", lease.name, port)
    with suppress(OSError, ValueError):
        sys.stderr.write(f"jbclog guard: {place}: {text}\n")
        sys.stderr.flush()
