"""Lines and runs of virtual stations made of few words: several DDEs with faults, one hot air
station, odd answers.
"""

from __future__ import annotations

from support.product import COLUMN, AirModel, AirStation, EventRow
from support.virtual.virtual_run import VirtualRun, line_text, prepare


def line(*sims: str) -> str:
    """A line of DDEs, each with its own sim table."""
    texts = [line_text(f"seed = {number}\n{sim}") for number, sim in enumerate(sims, 1)]
    stations = [
        text.replace("turnaround_ms = 1.0", "turnaround_ms = 0.9").split("[[station]]")[1]
        for text in texts
    ]
    named = [text.replace("dde-1", f"dde-{number}") for number, text in enumerate(stations, 1)]
    return line_text().split("[[station]]")[0] + "".join(f"[[station]]{text}\n" for text in named)


def fault(kind: str, **keys: object) -> str:
    return "\n[[station.sim.fault]]\n" + "".join(
        f"{key} = {value!r}\n" for key, value in {"kind": kind, **keys}.items()
    )


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
    assert isinstance(face, AirModel)
    return face.station


def one_port(sim: str = "", duration_s: float = 20, rate: float | None = None) -> VirtualRun:
    return prepare(
        line_text("joints_per_minute = 0\n" + sim, "ports = [1]"), duration_s=duration_s, rate=rate
    )


def say(run: VirtualRun, code: str, data: str, *moments: float, times: int = 1) -> None:
    """Let the station answer a question otherwise, so many times from each of these moments on."""
    ask, left = run.station.device.answer, dict.fromkeys(moments, times)

    def answer(header: str, text: str, now: float) -> tuple[str, str] | None:
        found = ask(header, text, now)
        due = next(
            (
                one
                for one in moments
                if header == "R" and text == code and now >= run.t0 + one and left[one]
            ),
            None,
        )
        if due is None:
            return found
        left[due] -= 1
        return "A", code + data

    run.station.device.answer = answer  # type: ignore[method-assign]


def marks(run: VirtualRun) -> list[EventRow]:
    return run.memory.of_kind("read.doubted")


def first_sample_s() -> float:
    """The second of the first tick of a run as `one_port` makes it: until then the tip is read for
    its turnaround.
    """
    tick = one_port(duration_s=3).go().memory.samples[0][COLUMN["tick"]]
    assert isinstance(tick, int)
    return tick / 10
