"""Makes a small run folder through the real live store, for tests of whatever reads runs.

``python tests/support records.small_run DIR`` makes one to look at. Two stations: ``dde-1`` with
two ports, solder joints and a high-temperature alarm on port 1; ``ale-1`` with its feeder, which
drops out for 3 s and comes back.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

from jbclog.analysis.verdict import RULES, Evidence, Targets, judge
from jbclog.config.recipe_sections import Acceptance
from jbclog.core.rows import (
    COLUMN,
    SAMPLE_COLUMNS,
    CounterRow,
    EventRow,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
    quality_of,
    reasons_text,
)
from jbclog.record.conclude import conclude
from jbclog.record.folder import create_run, keep_text
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import LineFile, Manifest, Metadata, RecipeFile, iso, write_manifest
from jbclog.record.run_journal import RunJournal
from jbclog.record.seal import seal_journal

T0_UTC_S = 1_790_000_000.0
T0_MONO_S = 5_000.0
HZ = 10
FAST = ("temperature_c", "power_permille", "status")

LINE = """[line]
name = "bench"

[[station]]
name = "dde-1"
url = "dde-1.pty"
family = "dde"

[[station]]
name = "ale-1"
url = "ale-1.pty"
family = "ale"
"""
RECIPE = """[recipe]
name = "sn100c-tht"
revision = 7
families = ["dde", "ale"]

[temperature]
select_c = 350

[alarm.high]
limit_c = 380
delay_s = 1.6

[acceptance]
coverage_percent = 99.5
longest_gap_s = 5
idle_error_c = 15
idle_sd_c = 5
alarms_max = 0
"""
LIMITS = Acceptance(
    coverage_percent=99.5, longest_gap_s=5, idle_error_c=15, idle_sd_c=5, alarms_max=0
)
"""The recipe's `[acceptance]`."""


def micros(second: float) -> int:
    """UTC microseconds of a moment of the run."""
    return round((T0_UTC_S + second) * 1e6)


