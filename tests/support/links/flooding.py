"""What a link may be flooded with, at any speed: here on the virtual driver, on real terminals and
sockets in `flooders.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle
from random import Random

from support.clients.talk import framed
from support.virtual.virtual_run import VirtualRun

FALSE_C = 77  # a temperature that no tool of these tests has
COPIES = framed(f"ATT1{FALSE_C:05d}")
SHAPES: dict[str, list[bytes]] = {
    "copies of an answer": [COPIES],
    "copies of the safe state": [framed("APS100001")],
    "another model's answers": [framed("ASMNNAE")],
    "refusals of Robot mode off": [framed("NTT100005"), framed("NSMN00005")],
    "all answers in turn": [
        framed(text)
        for text in (
            "ASMNDDE",
            f"ATT1{FALSE_C:05d}",
            "APS100001",
            "APS200001",
            f"ATT2{FALSE_C:05d}",
        )
    ],
    "STX alone": [b"\x02" * 64],
    "noise": [Random(number).randbytes(61) for number in range(7)],
}


def pieces(shape: str, size: int) -> Iterator[bytes]:
    """The endless stream of that shape, `size` bytes at a time."""
    frames = cycle(SHAPES[shape])
    held = b""
    while True:
        while len(held) < size:
            held += next(frames)
        yield held[:size]
        held = held[size:]


def flood(
    run: VirtualRun,
    name: str,
    shape: str,
    bytes_per_s: float,
    begin_s: float,
    end_s: float,
    *,
    every_s: float = 0.01,
) -> None:
    """Have a station's link flooded between these seconds of the run."""
    size = max(1, round(bytes_per_s * every_s))
    stream = pieces(shape, size)
    for number in range(round((end_s - begin_s) / every_s)):
        run.at(begin_s + number * every_s, lambda: run.driver.say(name, next(stream)))
