"""Order a station that does not answer, within the limits of `continuity`, beside the question
which station it is.
"""

from __future__ import annotations

from collections.abc import Callable

from jbclog.core.clock import elapsed
from jbclog.core.errors import LinkFlooded, StationError
from jbclog.core.states import SafetyResult
from jbclog.guard.continuity import Continuity, why_left_alone
from jbclog.guard.identifying import identify
from jbclog.guard.lease import StationLease
from jbclog.protocol.commands.status import StatusWord
from jbclog.session.safety.blind import blind_word, write_unanswered
from jbclog.session.safety.secure import LOOK_S
from jbclog.session.safety.time_budget import in_time
from jbclog.session.safety.tools import SafetyTask, ToolSafety
from jbclog.transport.device import PortDevice


class BlindOrders:
    """The orders to one station during one take-over; `prove` is its `SafetyTask.prove`.

    `device`: what the open port leads to. `is_mixed` may wait a moment for other runs' leases.
    `found_other`: a station that was found in its place during this take-over.
    """

    def __init__(
        self,
        lease: StationLease,
        continuity: Continuity,
        is_mixed: Callable[[], bool],
        now: Callable[[], float] = elapsed,
    ) -> None:
        self.device: PortDevice | None = None
        self.found_other: str | None = None
        self.was_mixed = False
        self._why = ""  # nothing is sent to the station
        self._why_not_port: dict[int, str] = {}
        self._lease = lease
        self._continuity = continuity
        self._is_mixed = is_mixed
        self._now = now

    @property
    def count(self) -> int:
        """Number of orders sent since the recorder's death."""
        return self._continuity.orders[self._lease.name]

    def ordered(self, port: int) -> tuple[StatusWord, int] | None:
        """Return the state that the tool in `port` was last ordered into, and how often it was
        ordered; None if it was not.
        """
        return self._continuity.ordered.get((self._lease.name, port))

    def why_not(self, port: int) -> str:
        """Return why the tool in `port` got no order; empty if it was not refused one."""
        return self._why_not_port.get(port) or self._why

    async def prove(self, task: SafetyTask) -> bool:
        """Ask which station it is. If that is not answered at once, order it, and ask again."""
        client, failure = task.client, None
        try:
            if await in_time(self._identify(task), client.now, client.now + LOOK_S):
                return True
        except (StationError, LinkFlooded) as error:
            failure = error
        await self._order_if_allowed(task)
        if isinstance(failure, LinkFlooded):
            raise failure
        return await self._identify(task)

    async def _identify(self, task: SafetyTask) -> bool:
        hours = self._continuity.hours.get(self._lease.name, {})
        return await identify(task.client, self._lease, hours, self._note_other)

    def _note_other(self, description: str) -> None:
        if self._lease.name not in self._continuity.others:
            self.found_other = self._continuity.others[self._lease.name] = description

    async def _order_if_allowed(self, task: SafetyTask) -> None:
        self.was_mixed = self._is_mixed()
        why = self._continuity.why_not(self._lease, self.device, self._now())
        if why is not None:
            self._why = why
            for tool in task.tools if self.count else ():
                self._word(task, tool)  # why a tool that rests was not among those ordered
            # over a flooded link the usual order would go out, which may heat on a mixed line
            if self.was_mixed or self.count or self._may_be_other():
                task.is_stranger = True
            return
        self._why = ""
        task.is_stranger = True  # the orders over a flooded link are these
        before = task.client.exchanges
        try:
            await self._order(task)
        finally:  # the link may break after the first of them
            if task.client.exchanges > before:
                self._continuity.orders[self._lease.name] += 1

    async def _order(self, task: SafetyTask) -> None:
        """Stop the feeder, and order each tool that was at work."""
        if task.feeds:
            await write_unanswered(task.client, task.family, "stop_feeding", 0)
        for tool in task.tools:
            word = self._word(task, tool)
            if word is None or not self._is_allowed_now():
                continue
            if await write_unanswered(task.client, task.family, "status", word, tool.port):
                tool.note_order(word)
                self._continuity.note_order(self._lease.name, tool.port, word)
                tool.reached = SafetyResult.SENT

    def _may_be_other(self) -> bool:
        """Return True if another station was found, or the port leads to another device."""
        name = self._lease.name
        is_found = name in self._continuity.others
        return is_found or self._continuity.has_changed(name, self.device)

    def _is_allowed_now(self) -> bool:
        """Return True if the station is still proven, just before an order is sent."""
        return self._continuity.why_not(self._lease, self.device, self._now()) is None

    def _word(self, task: SafetyTask, tool: ToolSafety) -> StatusWord | None:
        proof = self._continuity.proofs[self._lease.name]
        why = why_left_alone(task.family, proof.statuses.get(tool.port))
        word = blind_word(
            task.family, suction=tool.port in self._lease.suction, mixed=self.was_mixed
        )
        if why is None and word is None:
            why = "no order is safe on a line with hot air and this family"
        if why is None:
            return word
        self._why_not_port[tool.port] = why
        return None
