"""Runs on a virtual clock that are captured as by `run --capture`, and runs lived through
once more from that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from jbclog.app.replay import Recording, open_recording, plan_of, reproduce
from jbclog.app.run.tasks import station_tasks
from jbclog.core.capture_rows import LinkRow, ResultRow
from jbclog.core.clock import UtcOffset, VirtualClock
from jbclog.core.io_requests import Steps
from jbclog.core.rows import StationFacts
from jbclog.record.capture import Head
from jbclog.record.capture_recorder import Keep, WireRecorder
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.session.run.context import SessionContext, StationTask
from jbclog.transport.session_history import Divergence, captured
from jbclog.transport.virtual import Peer
from support.virtual.virtual_run import RECIPE, Memory, VirtualRun, prepare

RECIPE_FILE = "recipe.toml"
WRITE_EVERY_S = 0.5


class TapedCable:
    """A cable of the virtual driver, with what passes through it noted as a `Tee` and the reactor
    would.
    """

    def __init__(self, cable: Peer, keep: Keep) -> None:
        self._cable = cable
        self._keep = keep
        self._coming: list[tuple[float, bytes]] = []

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        self._keep(LinkRow(now, "sent", data))
        replies = self._cable.receive(data, now)
        self._coming = sorted([*self._coming, *replies], key=lambda reply: reply[0])
        return replies

    def is_unplugged(self, now: float) -> bool:
        return self._cable.is_unplugged(now)

    def told(self, row: ResultRow) -> None:
        """Note what came up to this moment, or became of the link; then what the session gets."""
        now, reopened = row.at_s, row.request == "reopen"
        if row.what == "broke":
            self._keep(LinkRow(now, "failed" if reopened else "lost", text=row.text))
        elif row.what == "told" and reopened:
            self._coming = []
            self._keep(LinkRow(now, "opened"))
        for at_s, data in self._coming:
            if at_s <= now:
                self._keep(LinkRow(at_s, "heard", data))
        self._coming = [one for one in self._coming if one[0] > now]
        self._keep(row)


def recorded(
    folder: Path,
    line: str,
    recipe: str = RECIPE,
    duration_s: float | None = 10.0,
    rate: float | str | None = None,
    arrange: Callable[[VirtualRun], None] = lambda run: None,
    *,
    allow_omega_write: bool = False,
) -> VirtualRun:
    """Run to the end, and have the wires in `folder`, with line file and recipe. `arrange` sees the
    run before it goes.
    """
    (folder / "recipes").mkdir(parents=True)
    (folder / "line.toml").write_text(line)
    (folder / "recipes" / RECIPE_FILE).write_text(recipe)
    wires, clock = WireRecorder(folder), VirtualClock()

    def pulled(
        order: StationTask, session: Steps[StationFacts], cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        given = order.duration_s, order.rate, order.allow_omega_write
        head = Head(order.name, order.url, RECIPE_FILE, order.t0, clock.utc(), *given)
        taped = TapedCable(cable, wires.begin(head))
        return captured(session, taped.told, lambda: run.driver.clock.monotonic()), taped

    def write() -> None:
        wires.write()
        run.driver.at(run.driver.clock.monotonic() + WRITE_EVERY_S, write)

    run = prepare(
        line, recipe, duration_s, rate, allow_omega_write=allow_omega_write, pulled=pulled
    )
    write()
    arrange(run)
    run.go()
    wires.close()
    assert wires.troubles() == []
    return run


def kept(folder: Path, line: str, **keys: object) -> Memory:
    """A run with its wires and its manifest in `folder`; what it told."""
    run = recorded(folder, line, **keys)  # type: ignore[arg-type]
    write_manifest(
        folder,
        Manifest(
            folder.name,
            state="sealed",
            stations=[context.facts for context in run.contexts.values()],
        ),
    )
    return run.memory


def relived(folder: Path) -> tuple[Memory, dict[str, Divergence]]:
    """A recorded run once more: what its sessions tell, and where they left the recording, if they
    did.
    """
    recording = open_recording(folder)
    memory, clock = Memory(), VirtualClock(recording.first.t0_mono, recording.first.t0_utc)
    return memory, reproduce(recording, desks_of(recording, memory, clock), clock)


def desks_of(recording: Recording, memory: Memory, clock: VirtualClock) -> list[SessionContext]:
    return [
        SessionContext(order, memory, UtcOffset(clock))
        for order in station_tasks(plan_of(recording), clock.monotonic())
    ]
