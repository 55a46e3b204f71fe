"""What hot air tells beside its temperature: the thermocouple on the work, the flow, cooling and suction."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from jbclog.core.rows import StationFacts
from jbclog.report.facts import AirFacts
from jbclog.report.spans import Floats, Span, merged, runs, within

SIGNAL = "external_c"
COLUMNS = ("cooling", "desoldering", SIGNAL, "set_flow_permille")
FLOW, SUCTION, COOLING, OFF = "flow", "suction", "cooling", "off"
AWAY = ("disconnected", "robot_off")
FLOW_JOINED_S = 15.0  # it is due each 5 s; two losses are bridged in the drawing, and only there


def tells_air(facts: StationFacts) -> bool:
    """Whether it is a hot air station, by the signals that it has."""
    return SIGNAL in facts.signals


@dataclass(frozen=True, slots=True)
class Air:
    """On the rows and the time axis of a trace: °C on the work (NaN where nothing was read), and the lanes by name."""

    external: Floats
    lanes: dict[str, list[Span]]

    def between(self, rows: np.ndarray[tuple[int], np.dtype[np.bool_]], start: float, end: float) -> Air:
        """The part of these `rows`, from `start` to `end`."""
        lanes = {name: within(spans, start, end) for name, spans in self.lanes.items()}
        return Air(self.external[rows], {name: spans for name, spans in lanes.items() if spans})


def air_of(samples: pd.DataFrame, seconds: Floats, period_s: float) -> Air:
    """What the rows of one port tell of its air."""
    sucking = [SUCTION if flag is True else None for flag in _flags(samples, "desoldering")]
    lanes = {FLOW: _flow(samples, seconds, period_s), SUCTION: runs(seconds, sucking, period_s)}
    return Air(_floats(samples[SIGNAL]), {name: spans for name, spans in lanes.items() if spans})


def status_words(samples: pd.DataFrame) -> list[str | None]:
    """The status as read, and cooling where that is what an off tool does."""
    words = samples["status"].astype(object)
    return [_word(word, cools) for word, cools in zip(words, _flags(samples, "cooling"), strict=True)]


def air_facts(air: Air) -> AirFacts:
    """The figures of one port's air."""
    known, flow = air.external[~np.isnan(air.external)], air.lanes.get(FLOW, [])
    return AirFacts(
        flow_permille=float(flow[-1].word.removesuffix(" ‰")) if flow else None,
        external_least_c=float(known.min()) if len(known) else None,
        external_greatest_c=float(known.max()) if len(known) else None,
        suctions=len(air.lanes.get(SUCTION, [])),
    )


def _word(word: object, cools: bool | None) -> str | None:
    if pd.isna(word):  # type: ignore[call-overload]  # one cell
        return None
    return COOLING if word == OFF and cools else str(word)


def _flow(samples: pd.DataFrame, seconds: Floats, period_s: float) -> list[Span]:
    """Where the flow was read, joined between two equal readings that are near enough; not across an outage."""
    flow = _floats(samples["set_flow_permille"])
    read = ~np.isnan(flow)
    outages = np.cumsum(samples["quality"].astype(object).isin(AWAY).to_numpy(dtype=bool))[read]
    told = zip(seconds[read], flow[read], strict=True)
    spans = [Span(float(at), float(at) + period_s, f"{value:.0f} ‰") for at, value in told]
    edges = [0, *(np.flatnonzero(np.diff(outages)) + 1), len(spans)]
    return [span for a, b in pairwise(edges) for span in merged(spans[a:b], FLOW_JOINED_S)]


def _flags(samples: pd.DataFrame, name: str) -> list[bool | None]:
    return [None if pd.isna(flag) else bool(flag) for flag in samples[name].astype(object)]


def _floats(column: pd.Series[int]) -> Floats:
    return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)
