"""The commands of the solder feeder of ALE, and the dispensing counters (manual 002). No manual
prints their ranges.
"""

from __future__ import annotations

from enum import StrEnum

from jbclog.core.quantities import Choice, HexLength, Quantity, Scaled
from jbclog.protocol.commands.command import Command, Effect, Limits, Scope
from jbclog.protocol.commands.robot import COUNT, UNPRINTED, order, per_port


class FeederState(StrEnum):
    STOPPED = "stopped"
    RUNNING = "running"


MODES = Choice(("continuous", "discontinuous", "program", "reload"))
SWITCH = Choice(("off", "on"))


def _feeder(
    name: str, letters: str, quantity: Quantity, manual: str, access: str = "rw", note: str = ""
) -> Command:
    limits = Limits() if isinstance(quantity, Choice) else UNPRINTED  # choices are printed
    return Command(name, letters, Scope.STATION, quantity, access, manual, limits, note=note)


FEEDER = (
    _feeder("feeder_mode", "MOD", MODES, "002 R-MOD, W-MOD"),
    _feeder(
        "feeder_length",
        "LEN",
        Scaled("mm", 10),
        "002 R-LEN, W-LEN",
        note="B-38; the wire carries dmm",
    ),
    _feeder(
        "feeder_speed",
        "SPD",
        Scaled("mm/s", 10),
        "002 R-SPD, W-SPD",
        note="B-38; the wire carries dmm/s",
    ),
    _feeder(
        "feeder_diameter", "DIA", Scaled("mm", 100), "002 R-DIA, W-DIA", note="the wire carries cmm"
    ),
    _feeder(
        "feeder_backward", "BCK", Scaled("mm", 10), "002 R-BCK, W-BCK", note="the wire carries dmm"
    ),
    _feeder(
        "clog_detection",
        "WCD",
        SWITCH,
        "002 R-WCD, W-WCD",
        note="whether detection is on, not a clog",
    ),
    _feeder(
        "feeding", "FEE", Choice(tuple(state.value for state in FeederState)), "002 R-FEE", "r"
    ),
    order("start_feeding", "STR", "002 W-STR", "B-37: data 00000", Effect.MOVES),
    order("stop_feeding", "STP", "002 W-STP", "B-37: data 00000", Effect.STOPS),
)

DISPENSED = (
    per_port(
        "dispensed_cycles",
        "DC",
        COUNT,
        "002 R-DCx",
        note="B-36: the printed text is a copy of R-CDx",
    ),
    per_port(
        "dispensed_length",
        "DL",
        HexLength(),
        "002 R-DLx",
        answer_digits=None,
        note="B-35: hexadecimal, any width",
    ),
)
