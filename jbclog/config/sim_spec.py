"""The optional table `[station.sim]` of a line file: properties of the virtual station.

`run` and everything on its path ignore it; `jbclog sim` and the tests serve it. Times of faults
count from the first question that the virtual station hears, or from its first order to a tool
(`faults_from`), which is close to a run's first sample however long the start takes.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from jbclog.config.schema import FromList, Table

FaultKind = Literal[
    "silence",
    "noise",
    "flip",
    "late",
    "dropout",
    "nak",
    "restart",
    "stuck",
    "overheat",
    "tool",
    "solder_shortage",
    "clog",
    "not_ready",
    "out_of_range",
]

_SELECTORS: Final = frozenset({"command", "port", "only", "every"})  # which answers it affects
KEYS_OF_FAULT: Final[dict[str, frozenset[str]]] = {
    "silence": _SELECTORS,
    "noise": _SELECTORS | {"bytes_count"},
    "flip": _SELECTORS | {"bits"},
    "late": _SELECTORS | {"by_s"},
    "nak": _SELECTORS | {"code"},
    "dropout": frozenset(),
    "restart": frozenset(),
    "stuck": frozenset({"port"}),
    "overheat": frozenset({"port", "by_c"}),
    "tool": frozenset({"port", "code"}),
    "solder_shortage": frozenset(),
    "clog": frozenset(),
    "not_ready": frozenset(),
    "out_of_range": frozenset(),
}
"""Keys of a fault beside `kind`, `at_s` and `for_s`."""

NEEDS_END: Final = frozenset({"dropout", "restart"})

Port = Annotated[int, Field(ge=1, le=4)]
PortKey = Annotated[int, Field(ge=1, le=4, strict=False)]  # a key of a TOML table is text
Tool = Annotated[int, Field(ge=0, le=9)]


class FaultSpec(Table):
    """One fault, in force from `at_s` for `for_s` seconds, or to the end without `for_s`.

    ===============  =============================================================================
    silence          the station receives and acts, but does not answer
    noise            `bytes_count` random bytes precede the answer
    flip             `bits` bits of the answer are inverted
    late             the answer comes `by_s` seconds late
    nak              the request is refused with `code` (1 to 6, 99999) and not executed; omega
                     ignores it
    dropout          the cable is pulled: the port disappears and comes back after `for_s`
    restart          the station restarts: it loses volatile values and is silent for `for_s`
    stuck            the temperature reading does not change
    overheat         tip or air runs away to `by_c` above the upper alarm limit (above the setpoint
                     if no limit is set)
    tool             the tool is replaced by the one with number `code`; 0 removes it
    solder_shortage  omega: there is no solder left
    clog             omega: the nozzle is clogged
    not_ready        omega: the controller prepares, or has an error
    out_of_range     omega: the temperature is out of its alarm range
    ===============  =============================================================================

    `command` (a name of the family's table), `port` and `only` select the affected answers;
    `every` = n selects each nth of those.
    """

    kind: FaultKind
    at_s: float = Field(default=0.0, ge=0)
    for_s: float | None = Field(default=None, gt=0)
    command: str | None = None
    port: Port | None = None
    only: Literal["read", "write"] | None = None
    every: int = Field(default=1, ge=1)
    code: int = Field(default=4, ge=0, le=99999)
    bits: int = Field(default=1, ge=1, le=8)
    bytes_count: int = Field(default=8, ge=1, le=256)
    by_s: float = Field(default=0.5, gt=0)
    by_c: float = Field(default=20.0, gt=0, le=300)

    @model_validator(mode="after")
    def _only_its_own_keys(self) -> Self:
        foreign = self.model_fields_set - KEYS_OF_FAULT[self.kind] - {"kind", "at_s", "for_s"}
        if foreign:
            raise ValueError(f"a fault of kind {self.kind} takes no {', '.join(sorted(foreign))}")
        if self.kind in NEEDS_END and self.for_s is None:
            raise ValueError(f"a fault of kind {self.kind} needs for_s")
        if self.kind == "tool" and not 0 <= self.code <= 9:
            raise ValueError("code is the number of a tool, 0 to 9")
        return self


class SimSpec(Table):
    """The virtual station of one entry of a line file. Every key has a default.

    `tool` is plugged into every port, `tools` into single ones (0 = none). `family` is the real
    family if the line file names another. The station reports `model`, else the line file's, else
    the family's name. `settings` and `counters` are the initial values by command name, for all
    ports and tools; ``"off"`` is a value of delays. `quirks` select interpretations where the
    manuals contradict themselves. `seed`, by default the station's name, decides joints, noise and
    flipped bits. An omega answers after 0 to 250 ms unless `turnaround_ms` is given, and starts
    with the conditions in `settings`, such as ``condition_101 = "0065 0 023 ..."``.
    """

    turnaround_ms: float = Field(default=1.0, ge=0, le=10_000)
    wire: bool = True  # pace answers by the baud rate
    family: str | None = None
    model: str | None = Field(default=None, min_length=1, max_length=16)
    software: str = Field(default="1.00a", min_length=1, max_length=16)
    robot_mode: bool = True
    tool: Tool = 2
    tools: dict[PortKey, Tool] = Field(default_factory=dict)
    joints_per_minute: float = Field(default=12.0, ge=0, le=120)
    joint_seconds: float = Field(default=1.5, gt=0, le=60)
    feed_each_joint: bool = False  # ale: the robot's own switch starts one feed in each joint
    # standard deviation of the temperature reading
    noise_c: float = Field(default=0.0, ge=0, le=50)
    # reading minus the true tip temperature
    sensor_error_c: float = Field(default=0.0, ge=-100, le=100)
    ambient_c: float = Field(default=23.0, ge=-20, le=60)
    rated_power_w: float | None = Field(default=None, gt=0, le=2000)  # default 130, hot air 900
    thermocouple: bool = True  # jtse: an external thermocouple is plugged in
    suction_each_joint: bool = False  # jtse: a part is lifted off after each joint
    # refuses values (N 00003) beyond a limit that only another family's manual prints
    refuses_unprinted: bool = False
    extractor_cools: bool = True  # heater off in status 00010, which no manual says
    quirks: Annotated[tuple[str, ...], FromList] = ()  # names in `sim/quirks.py`
    settings: dict[str, int | float | str] = Field(default_factory=dict)
    counters: dict[str, float] = Field(default_factory=dict)
    seed: int | None = None
    faults_from: Literal["question", "order"] = "question"  # not omega, which has no such order
    fault: Annotated[tuple[FaultSpec, ...], FromList] = ()
