"""Lines of several virtual DDEs, and faults in words of Python."""

from __future__ import annotations

from virtual_run import line_text


def line(*sims: str) -> str:
    """A line of DDEs, each with its own sim table."""
    texts = [line_text(f"seed = {number}\n{sim}") for number, sim in enumerate(sims, 1)]
    stations = [text.replace("turnaround_ms = 1.0", "turnaround_ms = 0.9").split("[[station]]")[1] for text in texts]
    named = [text.replace("dde-1", f"dde-{number}") for number, text in enumerate(stations, 1)]
    return line_text().split("[[station]]")[0] + "".join(f"[[station]]{text}\n" for text in named)


def fault(kind: str, **keys: object) -> str:
    return "\n[[station.sim.fault]]\n" + "".join(f"{key} = {value!r}\n" for key, value in {"kind": kind, **keys}.items())
