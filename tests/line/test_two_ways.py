"""A sample is read by `request` and `value`, and by `ask` where the answer is not as expected: both
give the same record.
"""

from __future__ import annotations

import pytest

from jbclog.protocol.client.robot import Station
from support.virtual.lines import fault, hot_air
from support.virtual.virtual_run import VirtualRun, line_text, prepare

BEGUN_S = 3.0  # the start is over
LINKS = {
    "good": "",
    "lost": fault("silence", at_s=BEGUN_S, every=23),
    "late": fault("late", at_s=BEGUN_S, by_s=0.4, every=31),
    "flipped": fault("flip", at_s=BEGUN_S, every=17),
    "noisy": fault("noise", at_s=BEGUN_S, every=13),
    "refusing": (
        fault("nak", at_s=BEGUN_S, code=4, command="power", every=7)
        + fault("nak", at_s=BEGUN_S, code=2, every=29)
    ),
    "unplugged": fault("dropout", at_s=4.0, for_s=3.0),
    "of all kinds": (
        "".join(
            fault(kind, at_s=BEGUN_S, every=every, **more)
            for kind, every, more in (
                ("silence", 41, {}),
                ("late", 37, {"by_s": 0.3}),
                ("flip", 31, {"bits": 2}),
                ("noise", 29, {}),
                ("nak", 43, {"code": 1}),
            )
        )
        + fault("restart", at_s=9.0, for_s=1.0)
    ),
}


def recorded(run: VirtualRun) -> list[object]:
    """All that the run recorded, and all that its station was asked."""
    memory = run.go().memory
    return [
        memory.samples,
        memory.events,
        memory.settings,
        memory.counters,
        memory.stations,
        run.heard,
    ]


def made(family: str, sim: str) -> VirtualRun:
    if family == "jtse":
        return hot_air(f"seed = 3\n{sim}", duration_s=12.0)
    return prepare(line_text(f"seed = 3\n{sim}").replace('"dde"', f'"{family}"'), duration_s=12.0)


@pytest.mark.parametrize("family", ["dde", "ale", "jtse"])
@pytest.mark.parametrize("link", LINKS)
def test_both_ways_record_the_same(family: str, link: str, monkeypatch: pytest.MonkeyPatch) -> None:
    short = recorded(made(family, LINKS[link]))
    requests: list[object] = []
    monkeypatch.setattr(Station, "request", lambda station, question: requests.append(question))
    assert recorded(made(family, LINKS[link])) == short
    assert len(requests) > 100  # else the second run did not go the other way
    assert short[0]
