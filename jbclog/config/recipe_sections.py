"""The tables of a recipe file: a class for each table, a field for each key. None means that the
file does not set the key.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from jbclog.config.schema import (
    FIVE_DIGITS,
    METADATA,
    NAME_ALLOWED,
    RATES,
    TENTHS,
    Condition,
    Confidence,
    Families,
    LimitC,
    Minutes,
    Name,
    Rate,
    Required,
    Seconds,
    Switch,
    Table,
    Tenths,
)
from jbclog.protocol.commands.family import FAMILIES
from jbclog.protocol.commands.omega import CONDITIONS


class RecipeTable(Table):
    name: Name = Field(description=NAME_ALLOWED)
    revision: int = Field(ge=0, le=999_999, description="a whole number from 0 on")
    families: Families = Field(min_length=1, description=f"a list of some of {', '.join(FAMILIES)}")


class Temperature(Table):
    select_c: int | None = Field(None, description="whole °C")
    adjust_c: int | None = Field(None, description="whole °C")


class Sleep(Table):
    temperature_c: int | None = Field(None, description="whole °C")
    delay_min: Minutes | None = None


class Hibernation(Table):
    delay_min: Minutes | None = None


class Alarm(Table):
    limit_c: LimitC | None = None
    delay_s: Seconds | None = None


class Alarms(Table):
    high: Alarm = Alarm.model_construct()
    low: Alarm = Alarm.model_construct()


class PortSettings(Table):
    """Settings for every port of a station, or below `[port.N]` for one."""

    temperature: Temperature = Temperature.model_construct()
    sleep: Sleep = Sleep.model_construct()
    hibernation: Hibernation = Hibernation.model_construct()
    alarm: Alarms = Alarms.model_construct()


class Feeder(Table):
    mode: Literal["continuous", "discontinuous", "program", "reload"] | None = Field(
        None, description="one of continuous, discontinuous, program, reload"
    )
    length_mm: float | None = Field(
        None, ge=0, le=9999.9, description=f"mm in steps of 0.1, {FIVE_DIGITS}"
    )
    speed_mm_s: float | None = Field(
        None, gt=0, le=9999.9, description=f"mm/s in steps of 0.1, {FIVE_DIGITS}"
    )
    diameter_mm: float | None = Field(
        None, gt=0, le=999.99, description=f"mm in steps of 0.01, {FIVE_DIGITS}"
    )
    backward_mm: float | None = Field(
        None, ge=0, le=9999.9, description=f"mm in steps of 0.1, {FIVE_DIGITS}"
    )
    clog_detection: Switch | None = None


class Air(Table):
    """Hot air (jtse). No manual prints ranges; the session checks the station's own limits."""

    temperature_c: int | None = Field(None, description="whole °C")
    flow_permille: int | None = Field(
        None, ge=0, le=1000, description="0 to 1000, the share of the station's greatest flow"
    )
    external_set_c: int | None = Field(None, description="whole °C")
    mode: Literal["manual", "profile"] | None = Field(None, description="manual or profile")
    # None: keep
    suction: Literal["keep", "on", "off"] | None = Field(None, description="keep, on or off")


class Omega(Table):
    """One solder condition (omega): the whole record of fifteen fields."""

    condition: Condition = Field(description=CONDITIONS)
    mode: int = Field(
        ge=0,
        le=4,
        description="0 to 4: special point, special slide, the same without iron up, pre-solder",
    )
    rise_s: Tenths = Field(description=TENTHS)
    feed1_mm: Tenths = Field(description=TENTHS)
    feed1_mm_s: Tenths = Field(description=TENTHS)
    reverse1_mm: Tenths = Field(description=TENTHS)
    reverse1_mm_s: Tenths = Field(description=TENTHS)
    preheat_s: Tenths = Field(description=TENTHS)
    feed2_mm: Tenths = Field(description=TENTHS)
    feed2_mm_s: Tenths = Field(description=TENTHS)
    reverse2_mm: Tenths = Field(description=TENTHS)
    reverse2_mm_s: Tenths = Field(description=TENTHS)
    heating_s: Tenths = Field(description=TENTHS)
    feed3_mm: Tenths = Field(description=TENTHS)
    feed3_mm_s: Tenths = Field(description=TENTHS)
    reverse3_mm: Tenths = Field(description=TENTHS)
    reverse3_mm_s: Tenths = Field(description=TENTHS)


