"""Other programs on the same virtual station, written as their manuals recommend.

PyMeasure: an instrument with four `measurement` properties, whose `write` and `read` add and remove
the protocol's frame, over a `SerialAdapter`; a procedure that reads them repeatedly; a worker that
runs it, and PyMeasure's own recorder thread, which writes each record to a CSV file.
"""

from __future__ import annotations

import logging
import time
import warnings
from functools import reduce
from operator import xor
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from bare import ANSWER_BYTES, FOUR, TIMEOUT_S, Measured
from common import LINE, cpu_s

if TYPE_CHECKING:
    from pymeasure.experiment import Procedure

WARM_UP_SCANS = 50


def pymeasure(url: str, seconds: float, csv: Path) -> Measured:
    """Make the four reads without pause, each scan a line of CSV."""
    from pymeasure.experiment import Results, Worker

    procedure = _procedure(url, seconds)
    worker = Worker(Results(procedure, str(csv)), log_level=logging.WARNING)
    worker.start()
    while worker.is_alive():
        time.sleep(0.1)
    lines = csv.read_text().splitlines()
    if procedure.measured is None or len(lines) < procedure.scans:
        raise RuntimeError(f"PyMeasure recorded {len(lines)} lines of {procedure.scans} scans")
    return procedure.measured


def _procedure(url: str, seconds: float) -> Procedure:
    """Return a PyMeasure procedure; `measured` is set when it has ended."""
    from pymeasure.adapters import SerialAdapter
    from pymeasure.experiment import Procedure
    from pymeasure.instruments import Instrument

    class Dde(Instrument):
        """A JBC station with one tool."""

        tip_temperature = Instrument.measurement("RTT1", "Get the tip temperature in °C.", cast=int)
        power = Instrument.measurement("RPP1", "Get the power in per mille.", cast=int)
        status = Instrument.measurement("RPS1", "Get the digits of the tool's status.", cast=str)
        alarm_flags = Instrument.measurement(
            "RTA1", "Get the temperature alarms, and clear them.", cast=str
        )

        def __init__(self, adapter: SerialAdapter) -> None:
            super().__init__(adapter, "DDE", includeSCPI=False)

        def write(self, command: str) -> None:
            covered = b"\x020001" + command.encode() + b"\x03"
            self.write_bytes(covered + bytes([reduce(xor, covered)]))

        def read(self) -> str:
            answer = self.read_bytes(ANSWER_BYTES)
            if (
                len(answer) != ANSWER_BYTES
                or answer[5:6] != b"A"
                or reduce(xor, answer[:-1]) != answer[-1]
            ):
                raise ValueError(f"{answer!r} is no answer")
            return answer[9:14].decode()

    class Reading(Procedure):
        DATA_COLUMNS: ClassVar[list[str]] = ["time", *FOUR]
        measured: Measured | None = None
        scans = 0

        def execute(self) -> None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                station = Dde(SerialAdapter(url, baudrate=LINE.baudrate, timeout=TIMEOUT_S))
            for _ in range(WARM_UP_SCANS):
                self._scan(station)
            began, before, first = time.monotonic(), cpu_s(), self.scans
            while time.monotonic() - began < seconds:
                self._scan(station)
            exchanges = (self.scans - first) * len(FOUR)
            took, cpu = time.monotonic() - began, cpu_s() - before
            self.measured = Measured(
                began, took, exchanges, cpu / exchanges * 1e6, took / exchanges, (0.0, 0.0, 0.0)
            )
            station.adapter.close()

        def _scan(self, station: Dde) -> None:
            self.emit(
                "results", {"time": time.time(), **{name: getattr(station, name) for name in FOUR}}
            )
            self.scans += 1

    return Reading()
