"""What a station without a temperature tells: states, as lanes on the time axis and as figures of how long each held."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from jbclog.report.facts import StatesFacts
from jbclog.report.spans import Floats, Span, runs

COLUMNS = ("solder_shortage", "clogged", "preparing", "in_range")
SOLDER, CONTROL, TEMPERATURE = "solder", "control", "temperature"
SHORTAGE, CLOGGED, BOTH = "shortage", "clogged", "both"
OK, PREPARING, READY, IN_RANGE, OUT_OF_RANGE = "ok", "preparing", "ready", "in range", "out of range"


def is_any_told(samples: pd.DataFrame) -> list[bool]:
    """For each row, whether any state was read."""
    return [bool(there) for there in samples[list(COLUMNS)].notna().any(axis=1)]


def state_lanes(samples: pd.DataFrame, seconds: Floats, period_s: float) -> dict[str, list[Span]]:
    """The lanes by name, each with a word for what held; nothing where it was not read."""
    short, clogged = (_flags(samples, name) for name in ("solder_shortage", "clogged"))
    solder = [_solder(one, other) for one, other in zip(short, clogged, strict=True)]
    control = [_word(one, PREPARING, READY) for one in _flags(samples, "preparing")]
    warm = [_word(one, IN_RANGE, OUT_OF_RANGE) for one in _flags(samples, "in_range")]
    words = {SOLDER: solder, CONTROL: control, TEMPERATURE: warm}
    return {name: runs(seconds, these, period_s) for name, these in words.items()}


def states_facts(lanes: Mapping[str, list[Span]]) -> StatesFacts:
    """How long each state held that is not as it should be, in seconds; None where it was never read."""
    return StatesFacts(
        shortage_s=_seconds(lanes[SOLDER], SHORTAGE, BOTH),
        clogged_s=_seconds(lanes[SOLDER], CLOGGED, BOTH),
        preparing_s=_seconds(lanes[CONTROL], PREPARING),
        out_of_range_s=_seconds(lanes[TEMPERATURE], OUT_OF_RANGE),
    )


def _seconds(spans: list[Span], *words: str) -> float | None:
    return float(np.sum([span.seconds for span in spans if span.word in words])) if spans else None


def _flags(samples: pd.DataFrame, name: str) -> list[bool | None]:
    return [None if pd.isna(flag) else bool(flag) for flag in samples[name].astype(object)]


def _word(flag: bool | None, yes: str, no: str) -> str | None:
    return None if flag is None else yes if flag else no


def _solder(short: bool | None, clogged: bool | None) -> str | None:
    if short is None or clogged is None:
        return None
    return {(False, False): OK, (True, False): SHORTAGE, (False, True): CLOGGED, (True, True): BOTH}[short, clogged]
