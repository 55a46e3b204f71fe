"""A recording with one wrong answer that passed its check byte, and that its session asked for
again, served again.

The replay gives the same result: the wrong answer never comes without the one that contradicts it,
and an extra question gets the confirmed value. This is tried for slow readings and for readings of
each tick, at 1, 3 and 10 times the speed, with late answers on the tape and a host that is
sometimes suspended.

The events are the same, as many of each kind. If the host is suspended, or at ten times the speed,
a slow reading may be skipped, and with it the mark `read.doubted` of its wrong answer: only that
event may be missing, and none may be new. At ten times the speed, where this full link leaves slow
readings hardly any time, it depends on the moment of the start when flags are read:

- The first reading may come after an alarm was raised. Then it was set before the run as far as the
  session knows: `alarm.before_run` counts as the event of its raise.
- Wrong flags may be read before they count, or after. So alarms are not compared where the flags
  are wrong, unless answers are 50 ms late.
- A host that is suspended as well may cost a tick: `station.slow`.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from support.virtual.captured_run import kept, recorded_again
from support.virtual.lines import say, turn_over
from support.virtual.virtual_run import RECIPE, Memory, VirtualRun, line_text

HOST_S = 0.0003
SPEEDS = (1, 3, 10)
SECONDS = 12.0
GOES_ON, STOPS = f'{RECIPE}on_difference = "continue"\n', f'{RECIPE}on_difference = "stop"\n'
WRONG = {  # the bit that is turned over in two places of the data
    "ST1": (1, (2, 3)),  # 350 °C: 240 °C
    "SER": (4, (1, 3)),
    "PE1": (4, (1, 3)),
    "HA1": (1, (2, 3)),  # 380 °C: 290 °C
    "TT1": (4, (2, 3)),
    "TA1": (1, (3, 4)),  # both flags, which are read once
}
TOOL = "CT1"  # two bits make no tool of another, so the station itself says a wrong one
CODES = (TOOL, *WRONG)
RAISED = ("alarm.before_run", "alarm.low.not_working")
HOT_S = 7.5  # flags count from then on
ANSWERS = {
    "in time": "",
    "50 ms late": '[[station.sim.fault]]\nkind = "late"\nby_s = 0.05\nat_s = 3\nevery = 29',
    "30 ms late": '[[station.sim.fault]]\nkind = "late"\nby_s = 0.03\nat_s = 3\nevery = 13',
}
STALLS = {"a host in time": (), "a host that stands still": (0.02, 0.05)}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("doubted")


@cache
def recording(
    place: Path, code: str, answers: str, recipe: str = GOES_ON, moment: float = 5.0
) -> tuple[Path, Memory]:
    """Return a run with one wrong answer."""

    def arrange(run: VirtualRun) -> None:
        if code == TOOL:
            say(run, code, "00003", moment)
        else:
            turn_over(run, code, *WRONG[code], moment)

    folder = place / f"{code} {answers} {moment} {'stop' if recipe == STOPS else ''}"
    line = line_text(f"noise_c = 0.5\n{ANSWERS[answers]}")
    return folder, kept(folder, line, duration_s=SECONDS, arrange=arrange, recipe=recipe)


def assert_same_events(
    place: Path, code: str, answers: str, host: str, speed: int, moment: float
) -> None:
    folder, first = recording(place, code, answers, moment=moment)
    told = Counter(first.kinds())
    if moment == 5.0:
        assert told["read.doubted"] == (code != "TA1")
    again, _ = recorded_again(folder, HOST_S * speed, STALLS[host])
    found = Counter(again.kinds())
    if (code, speed) == ("TA1", 10) and answers != "50 ms late":
        found, told = without_alarms(found), without_alarms(told)
    if speed == 10:
        found, told = with_raised(found), with_raised(told)
    if STALLS[host] and speed == 10:
        told["station.slow"] += found["station.slow"] - told["station.slow"] == 1
    if STALLS[host] or speed == 10:
        found["read.doubted"] += told["read.doubted"] - found["read.doubted"] == 1
    assert found == told


def without_alarms(kinds: Counter[str]) -> Counter[str]:
    return Counter({kind: count for kind, count in kinds.items() if not kind.startswith("alarm.")})


def with_raised(kinds: Counter[str]) -> Counter[str]:
    """The kinds; those that say that an alarm was raised count as one."""
    return Counter("raised" if kind in RAISED else kind for kind in kinds.elements())


@pytest.mark.parametrize(
    ("speed", "answers", "host"),
    [
        (1, "50 ms late", "a host in time"),
        (1, "50 ms late", "a host that stands still"),
        (3, "in time", "a host in time"),
        (10, "50 ms late", "a host in time"),
    ],
)
@pytest.mark.parametrize("code", CODES)
def test_nothing_is_told_that_was_not_and_nothing_is_lost(
    place: Path, code: str, speed: int, answers: str, host: str
) -> None:
    answers = "in time" if code == "HA1" else answers  # on a full wire it is not its turn again
    assert_same_events(place, code, answers, host, speed, HOT_S if code == "TA1" else 5.0)


@pytest.mark.campaign
@pytest.mark.parametrize("moment", [4.0, 5.5, 6.3, 7.1, 8.2])
@pytest.mark.parametrize("host", STALLS)
@pytest.mark.parametrize("answers", ANSWERS)
@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("code", CODES)
def test_wherever_it_falls(
    place: Path, code: str, speed: int, answers: str, host: str, moment: float
) -> None:
    assert_same_events(place, code, answers, host, speed, moment)


@pytest.mark.parametrize("code", ["ST1", "CT1"])
@pytest.mark.parametrize("answers", ["in time", "50 ms late"])
def test_a_recipe_that_stops_on_a_difference_does_not_stop(
    place: Path, code: str, answers: str
) -> None:
    folder, first = recording(place, code, answers, STOPS)
    again, _ = recorded_again(folder, HOST_S)
    assert again.stations["dde-1"].outcome == first.stations["dde-1"].outcome == "completed"
    assert len(again.samples) == len(first.samples)
