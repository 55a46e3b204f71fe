"""Runs of jbclog on the stations of `outside_bench`, on a virtual clock, and what of the record was
not so at the stations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from support.oracles import outside_bench as bench
from support.oracles.outside_bench import Cable
from support.product import (
    COLUMN,
    SampleRow,
    Session,
    SettingRow,
    VirtualClock,
    VirtualDriver,
    parse_line,
    parse_recipe,
)
from support.virtual.virtual_run import Memory, order_for

TIP = """
[recipe]
name = "outside-tip"
revision = 1
families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]
[temperature]
select_c = 360
adjust_c = 3
[sleep]
temperature_c = 160
delay_min = 4
[hibernation]
delay_min = 20
[alarm.high]
limit_c = 400
delay_s = 1.5
[alarm.low]
limit_c = 100
delay_s = "off"
[feeder]
length_mm = 5.0
speed_mm_s = 9.0
[sampling]
rate_hz = "auto"
[run]
status = "working"
"""
AIR = """
[recipe]
name = "outside-air"
revision = 1
families = ["jtse"]
[air]
temperature_c = 300
flow_permille = 500
external_set_c = 200
mode = "manual"
[sampling]
rate_hz = "auto"
[run]
status = "on"
"""


@dataclass
class Outcome:
    memory: Memory
    cables: dict[str, Cable]
    contexts: dict[str, Session]
    driver: VirtualDriver

    @property
    def not_started(self) -> dict[str, str]:
        """The stations that did not come to sample, with the reason."""
        return {
            name: context.facts.reason
            for name, context in self.contexts.items()
            if context.facts.first_tick is None
        }

    def asked(self, name: str) -> list[str]:
        """What the station took in, in order: letter, code, data."""
        one = self.cables[name]
        start = 5 if one.station.habits.address is not None else 1
        return [row.data[start:-2].decode("latin-1") for row in one.rows if row.what == "heard"]


def virtual(
    cables: dict[str, Cable],
    *,
    duration_s: float = 2.0,
    recipe: str = TIP,
    air: str = AIR,
    allow_missing: bool = False,
    keys: str = "",
) -> Outcome:
    """One run on `cables`; hot air gets `air`."""
    clock = VirtualClock()
    memory, driver = Memory(), VirtualDriver(clock, allow_missing=allow_missing)
    recipes = {False: parse_recipe(recipe), True: parse_recipe(air)}
    families = {name: one.station.family for name, one in cables.items()}
    text = bench.line_file(
        {name: name for name in cables}, families, more=dict.fromkeys(cables, keys)
    )
    contexts = {}
    for spec in parse_line(text, Path("line.toml")).stations:
        order = order_for(spec, recipes[spec.family == "jtse"], clock, duration_s, None)
        contexts[spec.name] = Session(replace(order, may_be_missing=allow_missing), memory, clock)
        driver.add(contexts[spec.name].steps(), cables[spec.name], spec.name)
    driver.run()
    return Outcome(memory, cables, contexts, driver)


# -- is the record true? ---------------------------------------------------------------------------

SETTING_CODES = {
    "selected_temperature": "ST{port}",
    "sleep_temperature": "S{port}{tool}",
    "sleep_delay": "D{port}{tool}",
    "hibernation_delay": "H{port}{tool}",
    "adjust": "A{port}{tool}",
    "alarm_high_limit": "HA{port}",
    "alarm_low_limit": "LA{port}",
    "alarm_high_delay": "HD{port}",
    "alarm_low_delay": "LD{port}",
    "maximum_temperature": "MAT",
    "minimum_temperature": "MIT",
    "feeder_mode": "MOD",
    "feeder_length": "LEN",
    "feeder_speed": "SPD",
    "feeder_diameter": "DIA",
    "feeder_backward": "BCK",
    "clog_detection": "WCD",
    "selected_air_temperature": "ST1",
    "selected_air_flow": "SF1",
    "selected_external_temperature": "SE1",
    "work_mode": "WM1",
    "maximum_air_temperature": "MAT",
    "minimum_air_temperature": "MIT",
    "maximum_air_flow": "MAF",
    "minimum_air_flow": "MIF",
    "maximum_external_temperature": "MAE",
    "minimum_external_temperature": "MIE",
    "status": "PS{port}",
}
SCALES = {"feeder_length": 10, "feeder_speed": 10, "feeder_backward": 10, "feeder_diameter": 100}
WORDS = {
    "feeder_mode": ["continuous", "discontinuous", "program", "reload"],
    "clog_detection": ["off", "on"],
}
WORDS["work_mode"] = ["manual", "profile"]


def as_recorded(setting: str, raw: str) -> str:
    """The text of `settings` for what a station holds; the alarm's codes for "not set" are `off`,
    as is 99999.
    """
    if raw == bench.OFF or (setting.endswith("_limit") and raw == "00000"):
        return "off"
    if setting in WORDS:
        return WORDS[setting][int(raw)]
    if setting in SCALES:
        return f"{int(raw) / SCALES[setting]:.2f}"
    if setting.startswith("alarm_") and setting.endswith("_delay"):
        return f"{float(raw):.2f}"
    return raw if setting == "status" else str(int(raw))


SIGNAL_CODES = {
    "temperature_c": "TT{port}",
    "power_permille": "PP{port}",
    "setpoint_c": "ST{port}",
    "tool": "CT{port}",
    "port_error": "PE{port}",
    "station_error": "SER",
    "transformer_c": "TT",
    "transistor_c": "QT{port}",
    "delay_s": "ED{port}",
    "external_c": "ET1",
    "status": "PS{port}",
}
STATUS = ["working", "stand", "sleep", "hibernation"]
MOMENT_S = 0.1


def wrong_values(outcome: Outcome) -> Iterator[str]:
    """What the record says that its station did not hold, or did not say."""
    now = outcome.driver.clock.monotonic()
    for row in outcome.memory.settings:
        yield from _wrong_setting(outcome.cables[row.station], row, now)
    for sample in outcome.memory.samples:
        yield from _wrong_sample(outcome.cables[str(sample[COLUMN["station"]])], sample)


def _wrong_setting(one: Cable, row: SettingRow, now: float) -> Iterator[str]:
    if (
        row.outcome not in ("confirmed", "unchanged", "read")
        or row.readback is None
        or row.setting not in SETTING_CODES
    ):
        return
    tool = one.station.ports[row.port].tool if row.port in one.station.ports else 1
    code = SETTING_CODES[row.setting].format(port=row.port, tool=tool)
    if row.setting == "selected_air_flow" and row.outcome != "read":
        return  # in per mille of what it may be: the sample's column is compared instead
    said = {as_recorded(row.setting, raw) for _, raw in one.said.get(code, [])}
    if row.readback not in said:
        yield (
            f"{row.station}: {row.setting} of port {row.port}: {row.readback} is recorded, and"
            f" {sorted(said)} was said"
        )
    if row.outcome == "read" or row.setting == "status":
        return
    held = one.station.stored(code, now)
    if held is None or not as_recorded(row.setting, held) == row.readback == row.requested:
        yield (
            f"{row.station}: {row.setting} of port {row.port} is {held}, {row.readback} is"
            f" recorded, {row.requested} was asked"
        )


def _wrong_sample(one: Cable, sample: SampleRow) -> Iterator[str]:
    port = sample[COLUMN["port"]]
    shift = VirtualClock().utc() - VirtualClock().monotonic()
    time = sample[COLUMN["time"]]
    assert isinstance(time, int)
    at = time / 1e6 - shift
    # its readings are of one scan after its due time
    took = [sample[COLUMN[name]] for name in ("late_us", "scan_us")]
    around = MOMENT_S + sum(one for one in took if isinstance(one, int)) / 1e6
    for column, form in SIGNAL_CODES.items():
        value = sample[COLUMN[column]]
        if value is None:
            continue
        code = form.format(port=port)
        if one.station.family == "jtse" and column == "temperature_c":
            code = "AT1"
        near = [
            raw for moment, raw in one.said.get(code, []) if at - around <= moment <= at + around
        ]
        if not any(_same(one, column, value, raw) for raw in near):
            yield (
                f"{sample[COLUMN['station']]}: {column} of port {port} at {at:.3f}: {value} is"
                f" recorded, and {near} was said"
            )


def _same(one: Cable, column: str, value: object, raw: str) -> bool:
    if column == "status":
        return value == (["off", "on"] if one.station.family == "jtse" else STATUS)[int(raw[4])]
    return value == int(raw)


def eight(seed: int, p: float, families: Sequence[str] = bench.FAMILIES) -> dict[str, Cable]:
    """A station of each family on a wire of its own."""
    return {family: bench.cable(family, seed * 100 + at, p) for at, family in enumerate(families)}
