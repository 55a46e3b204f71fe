"""Real sessions on real pseudo-terminals: the drivers between station client and transport."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from jbclog.config.line import Line, StationSpec, load_line
from jbclog.config.load_recipe import parse_recipe
from jbclog.core.clock import SystemClock, UtcOffset
from jbclog.core.io_requests import reopen
from jbclog.core.quantities import Value
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station
from jbclog.sim.process import SimProcess
from jbclog.transport import blocking
from jbclog.transport.opening import open_port
from jbclog.transport.port import Port
from jbclog.transport.reactor import Reactor
from support.virtual.virtual_run import RECIPE, Memory, order_for

DDE = FAMILIES["dde"].commands
STATION = (
    '[[station]]\nname = "{name}"\nurl = "{name}"\nfamily = "dde"\nports ='
    " [1]\n[station.sim]\n{sim}\n"
)
# a busy machine takes seconds until the first sample
DROPOUT = '[[station.sim.fault]]\nkind = "dropout"\nat_s = 10\nfor_s = 1.0\n'


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Callable[..., Line]]:
    """Return a function that serves virtual stations s1, s2 and so on, each with its sim table."""
    running: list[SimProcess] = []

    def serve(*sims: str) -> Line:
        path = tmp_path / "bench.toml"
        tables = (STATION.format(name=f"s{number}", sim=sim) for number, sim in enumerate(sims, 1))
        path.write_text('[line]\nname = "bench"\n' + "".join(tables))
        running.append(SimProcess(path, tmp_path / "served").__enter__())
        return load_line(running[-1].line_path)

    yield serve
    for one in running:
        one.__exit__(None, None, None)


def opener(spec: StationSpec) -> Callable[[], Port]:
    return lambda: open_port(spec.url, spec.line_format)


def test_a_plain_loop_asks_a_station(served: Callable[..., Line]) -> None:
    spec = served("").station("s1")
    station = Station(spec.line_format, spec.address)

    async def session() -> list[Value]:
        await reopen()
        model = await station.read(DDE["model"])
        return [model, await station.read(DDE["selected_temperature"], 1)]

    assert blocking.run(session(), opener(spec), sleep=time.sleep) == ["DDE", 350]


@pytest.mark.usefixtures("patient")
def test_a_whole_run_of_two_stations_of_which_one_drops_out(served: Callable[..., Line]) -> None:
    line = served("", DROPOUT)
    memory, clock, reactor = Memory(), SystemClock(), Reactor()
    recipe = parse_recipe(RECIPE + 'on_difference = "continue"\n')
    contexts = [
        SessionContext.of(order_for(spec, recipe, clock, 100.0, None), memory, UtcOffset(clock))
        for spec in line.stations
    ]
    for context, spec in zip(contexts, line.stations, strict=True):
        reactor.add(run_station(context), opener(spec))
    # the run ends when that one is back, whenever that is
    reactor.every(
        0.3, lambda: reactor.end("seen") if "link.back" in memory.kinds() else None, "Look"
    )
    reactor.run()
    assert [context.state.facts.outcome for context in contexts] == ["completed", "completed"]
    assert [context.state.facts.outages for context in contexts] == [0, 1]
    assert [context.state.facts.safe_state for context in contexts] == [
        {1: "verified"},
        {1: "verified"},
    ]
    kinds = [event.kind for event in memory.events if event.station == "s2"]
    assert kinds.index("link.lost") < kinds.index("link.back")
