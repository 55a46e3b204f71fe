"""Groups the episodes of the three detectors into incidents, and finds where the detectors
disagree.

Episodes of one port and side belong to one incident if their widest intervals overlap: from the
last reading without the alarm to the first reading without it again. A disagreement is a finding: a
sentence with the possible causes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from jbclog.analysis.alarms.state_machine import Detector, Episode, Side


class Unknown(NamedTuple):
    """The answer to the alarm flags was lost at `time_us`; the previous reading was at
    `earliest_us`.
    """

    earliest_us: int
    time_us: int


@dataclass(slots=True)
class Incident:
    """One excursion of one port beyond one limit, as each detector saw it. `finding`: how the
    detectors disagree.
    """

    number: int
    station: str
    port: int
    side: Side
    episodes: list[Episode]
    finding: str | None = None
    by: dict[Detector, list[Episode]] = field(default_factory=dict)

    @property
    def main(self) -> Episode:
        """The episode that describes it: the first by our samples, else by the station's flags,
        else of the excursions.
        """
        ranks = (Detector.SAMPLES, Detector.STATION, Detector.AFTERWARDS)
        return min(self.episodes, key=lambda one: (ranks.index(one.detector), one.onset_us))

    @property
    def name(self) -> str:
        """Name of the main episode."""
        return self.main.id

    @property
    def is_alarm(self) -> bool:
        """Whether the station or our samples raised it; an excursion shorter than the delay is
        none.
        """
        return any(one.detector is not Detector.AFTERWARDS for one in self.episodes)

    @property
    def witnesses(self) -> str:
        """The detectors of its episodes, such as ``A, B ×2, C``."""
        counts = {each: len(self.by[each]) for each in Detector if self.by[each]}
        return ", ".join(
            f"{each} ×{count}" if count > 1 else str(each) for each, count in counts.items()
        )

    @property
    def begin_us(self) -> int:
        return min(one.onset_earliest_us for one in self.episodes)


def incidents(
    episodes: Iterable[Episode],
    unknown: Mapping[tuple[str, int], Sequence[Unknown]],
    with_flags: Iterable[str],
) -> list[Incident]:
    """Return all incidents with their findings, ordered by begin and numbered from 1.

    `unknown`: lost readings of the flags by station and port. `with_flags`: stations that report
    alarm flags.
    """
    reporting = frozenset(with_flags)
    found = [Incident(0, *place, group) for place, group in _groups(episodes)]
    found.sort(key=lambda one: (one.begin_us, one.station, one.port, one.side))
    for number, one in enumerate(found, 1):
        one.number = number
        one.by = {
            detector: [each for each in one.episodes if each.detector is detector]
            for detector in Detector
        }
        one.finding = _finding(
            one, unknown.get((one.station, one.port), ()), has_flags=one.station in reporting
        )
    return found


Place = tuple[str, int, Side]


def _groups(episodes: Iterable[Episode]) -> Iterable[tuple[Place, list[Episode]]]:
    """Yield groups of episodes of one port and side that overlap, directly or through others."""
    places: dict[Place, list[Episode]] = {}
    for episode in episodes:
        places.setdefault((episode.station, episode.port, episode.side), []).append(episode)
    for place, of_place in places.items():
        of_place.sort(key=lambda one: (one.onset_earliest_us, one.detector))
        group: list[Episode] = []
        until: float = 0
        for one in of_place:
            if group and one.onset_earliest_us > until:
                yield place, group
                group = []
            until = max(until, _until_us(one)) if group else _until_us(one)
            group.append(one)
        yield place, group


def _until_us(episode: Episode) -> float:
    return (
        float("inf") if episode.cleared_us is None or episode.end_us is None else episode.cleared_us
    )


def _finding(one: Incident, unknown: Sequence[Unknown], *, has_flags: bool) -> str | None:
    station, samples, excursions = (one.by[detector] for detector in Detector)
    if station and not samples:
        return _station_only(one, station, excursions)
    if samples and not station and has_flags:
        return _samples_only(one, samples, unknown)
    return None


def _station_only(one: Incident, station: list[Episode], excursions: list[Episode]) -> str:
    text = f"the station raised its {one.side}-temperature flag"
    if excursions:
        longest = max(
            (each.seconds for each in excursions if each.seconds is not None), default=None
        )
        lasted = "" if longest is None else f" (longest {longest:.1f} s)"
        return f"{text}; our samples exceeded the limit too, but not for the whole delay{lasted}"
    limit = "" if station[0].limit_c is None else f" beyond {station[0].limit_c:g} °C"
    return (
        f"{text}; no sample is{limit}: it was between two of our readings, or is left from before"
    )


def _samples_only(one: Incident, samples: list[Episode], unknown: Sequence[Unknown]) -> str:
    first, last = samples[0], samples[-1]
    delay = f" for longer than {first.on_delay_s:g} s" if first.on_delay_s else ""
    text = (
        f"our samples were beyond {first.limit_c:g} °C{delay}; the station's {one.side}-temperature"
        " flag was not read as set"
    )
    if any(
        lost.time_us >= first.onset_earliest_us and lost.earliest_us <= _until_us(last)
        for lost in unknown
    ):
        return f"{text}: an answer with the flags was lost meanwhile, which may have shown it"
    return f"{text}: its limit or delay differs from what was read back, or the flag was lost"
