"""A run of one virtual hot air station."""

from __future__ import annotations

from virtual_run import VirtualRun, line_text, prepare

from jbclog.sim.hotair import AirFace, AirStation

AIR = """
[recipe]
name = "air"
revision = 1
families = ["jtse"]

[air]
temperature_c = 320
flow_permille = 600
external_set_c = 180
mode = "manual"

[run]
status = "on"
"""


def hot_air(sim: str = "", keys: str = "", recipe: str = AIR, **more: object) -> VirtualRun:
    """A run that is ready to go, as `prepare` makes it; the tool is a JT."""
    return prepare(line_text(f"tool = 1\n{sim}", keys).replace("dde", "jtse"), recipe, **more)  # type: ignore[arg-type]


def plant(run: VirtualRun) -> AirStation:
    """The physics behind the station."""
    face = run.station.device.face
    assert isinstance(face, AirFace)
    return face.station
