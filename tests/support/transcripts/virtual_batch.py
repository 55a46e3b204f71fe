"""The processes of `jbclog batch` without processes: each job is a run on virtual stations, over
when it is started.
"""

from __future__ import annotations

from typing import Any, Final

from jbclog.app.batch.processes import AttemptResult, SystemProcesses
from jbclog.app.batch.state import State
from jbclog.core.outcome import Exit
from support.virtual.recorded_run import RecordedRun

STATES: Final = {Exit.FINE: State.DONE, Exit.NOT_FINE: State.NOT_FINE}


class VirtualProcesses(SystemProcesses):
    """Stands in for `SystemProcesses`."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._ended: dict[tuple[str, int], AttemptResult] = {}

    def start(self, name: str, attempt: int) -> None:
        job = self._specs[name].job
        result = RecordedRun(job.plan(), job.out).result
        self._ended[name, attempt] = AttemptResult(
            STATES.get(result.exit_code, State.FAILED),
            result.exit_code.value,
            "; ".join(finding.text for finding in result.findings),
            result.folder,
            result.manifest.verdict,
        )

    def runs(self, name: str, attempt: int) -> bool:
        return False

    def run(self, name: str, attempt: int) -> str | None:
        ended = self.result(name, attempt)
        return None if ended is None or ended.run is None else ended.run.name

    def result(self, name: str, attempt: int) -> AttemptResult | None:
        return self._ended.get((name, attempt))
