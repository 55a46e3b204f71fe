"""The joints of a port whose record grows, by models identified in its first rows.

Identifying the models and measuring the doubt about the number take most of the time. Here both are
known (`sweeps.Identified`), and only draws are found: each row is read once, those of the last
window again at each count. The result does not depend on how often it was counted before.
"""

from __future__ import annotations

from copy import copy
from typing import Final

from jbclog.analysis.joints.doubt import why_not_known
from jbclog.analysis.joints.draws import Draw
from jbclog.analysis.joints.joints import sort_draws
from jbclog.analysis.joints.levels import Levels
from jbclog.analysis.joints.packed import Packed
from jbclog.analysis.joints.parameters import JointOptions, settings_for
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.sweeps import Identified, KnownStretch, PortSweeps
from jbclog.analysis.joints.windows import Windows

NEW_TOOL: Final = "The tool was exchanged, and its heat balance is not known yet."


class GrowingPort(PortSweeps):
    """A port of which `identified` is known. `take` needs all rows from the first on, in order."""

    def __init__(self, options: JointOptions, identified: Identified) -> None:
        super().__init__(options)
        self._identified = identified
        self.rows, self.last_s = 0, 0.0
        self._has_new_tool = False
        self._stretch_windows = Windows(self._look_at_stretches)
        self._draw_windows = Windows(self._find_draws)

    def take(self, piece: Series) -> None:
        """Add the next rows."""
        if not len(piece.seconds):
            return
        if not self.rows:
            self._settings = settings_for(self._options, piece.period_s, False)
        self.rows, self.last_s = self.rows + len(piece.seconds), float(piece.seconds[-1])
        self._stretch_windows.take(piece)  # first: the draws need the model of each stretch
        self._draw_windows.take(piece)

    def so_far(self) -> tuple[list[Draw], str | None, tuple[float, int]]:
        """Return the joints, why their number is not known, and the result of `series.unseen`."""
        ended = self._ended()
        joints, _ = sort_draws(ended._draws, self._settings) if self.rows else ([], None)
        known, why = self._identified, None
        if known.doubt is not None:
            why = why_not_known(known.doubt, len(joints), self._period_s)
        why = known.why or (NEW_TOOL if ended._has_new_tool else why)
        return joints, why, ended._unseen.total()

    def _ended(self) -> GrowingPort:
        """Return a copy of this port whose record ends here; this one can take more rows."""
        one = copy(self)
        one._stretches = [copy(known) for known in self._stretches]
        one._draws = Packed(Draw, self._draws)
        one._unseen, one._levels = copy(self._unseen), Levels()
        self._stretch_windows.copied(one._look_at_stretches).end()
        self._draw_windows.copied(one._find_draws).end()
        return one

    def _begin(self, known: KnownStretch, series: Series, row: int, absent: int) -> None:
        self._last_tool = self._tool_at(series, row, absent)
        like = self._identified.stretch_like(known.start_s, self._last_tool)
        if like is None:
            self._has_new_tool = True
        else:
            known.model = self._identified.models[like]
        self._stretches.append(known)