class Sampling(Table):
    """Rate of the fast signals in Hz (None: the family's; use `Recipe.asked_rate`), and the longest
    periods of the slow ones in seconds.
    """

    rate_hz: Rate | None = Field(None, description=RATES)
    alarms_every_s: float = Field(2.0, ge=0.1, le=3600, description="seconds, from 0.1 to 3600")
    counters_every_s: float = Field(60.0, ge=1, le=86400, description="seconds, from 1 to 86400")


class Run(Table):
    """How the run treats the tools. `status` None: unchanged at the start. Use `Recipe.safe_state`
    for the family's default.
    """

    status: Literal["working", "stand", "extractor", "on", "off"] | None = Field(
        None, description="working, stand or extractor (jtse: on, off)"
    )
    safe_state: Literal["stand", "extractor", "cooling", "off"] = Field(
        "stand", description="stand or extractor (jtse: cooling, off)"
    )
    # jtse: at the end
    safe_suction: Literal["keep", "off"] = Field("keep", description="keep or off")
    require_tool: bool = Field(True, description="true or false")
    on_difference: Literal["stop", "continue"] = Field("stop", description="stop or continue")
    on_missing: Literal["stop", "continue"] = Field("stop", description="stop or continue")
    allow_no_cooldown: bool = Field(False, description="true or false")


class Episodes(Table):
    """Additions to a station's alarm limits and delays when samples are evaluated. `off_delay_s`
    None: the same as the alarm's delay.
    """

    dead_band_c: float = Field(2.0, ge=0, le=100, description="°C from 0 to 100")
    off_delay_s: float | None = Field(None, ge=0, le=3600, description="seconds from 0 to 3600")
    stale_s: float = Field(60.0, gt=0, le=86400, description="seconds, more than 0 and up to 86400")

    def rules(self) -> dict[str, float]:
        """Return the given rules by name."""
        return {name: float(value) for name, value in self if value is not None}


class Units(Table):
    """Serials read during the run. `repeat`: what to do with a serial read before."""

    repeat: Literal["continue", "refuse"] = Field("continue", description="continue or refuse")


class Metadata(Table):
    required: Required = Field((), description=f"a list of some of {', '.join(METADATA)}, tag.NAME")


class Acceptance(Table):
    """Limits of the verdict; None disables a rule."""

    coverage_percent: float | None = Field(None, ge=0, le=100, description="0 to 100")
    longest_gap_s: float | None = Field(None, ge=0, description="seconds from 0 on")
    idle_error_c: float | None = Field(None, ge=0, description="°C from 0 on")
    idle_sd_c: float | None = Field(None, ge=0, description="°C from 0 on")
    alarms_max: int | None = Field(None, ge=0, description="a whole number from 0 on")
    verification_days: float | None = Field(None, ge=0, description="days from 0 on")
    recovery_p95_s: float | None = Field(
        None, gt=0, le=10, description="seconds, more than 0 and up to 10"
    )
    recovered_before_next_percent: float | None = Field(None, ge=0, le=100, description="0 to 100")
    joints_against_counter_percent: float | None = Field(None, ge=0, le=100, description="0 to 100")
    reached_within_c: float | None = Field(
        None, gt=0, le=100, description="°C, more than 0 and up to 100"
    )
    at_work_percent: float | None = Field(None, ge=0, le=100, description="0 to 100")
    confidence: Confidence = Field(0.95, description='0.95 or "none"')


class Joints(Table):
    """What counts as a joint. None: derived from the run, and shown in the report."""

    least_dwell_s: float | None = Field(None, ge=0.1, le=60, description="seconds from 0.1 to 60")
    merge_gap_s: float | None = Field(None, ge=0, le=10, description="seconds from 0 to 10")
    expected_every_s: float | None = Field(
        None, ge=0.5, le=3600, description="seconds from 0.5 to 3600"
    )
    recovered_within_c: float = Field(3.0, ge=1, le=50, description="°C from 1 to 50")
    wire_decides: bool | None = Field(None, description="true or false")


PortName = Literal["1", "2", "3", "4"]


class RecipeTables(PortSettings):
    """The whole file."""

    recipe: RecipeTable = Field(description="a table [recipe] with name, revision and families")
    port: Mapping[PortName, PortSettings] = Field(
        default_factory=dict, description="a port is 1, 2, 3 or 4"
    )
    feeder: Feeder = Feeder.model_construct()
    air: Air = Air.model_construct()
    omega: Omega | None = None
    sampling: Sampling = Sampling.model_construct()
    run: Run = Run.model_construct()
    episodes: Episodes = Episodes.model_construct()
    metadata: Metadata = Metadata.model_construct()
    units: Units = Units.model_construct()
    joints: Joints = Joints.model_construct()
    acceptance: Acceptance | None = None
