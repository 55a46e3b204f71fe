"""Every line format of the older stations (manual 000, 2.1), opened on a real terminal, and a run
at all twelve rates at once.

Linux sets 250000, 460800 and 500000 by a newer interface that takes any number; they are not rates
of the old one.
"""

from __future__ import annotations

import json
import termios
from itertools import product
from pathlib import Path

import pytest

from support.command import jbclog
from support.links.far_ends import terminal
from support.product import BAUDRATES, LineFormat, SimProcess, line_set, load_line, open_port

FORMATS = tuple(f"8{parity}{stop}" for parity, stop in product("NEO", (1, 2)))


@pytest.mark.parametrize("baudrate", BAUDRATES)
def test_a_terminal_is_set_to_each(baudrate: int) -> None:
    """The exact rate, the stop bits, and all that a pseudo-terminal keeps of the parity: whether it
    is odd.
    """
    with terminal() as far:
        for form in FORMATS:
            port = open_port(far.url, LineFormat(baudrate, form))
            other = LineFormat(1200 if baudrate != 1200 else 2400, form)
            assert line_set(far.far, other).baudrate == baudrate
            flags = termios.tcgetattr(far.far)[2]
            assert bool(flags & termios.CSTOPB) == form.endswith("2")
            assert bool(flags & termios.PARODD) == ("O" in form)
            port.write(b"\x02RSMN\x03\x03")
            assert far.heard_all(7) == b"\x02RSMN\x03\x03"
            far.say(b"\x02ASMN  DDR\x03\x11\x13")
            heard = b""
            while len(heard) < 13 and (more := port.read(20.0)):
                heard += more
            assert heard == b"\x02ASMN  DDR\x03\x11\x13"
            port.close()


LINE = '[line]\nname = "menu"\n'
STATION = """
[[station]]
name = "old-{baudrate}"
url = "old-{baudrate}"
family = "soldering"
baudrate = {baudrate}
format = "{form}"
ports = [1]
[station.sim]
wire = false
turnaround_ms = 0
"""
RECIPE = (
    '[recipe]\nname = "menu"\nrevision = 1\nfamilies = ["soldering"]\n[temperature]\nselect_c ='
    ' 320\n[run]\nstatus = "working"\n'
)


def test_stations_at_all_rates_are_recorded_side_by_side(tmp_path: Path) -> None:
    """On the ports of this machine; each virtual station uses the line format that its client has
    set.
    """
    line, recipe = tmp_path / "menu.toml", tmp_path / "recipe.toml"
    formats = [FORMATS[place % len(FORMATS)] for place in range(len(BAUDRATES))]
    line.write_text(
        LINE
        + "".join(
            STATION.format(baudrate=rate, form=form)
            for rate, form in zip(BAUDRATES, formats, strict=True)
        )
    )
    recipe.write_text(RECIPE)
    with SimProcess(line, tmp_path / "sim") as sim:
        arguments = (
            "--line",
            sim.line_path,
            "--out",
            tmp_path / "runs",
            "--rate",
            "fit",
            "--duration",
            "5s",
            "--json",
        )
        said = jbclog("run", recipe, *arguments)
        assert [one.format for one in load_line(sim.line_path).stations] == formats
    assert said.returncode == 0, said.stderr
    manifest = json.loads((Path(json.loads(said.stdout)["folder"]) / "manifest.json").read_text())
    assert [one["baudrate"] for one in manifest["stations"]] == list(BAUDRATES)
    assert [one["format"] for one in manifest["stations"]] == formats
    assert {one["outcome"] for one in manifest["stations"]} == {"completed"}
    assert all(one["last_tick"] > one["first_tick"] for one in manifest["stations"])
