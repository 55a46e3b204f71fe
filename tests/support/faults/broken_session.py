"""jbclog with a fault in it: ``python tests/support faults.broken_session STATION run ...``.

The session of STATION breaks while its tools are at work, as no session may, and as only a fault of
the program could make it. Nothing of this is in the product: what it calls is patched.
"""

from __future__ import annotations

import sys

from support.product import SessionContext, StationFacts, command_main, do, put, run_station

WISHES = 40  # of sampling, by when it breaks


def break_session_of(station: str) -> None:
    async def breaking(context: SessionContext) -> StationFacts:
        steps = run_station(context)
        request, left = steps.send(None), WISHES
        while left or context.name != station:
            heard = await do(request)
            request = steps.send(heard)
            left -= context.state.facts.first_tick is not None and left > 0
        raise RuntimeError("a fault of the program")

    put("recorder.run_station", breaking)


if __name__ == "__main__":
    break_session_of(sys.argv.pop(1))
    command_main()
