"""ALARMS AS EPISODES. When a tool was beyond its alarm limits, told three ways: by the station, while it happens, and afterwards.

Owns: what an alarm on our samples is (limit, delays, dead band), the state machine, the three detectors, what they disagree
on, and the figures of floods, chatter and stale alarms.
Never: does I/O, keeps rows, decides a verdict, imports pandas or numpy: the recorder feeds it row by row.
May use: `rows` and `errors`.
Start reading: `definition.py`, what counts as beyond; `machine.py`, the transitions; `port.py`, one port row by row; then
`live.py` (the recorder) and `after.py` (a record), which use the same code.

Source: ISA-18.2 / IEC 62682 as OPC UA Part 9 has it (on and off delay, dead band, acknowledging beside the state).
"""

from jbclog.episodes.after import FlagRead, Rows, SampledEpisodes, flag_episodes
from jbclog.episodes.definition import WATCHED, Rules, Side
from jbclog.episodes.episode import Detector, Episode, State
from jbclog.episodes.kpi import Figures, figures
from jbclog.episodes.live import KIND, LiveAlarms, change_of, rules_of
from jbclog.episodes.match import Incident, Unknown, incidents
from jbclog.episodes.port import BEFORE_ALL, Change

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
