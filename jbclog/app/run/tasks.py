"""The tasks of a plan's sessions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from jbclog.app.run.plan import Plan
from jbclog.protocol.commands.family import FAMILIES
from jbclog.session.run.task import StationTask
from jbclog.transport.system_ports import sharers_text


def station_tasks(plan: Plan, t0: float) -> Iterator[StationTask]:
    """Yield each session's task; `t0` is the run's zero, monotonic seconds."""
    for station in plan.stations:
        spec = station.spec
        yield StationTask(
            name=spec.name,
            url=spec.url,
            family=station.family,
            line=spec.line_format,
            address=spec.address,
            ports=spec.ports,
            recipe=station.recipe,
            recipe_file=station.recipe_file,
            families=FAMILIES,
            t0=t0,
            duration_s=plan.wanted.duration_s,
            rate=station.rate,
            rated_power_w=spec.rated_power_w,
            allow_omega_write=plan.wanted.allow_omega_write,
            model=spec.model,
            may_be_missing=plan.starts_without_missing,
            sharers=partial(sharers_text, spec.url),
        )