@dataclass
class Port:
    """One tool as it is sampled: around its setting; a tip of 9 ‰·s/K that gives 600 ‰ away in a
    joint, and is back.
    """

    station: str
    number: int
    rng: random.Random
    has_feeder: bool = False
    setpoint_c: int = 350
    dropout_s: tuple[float, float] = (0.0, 0.0)
    alarm_s: tuple[float, float] = (0.0, 0.0)
    wander_c: float = 0.0
    due: dict[str, int] = field(default_factory=dict)

    def row(self, tick: int) -> SampleRow:
        second = tick / HZ
        row: SampleRow = [None] * len(SAMPLE_COLUMNS)
        due = self.due_at(tick)
        for signal in due:
            self.due[signal] = self.due.get(signal, 0) + 1
        values = self._values(second, due)
        gone = self.dropout_s[0] <= second < self.dropout_s[1]
        reasons = dict.fromkeys(values, "disconnected") if gone else self._not_counting(values)
        late, scan = self.rng.randrange(90, 700), self.rng.randrange(45_000, 47_000)
        for column, value in values.items():
            row[COLUMN[column]] = None if column in reasons else value
        row[COLUMN["time"]] = micros(second) + (0 if gone else late + scan // 3)
        row[COLUMN["tick"]], row[COLUMN["station"]], row[COLUMN["port"]] = (
            tick,
            self.station,
            self.number,
        )
        row[COLUMN["late_us"]], row[COLUMN["scan_us"]] = (None, None) if gone else (late, scan)
        row[COLUMN["quality"]], row[COLUMN["reasons"]] = quality_of(reasons), reasons_text(reasons)
        return row

    def due_at(self, tick: int) -> list[str]:
        """The signals that are due, by name."""
        slow = {
            "alarm_high": 20,
            "port_error": 20,
            "setpoint_c": 50,
            "tool": 50,
            "transistor_c": 100,
            "delay_s": 100,
        }
        if self.number == 1:
            slow |= {"station_error": 50, "transformer_c": 100} | (
                {"feeding": 20} if self.has_feeder else {}
            )
        return [*FAST, *(name for name, every in slow.items() if tick % every == 0)]

    def _values(self, second: float, due: list[str]) -> dict[str, object]:
        self.wander_c += self.rng.gauss(0, 0.15) - 0.1 * self.wander_c
        phase = second % 5 if second > 5 else 5.0
        joint, back = phase < 1.5, 1.5 <= phase < 2.5
        fallen = 12 * phase if joint else 18 * (2.5 - phase) if back else 0.0
        hot = self.alarm_s[0] <= second < self.alarm_s[1]
        temperature = self.setpoint_c + self.wander_c - fallen + (40 if hot else 0)
        power = self.rng.gauss(620 if joint else 290 if back else 130, 25)
        every: dict[str, dict[str, object]] = {
            "temperature_c": {"temperature_c": round(temperature)},
            "power_permille": {"power_permille": min(1000, max(0, round(power)))},
            "status": {"status": "working", "cooling": False, "desoldering": False},
            "alarm_high": {"alarm_high": hot, "alarm_low": False},
            "feeding": {"feeding": joint},
        }
        if self.has_feeder:
            every["status"]["motor"] = "forward" if joint else "off"
        plain = {
            "port_error": 0,
            "setpoint_c": self.setpoint_c,
            "tool": 2,
            "transistor_c": 31,
            "station_error": 0,
            "transformer_c": 44,
        }
        values: dict[str, object] = {}
        for signal in due:
            values |= every.get(signal, {signal: plain.get(signal)})
        return values

    @staticmethod
    def _not_counting(values: dict[str, object]) -> dict[str, str]:
        return {"delay_s": "not_counting"} if "delay_s" in values else {}


def make_ports(seed: int = 1) -> list[Port]:
    rng = random.Random(seed)
    return [
        Port("dde-1", 1, rng, alarm_s=(24.0, 30.0)),
        Port("dde-1", 2, rng, setpoint_c=330),
        Port("ale-1", 1, rng, has_feeder=True, dropout_s=(33.0, 36.0)),
    ]


def make_facts(ports: list[Port]) -> Iterator[StationFacts]:
    for name, family, model in (("dde-1", "dde", "DDE"), ("ale-1", "ale", "ALE")):
        mine = [port for port in ports if port.station == name]
        yield StationFacts(
            name,
            f"{name}.pty",
            family,
            model,
            "8886000",
            1,
            ports=[port.number for port in mine],
            tool_names={port.number: "T245/T470" for port in mine},
            turnaround_us={"median": 1010.0, "p99": 1350.0, "n": 50},
            period_s=1 / HZ,
            recipe="recipes/tht.toml",
            rated_power_w=130.0 if name == "dde-1" else None,
            first_tick=0,
            due={str(port.number): dict(port.due) for port in mine},
            touched=[port.number for port in mine],
            outcome="completed",
            safe_state={port.number: "verified" for port in mine},
            last_temperature_c={port.number: float(port.setpoint_c) for port in mine},
            outages=1 if name == "ale-1" else 0,
            alarms=1 if name == "dde-1" else 0,
        )


def events(seconds: float) -> Iterator[EventRow]:
    """In the order in which a session would have told them."""
    at, info = micros, Severity.INFO
    yield EventRow(at(-1.5), "run.start", info, "The run began: line bench, two stations, 10 Hz.")
    yield EventRow(
        at(26.0),
        "alarm.high",
        Severity.ERROR,
        "High-temperature alarm on dde-1 port 1: 390 °C, the limit is 380 °C.",
        "dde-1",
        1,
        at(24.0),
        None,
        390.0,
        380.0,
        "00001",
    )
    yield EventRow(
        at(28.0),
        "port.error",
        Severity.WARNING,
        "dde-1 port 2: warning: overload (MOS)",
        "dde-1",
        2,
        at(26.0),
        9,
        raw="00009",
    )
    yield EventRow(
        at(30.0), "port.error", info, "dde-1 port 2: ok again", "dde-1", 2, at(28.0), 0, raw="00000"
    )
    yield EventRow(
        at(33.2),
        "link.lost",
        Severity.CRITICAL,
        "ale-1 does not answer; its tool was hot.",
        "ale-1",
        None,
        at(33.0),
    )
    yield EventRow(
        at(36.0),
        "link.back",
        info,
        "ale-1 answers again; identity and settings are as before.",
        "ale-1",
    )
    for station, port in (("dde-1", 1), ("dde-1", 2), ("ale-1", 1)):
        yield EventRow(
            at(seconds + 0.1),
            "safety.safe_state",
            info,
            f"{station} port {port} stands, read back.",
            station,
            port,
        )
    yield EventRow(at(seconds + 0.2), "run.end", info, "The run ended as planned.")


def settings() -> Iterator[SettingRow]:
    at = micros(-1.0)
    yield SettingRow(
        at,
        "dde-1",
        1,
        "T245/T470",
        "selected_temperature",
        "°C",
        "350",
        "350",
        "350",
        None,
        "confirmed",
    )
    yield SettingRow(
        at,
        "dde-1",
        2,
        "T245/T470",
        "selected_temperature",
        "°C",
        "330",
        "330",
        "330",
        None,
        "confirmed",
    )
    yield SettingRow(
        at, "dde-1", 1, "T245/T470", "alarm_high_limit", "°C", "380", None, "380", None, "unchanged"
    )
    yield SettingRow(at, "dde-1", 1, "T245/T470", "adjust", "°C", None, None, "-3", None, "read")
    yield SettingRow(
        at,
        "ale-1",
        1,
        "T245/T470",
        "selected_temperature",
        "°C",
        "350",
        "350",
        "350",
        None,
        "confirmed",
    )
    yield SettingRow(
        at,
        "ale-1",
        1,
        "T245/T470",
        "feeder_length",
        "mm",
        "5.00",
        "5.00",
        "5.00",
        None,
        "confirmed",
    )
    yield SettingRow(
        at, "ale-1", 1, "T245/T470", "clog_detection", "", "on", None, None, None, "unsupported"
    )


def counters(second: float) -> Iterator[CounterRow]:
    for station, port in (("dde-1", 1), ("dde-1", 2), ("ale-1", 1)):
        for name, value, unit in (
            ("plugged_h", 1203, "h"),
            ("work_h", 811, "h"),
            ("sleep_cycles", 4211, "count"),
        ):
            yield CounterRow(
                micros(second), station, port, name, float(value), unit, f"{value:05d}"
            )
    yield CounterRow(
        micros(second), "ale-1", 1, "dispensed_mm", 4096.0 + second, "mm", "0x0000000A000"
    )
    yield CounterRow(micros(second), "ale-1", 1, "dispensed_cycles", None, "count", "<timeout>")


def begin(out: Path, seconds: float) -> tuple[Path, Manifest]:
    """A new folder with its inputs and the manifest of a run that is open."""
    folder = create_run(out, "bench", T0_UTC_S - 2)
    keep_text(folder, "line.toml", LINE)
    keep_text(folder, "recipes/tht.toml", RECIPE)
    manifest = Manifest(
        folder.name,
        start=iso(micros(-2.0)),
        t0_mono=T0_MONO_S,
        t0_utc=T0_UTC_S,
        line=LineFile("bench", "line.toml", sha256(LINE.encode()).hexdigest()),
        recipes=[
            RecipeFile("recipes/tht.toml", sha256(RECIPE.encode()).hexdigest(), "sn100c-tht", 7)
        ],
        metadata=Metadata(
            "M. Weber", "4711", "controller <B>", ["SN-001", "SN-002"], {"shift": "2"}
        ),
        host={"jbclog": "0.1.0", "python": "3.11.7", "system": "Linux"},
        rate=float(HZ),
    )
    write_manifest(folder, manifest)
    return folder, manifest


def fill(store: RunJournal, seconds: float, seed: int = 1) -> list[StationFacts]:
    """Hand over everything that happened in `seconds`, in the order in which it did; give what is
    known of the stations.
    """
    ports = make_ports(seed)
    told = list(events(seconds))
    for setting in settings():
        store.setting(setting)
    for counter in counters(-0.5):
        store.counter(counter)
    for tick in range(round(seconds * HZ)):
        while told and told[0].time <= micros(tick / HZ):
            event = told.pop(0)
            store.event(event, at_once=event.kind.startswith("alarm."))
        for port in ports:
            store.sample(port.row(tick))
    for event in told:
        store.event(event)
    for counter in counters(seconds):
        store.counter(counter)
    stations = list(make_facts(ports))
    for facts in stations:
        facts.last_tick = round(seconds * HZ) - 1
        store.facts(facts)
    return stations


def make_run(out: Path, seconds: float = 60.0, seed: int = 1) -> Path:
    """A sealed run of `seconds` below `out`."""
    folder, manifest = begin(out, seconds)
    store = RunJournal(folder)
    store.start()
    stations = fill(store, seconds, seed)
    store.close()
    manifest.exit_status, manifest.exit_code = "success", 1
    manifest.stop = iso(micros(seconds + 0.3))
    write_manifest(folder, manifest)
    seal_journal(folder)
    targets = {name: Targets(frozenset({1, 2, 3, 4}), None) for name in ("dde-1", "ale-1")}
    judgement = judge(
        Evidence(folder, stations, ledger_of(folder, stations), targets=targets),
        dict.fromkeys(targets, LIMITS),
    )
    manifest.rules, manifest.verdict = RULES, judgement.verdict.value
    manifest.verdict_rules = judgement.rules_as_dicts()
    conclude(folder, manifest, store.lock)
    return folder


if __name__ == "__main__":
    print(make_run(Path(sys.argv[1])))
