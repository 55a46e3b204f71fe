"""`jbclog run` on virtual stations: in place of real ports, a guard and time, a driver that waits
for nothing.
"""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from jbclog.app.run.plan import Plan
from jbclog.app.run.run_record import Observer, Result, RunRecord
from jbclog.core.clock import VirtualClock
from jbclog.core.outcome import CUT_SHORT
from jbclog.transport.virtual import VirtualDriver
from support.virtual.recorded_run import RecordedRun


class VirtualConduct:
    """Stands in for `jbclog.app.run.runner.conduct`. `held` has the reasons why stations cannot be
    used, `interrupted` the signal that comes and its second.
    """

    def __init__(self) -> None:
        self.held: dict[str, str] = {}
        self.interrupted: tuple[signal.Signals, float] | None = None
        self.run: RecordedRun | None = None

    def __call__(self, plan: Plan, out: Path, observer: Observer, **_: Any) -> Result:
        if self.held:
            return RunRecord(plan, out, observer, VirtualClock()).refuse(self.held)
        cut_short = None
        if self.interrupted is not None and plan.wanted.states_an_end:
            cut_short = CUT_SHORT[self.interrupted[0]]
        self.run = RecordedRun(
            plan, out, meanwhile=self._interrupt, observer=observer, cut_short=cut_short
        )
        return self.run.result

    def _interrupt(self, _: RunRecord, driver: VirtualDriver) -> None:
        if self.interrupted is not None:
            number, second = self.interrupted
            driver.at(
                driver.clock.monotonic() + second, lambda: driver.end(f"ended by {number.name}")
            )

    def sent(self) -> list[str]:
        """What the stations of the last run accepted: ``dde-1: selected_temperature 350``."""
        run, self.run = self.run, None
        if run is None:
            return []
        return [
            " ".join(
                [
                    f"{name}: {write.name}",
                    *([f"port {write.port}"] if write.port else []),
                    *([f"tool {write.tool}"] if write.tool else []),
                    str(write.value),
                ]
            )
            for name, station in run.stations.items()
            for write in getattr(getattr(station, "device", None), "writes", ())
        ]
