"""jbclog with a fault in it: ``python tests/support faults.broken_session STATION run ...``.

The session of STATION breaks while its tools are at work, as no session may, and as only a fault of
the program could make it. Nothing of this is in the product: what it calls is patched.
"""

from __future__ import annotations

import sys

from jbclog.app.run import recorder
from jbclog.cli import main
from jbclog.core.io_requests import Steps
from jbclog.core.rows import StationFacts
from jbclog.session.run.context import SessionContext
from jbclog.session.run.station_run import run_station

WISHES = 40  # of sampling, by when it breaks


def break_session_of(station: str) -> None:
    def breaking(context: SessionContext) -> Steps[StationFacts]:
        steps = run_station(context)
        request, left = next(steps), WISHES
        while left or context.name != station:
            heard = yield request
            request = steps.send(heard)
            left -= context.facts.first_tick is not None and left > 0
        raise RuntimeError("a fault of the program")

    recorder.run_station = breaking


if __name__ == "__main__":
    break_session_of(sys.argv.pop(1))
    main()
