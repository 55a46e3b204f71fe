"""Joints of a port, found without labels from the heat that leaves the tip.

Definition. *A joint* is a draw of heat of at least `least_dwell_s`: from the moment the tip touches something that takes heat
until it leaves it (`draws`); contacts less than `merge_gap_s` apart are one, a continuous drag is one. Whether there was
solder cannot be known from power and temperature: a wipe over a sponge or a touch without solder that lasts as long is a
draw, too. A draw shorter than `SURE_DWELL_S`, or that takes less than `SURE_HEAT` ‰·s or never `SURE_PEAK` ‰, is counted with
its kind not known. Nothing here says that a joint is good.

A feeder is a second witness (`feeding`). Where the joints found hang on the assumptions, their number is not known (`doubt`), and
the joints are provisional. Joints are not known where the tip's thermal model is not (`identify`); then the
reason is said, and no joints found is never told as none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from jbclog.analysis.joints.contacts import Flow, flows
from jbclog.analysis.joints.doubt import Doubt, doubt_of, why_not_known
from jbclog.analysis.joints.draws import Draw, draws_of, is_joint
from jbclog.analysis.joints.feeding import Witnessed, witnessed
from jbclog.analysis.joints.heat_up_end import readied
from jbclog.analysis.joints.identify import identify_each
from jbclog.analysis.joints.levels import resting_levels
from jbclog.analysis.joints.parameters import Asked, Taken, regular_every_s, taken
from jbclog.analysis.joints.recovery import Joint, joints_of
from jbclog.analysis.joints.series import Series, stretches, unseen
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.joints.tools import Tool, by_tool

NEVER_READ = "Temperature and power of a working tool were never read together."


@dataclass(frozen=True, slots=True)
class Found:
    """What came of looking for joints in a port.

    `others` are draws that are none: too short, or without a feed where wire decides. `why`: joints are not known, or only some.
    `heat_why`: the same of heat as a witness; where wire decides, the feeder alone tells of those joints, and `why` is None.
    `by_heat` are the draws that are joints without the feeder's help; `number_why` says why their number is not known, and `doubt`
    how far it hangs on the assumptions.
    `levels` are the temperatures in °C at which the tip rests, by setpoint. `models` has one for each tool. `unseen_s`: for how
    long the tool may have worked and nothing could be looked at, in `unseen` pieces; joints in these are not known.
    """

    joints: list[Joint]
    others: list[Draw]
    models: list[ThermalModel]
    levels: dict[float, float]
    asked: Taken
    witnessed: Witnessed | None = None
    why: str | None = None
    unseen_s: float = 0.0
    unseen: int = 0
    heat_why: str | None = None
    by_heat: list[Draw] = field(default_factory=list)
    number_why: str | None = None
    doubt: Doubt | None = None

    @property
    def model(self) -> ThermalModel | None:
        """The tip's model, where there was one tool."""
        return self.models[0] if len(self.models) == 1 else None

    @property
    def by_wire(self) -> bool:
        return self.asked.wire_decides


def find_joints(series: Series, asked: Asked | None = None) -> Found:
    """The joints of a port, in order, with what each did to the tip."""
    asked = asked or Asked()
    settings = taken(asked, series.period_s, False)
    found = stretches(series)
    parts, lost = readied(found), unseen(series, found)
    by_exchange = by_tool(series, parts)
    each, why = identify_each(by_exchange) if parts else ([], NEVER_READ)
    tools = [Tool(pieces, model) for pieces, model in zip(by_exchange, each, strict=True) if model is not None]
    looked, models = _looked(tools)
    every = [draw for flow, model in zip(looked, models, strict=True) for draw in draws_of(flow, model, settings)]
    seen = witnessed(series, every, looked, asked.wire_decides)
    settings = taken(asked, series.period_s, seen is not None and seen.decides)
    draws, others = sort_draws(every if seen is None else seen.draws, settings)
    others = sorted([*others, *(() if seen is None else seen.others)], key=lambda draw: draw.start_s)
    levels = resting_levels(looked, every)
    joints = joints_of(series, draws, [*draws, *others], levels, settings.recovered_within_c)
    by_heat, _ = sort_draws(every, settings)
    doubt = doubt_of(tools, settings) if tools else None
    heat = ByHeat(list(dict.fromkeys(models)), why, by_heat, doubt)
    return concluded(joints, others, levels, settings, heat, lost, series.period_s, seen)


@dataclass(frozen=True, slots=True)
class ByHeat:
    """What the heat balance shows by itself: the models of the tools, or why there is none; its joints; and their doubt."""

    models: list[ThermalModel]
    why: str | None
    draws: list[Draw]
    doubt: Doubt | None


def concluded(
    joints: list[Joint],
    others: list[Draw],
    levels: dict[float, float],
    settings: Taken,
    heat: ByHeat,
    lost: tuple[float, int],
    period_s: float,
    seen: Witnessed | None = None,
) -> Found:
    """Return the joints of a port with what is not known of them; `lost` is what `series.unseen` returns."""
    number_why = None if heat.doubt is None else why_not_known(heat.doubt, len(heat.draws), period_s)
    return Found(
        joints,
        others,
        heat.models,
        levels,
        replace(settings, every_s=regular_every_s([joint.start_s for joint in joints])),
        seen,
        None if settings.wire_decides else heat.why or number_why,
        *lost,
        heat.why,
        heat.draws,
        number_why,
        heat.doubt,
    )


def _looked(tools: Sequence[Tool]) -> tuple[list[Flow], list[ThermalModel]]:
    """The flow of each stretch whose tool is known, with its model."""
    looked = [flows(part.stretch, tool.model, part.ready) for tool in tools for part in tool.parts]
    models = [tool.model for tool in tools for _ in tool.parts]
    order = sorted(range(len(looked)), key=lambda number: float(looked[number].stretch.seconds[0]))
    return [looked[number] for number in order], [models[number] for number in order]


def sort_draws(draws: Sequence[Draw], settings: Taken) -> tuple[list[Draw], list[Draw]]:
    """The draws that are joints, and the others."""
    joints: list[Draw] = []
    others: list[Draw] = []
    for draw in draws:
        (joints if is_joint(draw, settings) else others).append(draw)
    return joints, others
