"""Alarm episodes of a tool, by three detectors: the station's flags, our samples with delays, every
sampled excursion.

Start with `state_machine.py`, then `port_watch.py`; `live.py` feeds it while a run is recorded,
`from_record.py` from its record. Terms and states are those of ISA-18.2 / IEC 62682 as in OPC UA
Part 9 (OPC 10000-9): on-delay, off-delay, deadband, acknowledgement independent of the state.
"""

from jbclog.analysis.alarms.from_record import FlagRead, Rows, SampledEpisodes, flag_episodes
from jbclog.analysis.alarms.kpi import Figures, figures
from jbclog.analysis.alarms.live import KIND, LiveAlarms, change_of, rules_of
from jbclog.analysis.alarms.match import Incident, Unknown, incidents
from jbclog.analysis.alarms.port_watch import BEFORE_ALL, Change
from jbclog.analysis.alarms.state_machine import WATCHED, Detector, Episode, Rules, Side, State

__all__ = [
    "BEFORE_ALL",
    "KIND",
    "WATCHED",
    "Change",
    "Detector",
    "Episode",
    "Figures",
    "FlagRead",
    "Incident",
    "LiveAlarms",
    "Rows",
    "Rules",
    "SampledEpisodes",
    "Side",
    "State",
    "Unknown",
    "change_of",
    "figures",
    "flag_episodes",
    "incidents",
    "rules_of",
]
