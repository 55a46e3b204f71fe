"""The content of a report as plain data: `report.json` is this, and page and paper are made from
nothing else.

Times are ISO 8601 in UTC, None is "not known", names end with their unit.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from jbclog.analysis.verdict import Bound
from jbclog.report.alarms import AlarmFacts

SCHEMA = 2  # 0.1.0 wrote 1


@dataclass(slots=True)
class Reason:
    """A sentence under the verdict, and the result of its rules."""

    result: str
    text: str


@dataclass(slots=True)
class VerdictFacts:
    """`decided`: ``"with the run"`` (it is in the manifest), ``"by recovery"`` (the run was cut
    off) or ``"by this report"``.

    `reasons`: why it is not ACCEPT. `version`: the number of its rules. `by_rules`: the sentence
    that this version does not have them; None if it does.
    """

    word: str
    decided: str
    reasons: list[Reason]
    rules: list[dict[str, object]]
    summary: list[dict[str, object]]  # empty if the rules are few
    version: int
    by_rules: str | None = None


@dataclass(slots=True)
class FigureFacts:
    """A figure: its file and texts; not in the JSON: two sizes as SVG, and the data of the
    interactive view.
    """

    file: str
    caption: str
    alt: str
    wide: str = field(repr=False)
    narrow: str = field(repr=False)
    zoom: str | None = field(repr=False, default=None)


@dataclass(slots=True)
class RecordedFacts:
    """How much of a port's temperature was recorded, as `analysis/verdict/samples.py` defines
    it.
    """

    rows: int
    due: int
    readings: int
    coverage_percent: float | None
    longest_gap_s: float | None
    late_p99_ms: float | None
    gaps: list[dict[str, object]]  # the longest, as in the table of gaps


@dataclass(slots=True)
class TipFacts:
    """The tip in °C. `analysis/verdict/idle.py` defines the idle figures."""

    setpoint_c: float | None
    alarm_high_c: float | None
    alarm_low_c: float | None
    least_c: float | None
    greatest_c: float | None
    idle_error_c: float | None
    idle_sd_c: float | None
    idle_error_bound: Bound | None  # 95 %, defined in `analysis/verdict/bounds.py`
    idle_sd_bound: Bound | None


@dataclass(slots=True)
class PowerFacts:
    """The highest power, and its integral: the metrics of that name (`analysis/metrics/energy.py`),
    or `why` there is none.

    Joules and Wh only if the line file states the rated power; beside a gap the recorded energy is
    a lower bound.
    """

    greatest_permille: float | None
    energy_permille_s: float | None
    energy_recorded_permille_s: float | None
    energy_j: float | None
    energy_wh: float | None
    energy_why: str | None


@dataclass(slots=True)
class StatesFacts:
    """Seconds in each unwanted state of a station without a temperature; None: never read."""

    shortage_s: float | None
    clogged_s: float | None
    preparing_s: float | None
    out_of_range_s: float | None


@dataclass(slots=True)
class AirFacts:
    """Hot air: the last flow as a share of the maximum, and the external thermocouple. None: never
    read.
    """

    flow_permille: float | None
    external_least_c: float | None
    external_greatest_c: float | None
    suctions: int


@dataclass(slots=True)
class JointFacts:
    """The joints of a port.

    - `figures`: metrics with n, coverage, resolution, and `why` there is no value
    - `taken`: the criteria, from the recipe's `[joints]` and from the run
    - `never_back`: a sentence if the tip seldom recovers
    - `signals`: number of points of the chart with a signal; None without limits, for the reason in
      `refused` (a word in `refused_kind`)
    """

    figures: dict[str, dict[str, object]]
    found: int
    taken: dict[str, object]
    never_back: str | None
    signals: int | None
    refused: str | None
    refused_kind: str | None
    chart: FigureFacts | None


@dataclass(slots=True)
class PortFacts:
    """One port: its tool, its figures, the state in which the run left it (`safety.py`)."""

    port: int
    tool_name: str | None
    recorded: RecordedFacts
    tip: TipFacts
    power: PowerFacts
    states: StatesFacts | None  # only for a station without a temperature
    air: AirFacts | None  # only for hot air, whose temperatures are in `tip` like those of any tool
    alarms: int
    doubtful_alarms: int
    touched: bool
    safe_state: str | None
    last_temperature_c: float | None
    last_status: str | None
    left: str
    left_means: str
    left_warns: bool
    figures: list[FigureFacts]
    joints: JointFacts | None = None  # None for tools that make no joints
    # the tip verification that was valid when the run began
    verification: dict[str, object] | None = None


@dataclass(slots=True)
class StationReport:
    """One station: identity, end of its run, ports."""

    name: str
    family: str
    model: str | None
    model_accepted: bool
    software: str | None
    url: str
    address: int | None
    wire: str
    turnaround_ms: float | None
    period_s: float | None
    recipe: str | None
    rated_power_w: float | None
    not_supported: list[str]
    outcome: str
    reason: str
    outages: int
    skipped_ticks: int
    garbage_bytes: int
    ports: list[PortFacts]


@dataclass(slots=True)
class Omitted:
    """Rows that a table of the report leaves out, and why."""

    rows: int
    text: str


@dataclass(slots=True)
class Facts:
    """One run."""

    schema: int
    rules: int  # number of the rules and methods of this report
    run: str
    manifest_sha256: str
    head: str
    previous: str
    jbclog: str
    verdict: VerdictFacts
    state: str
    exit_status: str | None
    exit_code: int | None
    lost: str | None
    start: str | None
    stop: str | None
    duration_s: float | None
    clock_wrong: str | None
    rate: str
    guard: str
    line: dict[str, object]
    recipes: list[dict[str, object]]
    metadata: dict[str, object]
    host: dict[str, object]
    overview: FigureFacts | None  # if there are several ports
    stations: list[StationReport]
    alarms: AlarmFacts
    units: list[dict[str, object]]  # joints and recovery of each; empty without units
    metrics: list[dict[str, object]]
    events: list[dict[str, object]]
    events_left: Omitted | None
    settings: list[dict[str, object]]
    settings_left: Omitted | None
    counters: list[dict[str, object]]
    ledger: list[dict[str, object]]
    ledger_reasons: list[str]
    files: list[dict[str, object]]
    data_sha256: str  # hash of the lines "SHA-256  path" of these files, as `sha256sum` prints them
    annotations: list[dict[str, object]]  # added after the run was sealed
    annotations_head: str
    annotations_wrong: list[str]  # a sentence for each damaged or changed part of that file
    not_claimed: list[str]
    not_claimed_short: list[str]
    to_sign: list[dict[str, str]]

    @property
    def is_crowd(self) -> bool:
        return sum(len(station.ports) for station in self.stations) > CROWD


# with more ports than this, each has one figure, and a closer one only if something happened
CROWD = 12

NOT_CLAIMED = (
    (
        "That a solder joint is good: joints are found in temperatures and powers, which do not"
        " show the solder."
    ),
    (
        "The temperature of the tip's surface, or of the air at the work: values are those of the"
        " station's own sensor in the tool. A calibrated thermometer confirms them only where a tip"
        " verification is cited, for the time of that verification."
    ),
    (
        "Energy at the tip or in the air: power is in per mille of the station's nominal maximum; "
        "watts appear only where the line file states a rated power."
    ),
    (
        "What happened between two readings: an excursion shorter than the period is seen only if"
        " it raised the station's own alarm."
    ),
    (
        "That every byte was right: the stations' check byte misses some double errors. Failed"
        " checks are in the accounting."
    ),
    (
        "That the host's clock was right: times are UTC of the host; durations are from a monotonic"
        " clock."
    ),
)

NOT_CLAIMED_SHORT = (
    "that any solder joint is good",
    "the true temperature of tip or air: values are those of the station's own sensor",
    "what happened between two readings",
    "that limits kept here hold at any other time",
)

TO_SIGN = (
    {"role": "Reviewed", "meaning": "Meaning: review of this record and its deviations."},
    {"role": "Approved", "meaning": "Meaning: approval or refusal, based on this record."},
)
