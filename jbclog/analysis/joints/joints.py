"""Find the joints of a port, without labels, from the heat that leaves the tip.

A *joint* is a heat draw of at least `least_dwell_s`: from the moment the tip touches something that
takes heat until it leaves it (`contacts`, `draws`). Contacts less than `merge_gap_s` apart are one
draw, and so is a continuous drag. Power and temperature do not show whether there was solder: a
wipe over a sponge, or a touch without solder, of the same length is a draw too. A draw shorter than
`SURE_DWELL_S`, of less than `SURE_HEAT` ‰·s, or that never reaches `SURE_PEAK` ‰ counts as a joint
of unknown kind. A joint found says nothing about its quality.

A feeder is independent evidence (`feeding`). Joints are not known if the tip's thermal model is not
(`identify`); the result then has the reason and is never "no joints". If the joints found depend on
the assumptions, their number is not known (`doubt`) and the joints are provisional. See
docs/explanation/joints.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from jbclog.analysis.joints.contacts import Flow, flow_into_work
from jbclog.analysis.joints.doubt import Doubt, doubt_of, why_not_known
from jbclog.analysis.joints.draws import Draw, find_draws, is_joint
from jbclog.analysis.joints.feeding import FeederEvidence, feeder_evidence
from jbclog.analysis.joints.heat_up_end import ready_stretches
from jbclog.analysis.joints.identify import NEVER_READ, identify_each
from jbclog.analysis.joints.levels import resting_levels
from jbclog.analysis.joints.packed import column_of
from jbclog.analysis.joints.parameters import (
    JointOptions,
    JointSettings,
    regular_every_s,
    settings_for,
)
from jbclog.analysis.joints.recovery import Joint, joints_of
from jbclog.analysis.joints.series import Series, stretches, unseen
from jbclog.analysis.joints.thermal import ThermalModel
from jbclog.analysis.joints.tools import Tool, by_tool


@dataclass(frozen=True, slots=True)
class FoundJoints:
    """The joints of a port, and why some of them are not known.

    - `others`: draws that are not joints: too short, or without a feed where the feeder decides
    - `models`: one for each tool
    - `levels`: setpoint -> temperature at which the tip rests, both in °C
    - `settings`: those used
    - `why`: why joints, or some of them, are not known
    - `heat_why`: the same for the heat balance alone; may be set while `why` is None, if the feeder
      decides
    - `by_heat`: draws that are joints without the feeder's help
    - `number_why`: why their number is not known; `doubt`: how much it depends on the assumptions
    - `unseen_s`: how long the tool may have worked while nothing could be analysed, in `unseen`
      pieces; joints in these are not known
    """

    joints: Sequence[Joint]
    others: Sequence[Draw]
    models: list[ThermalModel]
    levels: dict[float, float]
    settings: JointSettings
    feeder: FeederEvidence | None = None
    why: str | None = None
    unseen_s: float = 0.0
    unseen: int = 0
    heat_why: str | None = None
    by_heat: Sequence[Draw] = ()
    number_why: str | None = None
    doubt: Doubt | None = None

    @property
    def model(self) -> ThermalModel | None:
        """The tip's model, if there was exactly one tool."""
        return self.models[0] if len(self.models) == 1 else None


def find_joints(series: Series, options: JointOptions | None = None) -> FoundJoints:
    """Return the joints of a port in order of time, each with its effect on the tip.

    `options` are those of the recipe; the run itself gives the rest.
    """
    options = options or JointOptions()
    settings = settings_for(options, series.period_s, False)
    found = stretches(series)
    parts, unseen_time = ready_stretches(found), unseen(series, found)
    by_exchange = by_tool(series, parts)
    each, why = identify_each(by_exchange) if parts else ([], NEVER_READ)
    tools = [
        Tool(pieces, model)
        for pieces, model in zip(by_exchange, each, strict=True)
        if model is not None
    ]
    flows, models = _flows_by_time(tools)
    every = [
        draw
        for flow, model in zip(flows, models, strict=True)
        for draw in find_draws([flow], model, settings)
    ]
    noise = max((model.noise.flow for model in models), default=0.0)
    feeder = feeder_evidence(series, every, flows, options.wire_decides, noise)
    settings = settings_for(options, series.period_s, feeder is not None and feeder.decides)
    draws, others = sort_draws(every if feeder is None else feeder.draws, settings)
    others = sorted(
        [*others, *(() if feeder is None else feeder.others)], key=lambda draw: draw.start_s
    )
    levels = resting_levels(flows, every)
    joints = joints_of(series, draws, [*draws, *others], levels, settings.recovered_within_c)
    by_heat, _ = sort_draws(every, settings)
    doubt = doubt_of(tools, settings) if tools else None
    heat = ByHeat(list(dict.fromkeys(models)), why, by_heat, doubt)
    return concluded(joints, others, levels, settings, heat, unseen_time, series.period_s, feeder)


@dataclass(frozen=True, slots=True)
class ByHeat:
    """Results of the heat balance alone: the models of the tools or why there is none, the joints,
    and their doubt.
    """

    models: list[ThermalModel]
    why: str | None
    draws: Sequence[Draw]
    doubt: Doubt | None


def concluded(
    joints: Sequence[Joint],
    others: Sequence[Draw],
    levels: dict[float, float],
    settings: JointSettings,
    heat: ByHeat,
    unseen_time: tuple[float, int],
    period_s: float,
    feeder: FeederEvidence | None = None,
) -> FoundJoints:
    """Return the joints of a port with what is not known of them.

    `unseen_time` is the result of `series.unseen`, and `period_s` the sampling period.
    """
    number_why = (
        None if heat.doubt is None else why_not_known(heat.doubt, len(heat.draws), period_s)
    )
    return FoundJoints(
        joints,
        others,
        heat.models,
        levels,
        replace(settings, every_s=regular_every_s(column_of(joints, "start_s"))),
        feeder,
        None if settings.wire_decides else heat.why or number_why,
        *unseen_time,
        heat.why,
        heat.draws,
        number_why,
        heat.doubt,
    )


def _flows_by_time(tools: Sequence[Tool]) -> tuple[list[Flow], list[ThermalModel]]:
    """Return the flow of each stretch whose tool has a model, in order of time, and these
    models.
    """
    flows = [
        flow_into_work(part.stretch, tool.model, part.ready)
        for tool in tools
        for part in tool.parts
    ]
    models = [tool.model for tool in tools for _ in tool.parts]
    order = sorted(range(len(flows)), key=lambda number: float(flows[number].stretch.seconds[0]))
    return [flows[number] for number in order], [models[number] for number in order]


def sort_draws(draws: Sequence[Draw], settings: JointSettings) -> tuple[list[Draw], list[Draw]]:
    """Return the draws that are joints, and the others."""
    joints: list[Draw] = []
    others: list[Draw] = []
    for draw in draws:
        (joints if is_joint(draw, settings) else others).append(draw)
    return joints, others
