"""Joints of a port, found without labels from the heat that leaves the tip.

Definition. *A joint* is a draw of heat of at least `least_dwell_s`: from the moment the tip touches something that takes heat
until it leaves it (`draws`); contacts less than `merge_gap_s` apart are one, a continuous drag is one. Whether there was
solder cannot be known from power and temperature: a wipe over a sponge or a touch without solder that lasts as long is a
draw, too. A draw shorter than `SURE_DWELL_S`, or that takes less than `SURE_HEAT` ‰·s or never `SURE_PEAK` ‰, is counted with
its kind not known. Nothing here says that a joint is good.

A feeder is a second witness (`feeding`). Joints are not known where the tip's thermal model is not (`identify`); then the
reason is said, and no joints found is never told as none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from jbclog.features.asked import Asked, Taken, regular_every_s, taken
from jbclog.features.drawn import Draw, draws_of
from jbclog.features.draws import Flow, flows
from jbclog.features.feeding import Witnessed, witnessed
from jbclog.features.identify import identify
from jbclog.features.levels import resting_levels
from jbclog.features.ready import Readied, readied
from jbclog.features.recovery import Joint, joints_of
from jbclog.features.series import Series, stretches, unseen
from jbclog.features.thermal import ThermalModel
from jbclog.features.tools import by_tool

NEVER_READ = "Temperature and power of a working tool were never read together."


@dataclass(frozen=True, slots=True)
class Found:
    """What came of looking for joints in a port.

    `others` are draws that are none: too short, or without a feed where wire decides. `why`: joints are not known, or only some.
    `heat_why`: the same of heat as a witness; where wire decides, the feeder alone tells of those joints, and `why` is None.
    `by_heat` are the draws that are joints without the feeder's help.
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
    looked, models, why = _looked(series, parts, settings) if parts else ([], [], NEVER_READ)
    every = [draw for flow, model in zip(looked, models, strict=True) for draw in draws_of(flow, model, settings)]
    seen = witnessed(series, every, looked, asked.wire_decides)
    settings = taken(asked, series.period_s, seen is not None and seen.decides)
    draws, others = sort_draws(every if seen is None else seen.draws, settings)
    others = sorted([*others, *(() if seen is None else seen.others)], key=lambda draw: draw.start_s)
    levels = resting_levels(looked, every)
    joints = joints_of(series, draws, [*draws, *others], levels, settings.recovered_within_c)
    settings = replace(settings, every_s=regular_every_s([joint.start_s for joint in joints]))
    unknown = None if settings.wire_decides else why
    by_heat, _ = sort_draws(every, settings)
    return Found(joints, others, list(dict.fromkeys(models)), levels, settings, seen, unknown, *lost, why, by_heat)


def _looked(series: Series, parts: Sequence[Readied], settings: Taken) -> tuple[list[Flow], list[ThermalModel], str | None]:
    """The flow of each stretch whose tool is known, with its model; and why there is a tool that is not."""
    looked: list[Flow] = []
    models: list[ThermalModel] = []
    why: str | None = None
    for tool in by_tool(series, parts):
        found = identify(tool)
        if found.model is None or found.why is not None:
            why = why or found.why
            continue
        looked += [flows(part.stretch, found.model, part.ready) for part in tool]
        models += [found.model] * len(tool)
    order = sorted(range(len(looked)), key=lambda number: float(looked[number].stretch.seconds[0]))
    return [looked[number] for number in order], [models[number] for number in order], why


def sort_draws(draws: Sequence[Draw], settings: Taken) -> tuple[list[Draw], list[Draw]]:
    """The draws that are joints, and the others."""
    joints: list[Draw] = []
    others: list[Draw] = []
    for draw in draws:
        long = draw.dwell_s >= settings.least_dwell_s or draw.cut is not None or bool(draw.fed)
        (joints if long else others).append(draw)
    return joints, others
