"""After an order to restart: a station that goes down only a moment later, and one that does not
come back.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from support.clients.talk import Talk
from support.product import (
    BACK_S,
    FAMILIES,
    NOT_ACKNOWLEDGED,
    Refusal,
    Station,
    StationSilent,
    Steps,
    restart,
)

ORDER = FAMILIES["dde"].commands["restart"]
ANSWERS = {"RSMN": "ASMN  DDE", "RSER": "ASER00000", "RMAT": "AMAT00500"}


def restarted(station: Station) -> Steps[float]:
    return restart(station, ORDER)


def talk_with(
    is_up: Callable[[int], bool], acknowledged: str = "ARST"
) -> tuple[Talk, Counter[str]]:
    """One that answers the n-th read (from 1) where `is_up` says so."""
    heard: Counter[str] = Counter()

    def replies(text: str) -> list[str]:
        heard[text[0]] += 1
        if text == "WRST00000":
            return [acknowledged] if acknowledged else []
        return [ANSWERS[text]] if is_up(heard["R"]) else []

    return Talk(replies=replies), heard


@pytest.mark.parametrize("before", range(4))
def test_what_answers_for_a_moment_before_it_goes_down_is_not_back(before: int) -> None:
    down = range(before + 1, before + 10)
    talk, heard = talk_with(lambda number: number not in down)
    assert talk.do(restarted) < BACK_S
    assert heard["R"] >= down[-1] + 4  # in a row
    assert heard["W"] == 1


def test_without_an_acknowledgement_it_is_waited_for_all_the_same() -> None:
    talk, heard = talk_with(lambda number: number > 3, "")
    talk.do(restarted)
    assert talk.station.anomalies.counts[NOT_ACKNOWLEDGED] == 1
    assert heard["W"] == 1


def test_what_is_refused_is_not_waited_for() -> None:
    talk, heard = talk_with(lambda number: True, "NRST00005")
    with pytest.raises(Refusal):
        talk.do(restarted)
    assert heard == {"W": 1}


def test_what_does_not_come_back_is_told() -> None:
    talk, _ = talk_with(lambda number: False)
    with pytest.raises(StationSilent, match=f"within {BACK_S:g} s"):
        talk.do(restarted)
