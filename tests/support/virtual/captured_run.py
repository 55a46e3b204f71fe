"""Runs on a virtual clock that are captured as by `run --capture`, and runs lived through
once more from that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from support.product import (
    Divergence,
    Head,
    KeepCaptureRow,
    LinkRow,
    Peer,
    ResultRow,
    StationFacts,
    StationTask,
    Steps,
    VirtualClock,
    WireRecorder,
    captured_steps,
    open_capture,
    run_captured_again,
    seal_capture,
)
from support.virtual.virtual_run import RECIPE, Memory, VirtualRun, prepare

RECIPE_FILE = "recipe.toml"
WRITE_EVERY_S = 0.5


class TapedCable:
    """A cable of the virtual driver, with what passes through it noted as a `Tee` and the reactor
    would.
    """

    def __init__(self, cable: Peer, keep: KeepCaptureRow) -> None:
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
    """Run to the end, and have the sealed capture in `folder`, with line file and recipe. `arrange`
    sees the run before it goes.
    """
    (folder / "recipes").mkdir(parents=True)
    (folder / "line.toml").write_text(line)
    (folder / "recipes" / RECIPE_FILE).write_text(recipe)
    wire, clock = WireRecorder(folder), VirtualClock()

    def pulled(
        order: StationTask, session: Steps[StationFacts], cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        given = order.duration_s, order.rate, order.allow_omega_write
        head = Head(order.name, order.url, RECIPE_FILE, order.t0, clock.utc(), *given)
        taped = TapedCable(cable, wire.begin(head))
        return captured_steps(session, taped.told, lambda: run.driver.clock.monotonic()), taped

    def write() -> None:
        wire.write()
        run.driver.at(run.driver.clock.monotonic() + WRITE_EVERY_S, write)

    run = prepare(
        line, recipe, duration_s, rate, allow_omega_write=allow_omega_write, pulled=pulled
    )
    write()
    arrange(run)
    run.go()
    wire.close()
    assert wire.trouble is None
    seal_capture(folder)
    return run


def relived(folder: Path) -> tuple[Memory, dict[str, Divergence]]:
    """A recorded run once more: what its sessions tell, and where they left the recording, if they
    did.
    """
    captured = open_capture(folder)
    memory, left = Memory(), dict[str, Divergence]()
    for station in captured.heads:
        _, divergence = run_captured_again(captured, station, memory)
        if divergence is not None:
            left[station] = divergence
    return memory, left
