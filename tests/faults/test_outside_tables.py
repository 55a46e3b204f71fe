"""The tables of runs on stations that somebody else wrote from the manuals (`outside_bench`),
checked by one who had read only the pages (`outside_tables`), while links, hosts, disks and people
do what they do.

All runs are recorded at the same time, into one folder.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from support import program
from support.command import is_sampling, started, until
from support.command import jbclog as command
from support.faults.killed_run import folders
from support.faults.small_disk import fill, small_disk
from support.oracles.outside_bench import ROOM_C, Cable, Port, Served, Soldering, cable, line_file
from support.oracles.outside_tables import DERIVED, RECORDED, Folder, documented
from support.product import Run, open_run, open_runs

RECIPE = """
[recipe]
name = "outside"
revision = 1
families = ["soldering", "dde", "nae", "dme", "hde", "ucr", "ale"]
[temperature]
select_c = {select_c}
[sleep]
delay_min = 5
[hibernation]
delay_min = 30
[alarm.high]
limit_c = {high_c}
delay_s = 0.5
[alarm.low]
limit_c = {low_c}
delay_s = 0.5
[sampling]
rate_hz = "auto"
alarms_every_s = {alarms_s}
counters_every_s = {counters_s}
[run]
status = "working"
on_difference = "continue"
require_tool = false
[episodes]
dead_band_c = 1
stale_s = 2
[acceptance]
coverage_percent = 99
longest_gap_s = 0.4
alarms_max = 0
"""
AIR = """
[recipe]
name = "outside-air"
revision = 1
families = ["jtse"]
[air]
temperature_c = 300
flow_permille = 500
mode = "manual"
[sampling]
rate_hz = "auto"
[run]
status = "on"
[acceptance]
coverage_percent = 99
longest_gap_s = 0.4
"""
SOON_S = 90.0
ATTEMPTS = 4
CAPACITY, LOSS, DRAW = 6.0, 0.45, 550.0
"""Of a tip, in ‰·s/K and ‰/K; ‰ of a draw of heat."""


class WorkedPort(Port):
    """A port whose tip is a heat capacity under a controller, and draws heat when it solders."""

    every_s = 3.0
    for_s = 0.8
    solders = True
    _went: float | None = None

    def live(self, now: float) -> None:
        at = now if self._went is None else self._went
        while at < now:
            step = min(now - at, 0.02)
            at += step
            away = self.target() - self.temperature
            hold = LOSS * (self.temperature - ROOM_C)
            self.power = min(max(hold + 60 * away, 0.0), 1000.0)
            draw = DRAW if self.solders and at % self.every_s < self.for_s else 0.0
            self.temperature += (self.power - hold - draw) / CAPACITY * step
            self._fall_asleep(at)
            self._watch(at)
        self._went = now


def worked(family: str, seed: int, p: float = 0.0, **keys: object) -> Cable:
    """A cable to a station whose tips solder."""
    made = cable(family, seed, p)
    assert isinstance(made.station, Soldering)
    for number, port in made.station.ports.items():
        made.station.ports[number] = WorkedPort(
            port.tool, random.Random(seed), made.station.habits.extractor_cools
        )
    return made


# -- what is recorded ------------------------------------------------------------------------------


@dataclass
class Scene:
    """One run: its stations, and what happens to it."""

    name: str
    cables: dict[str, Cable]
    happens: Callable[[Recording], None]
    words: tuple[str, ...] = ()
    recipe: dict[str, float] = field(default_factory=dict)
    keys: str = ""
    host: str = ""
    units: bool = False
    read: list[tuple[str, float]] = field(default_factory=list)
    """Serials, and when each was read: what is now, and what no clock of the run has told."""

    def place(self, station: str) -> str:
        """The name of its terminal."""
        return f"{self.name}-{station}"


@dataclass
class Recording:
    """A run that samples."""

    scene: Scene
    served: Served
    out: Path
    process: subprocess.Popen[str]
    reader: int = -1

    def unit(self, serial: str) -> None:
        """Have the barcode reader read a serial."""
        self.scene.read.append((serial, time.time()))
        os.write(self.reader, f"{serial}\n".encode())

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self) -> None:
        self.signal(signal.SIGINT)


def wait(seconds: float) -> None:
    time.sleep(seconds)


def with_units(run: Recording) -> None:
    for serial in ("U-1", "U-2", "U-1"):
        run.unit(serial)
        wait(3.5)
    run.unit("END")
    wait(1.0)
    run.end()


def disturbed(run: Recording) -> None:
    cables = run.scene.cables
    wait(1.5)
    silent = cables["hde"]
    silent.silent_from = time.monotonic()
    silent.silent_until = time.monotonic() + 1.7
    wait(1.0)
    terminal = run.scene.place("nae")
    run.served.unplug(terminal)
    wait(2.0)
    run.served.plug(terminal, cables["nae"], run.out.parent.parent)
    wait(5.0)
    run.end()


def pulled(run: Recording) -> None:
    station = run.scene.cables["dde"].station
    port = station.ports[1]
    tool = port.tool
    wait(2.0)
    port.tool, port.temperature = 0, ROOM_C
    wait(2.0)
    port.tool = tool
    wait(2.0)
    station.ports[2].tool = 2
    port.selected = 320
    wait(2.0)
    run.end()


def late(run: Recording) -> None:
    """Each fifteenth answer comes late, by up to a second and a half."""
    for number in range(400, 4000, 15):
        run.scene.cables["hde"].script[number] = "late"
    wait(11.0)
    run.end()


def stepped(run: Recording) -> None:
    run.unit("S-1")
    wait(2.0)
    run.signal(signal.SIGUSR1)
    wait(2.0)
    run.unit("S-2")
    wait(2.0)
    run.signal(signal.SIGUSR1)
    wait(2.0)
    run.unit("S-3")
    wait(1.5)
    run.end()


def stopped(run: Recording) -> None:
    """Stands still for a moment, and then for longer."""
    for seconds in (0.7, 5.5):
        wait(1.5)
        run.signal(signal.SIGSTOP)
        wait(seconds)
        run.signal(signal.SIGCONT)
    wait(2.5)
    run.end()


def killed(run: Recording) -> None:
    run.unit("K-1")
    wait(4.0)
    run.process.kill()


def alarmed(run: Recording) -> None:
    """Too hot, twice, once while nothing is heard; then too cold."""
    station = run.scene.cables["ucr"].station
    port = station.ports[1]
    for silence_s in (0.0, 0.6):
        wait(2.0)
        port.temperature += 70
        if silence_s:
            run.scene.cables["ucr"].silent_from = time.monotonic()
            run.scene.cables["ucr"].silent_until = time.monotonic() + silence_s
        wait(1.5)
        port.temperature = 350.0
    wait(1.0)
    port.temperature = 60.0
    wait(1.5)
    run.end()


def calm(run: Recording) -> None:
    wait(10.0)
    run.end()


def filled(run: Recording) -> None:
    wait(2.0)
    filler = fill(run.out.parent.parent)
    run.process.wait(SOON_S)
    filler.unlink()


TIP = {"select_c": 350, "high_c": 400, "low_c": 100, "alarms_s": 1, "counters_s": 5}


def scenes() -> list[Scene]:
    noisy = {"hde": worked("hde", 11, 0.01), "nae": worked("nae", 12), "jtse": cable("jtse", 13)}
    return [
        Scene(
            "units",
            {"dde": worked("dde", 1), "hde": worked("hde", 2)},
            with_units,
            ("--tip", "dde:2=T-7", "--tip", "hde=T-8", "--tip", "T-9"),
            keys="rated_power_w = 130",
            units=True,
        ),
        Scene("disturbed", noisy, disturbed, ("--unit", "D-1"), keys="rated_power_w = 40"),
        Scene("pulled", {"dde": cable("dde", 21)}, pulled, ("--tip", "A", "--tip", "B")),
        Scene("late", {"hde": cable("hde", 31)}, late, ("--rate", "3.3"), {"counters_s": 2}),
        Scene(
            "stepped",
            {"ucr": worked("ucr", 41)},
            stepped,
            keys="rated_power_w = 130",
            host="step=-20,step=3600",
            units=True,
        ),
        Scene(
            "stopped",
            {"soldering": worked("soldering", 51)},
            stopped,
            ("--no-guard", "--unit", "S"),
        ),
        Scene("max", {"ale": worked("ale", 61, 0.004)}, calm, ("--rate", "max", "--unit", "M")),
        Scene("slow", {"hde": worked("hde", 71)}, calm, ("--rate", "0.7"), {"counters_s": 1}),
        Scene("fast", {"ucr": worked("ucr", 81)}, calm, ("--rate", "fit"), {"alarms_s": 0.9}),
        Scene("killed", {"dde": worked("dde", 91, 0.01)}, killed, units=True),
        Scene("alarmed", {"ucr": cable("ucr", 96)}, alarmed, ("--unit", "a", "--unit", "b")),
    ]


def recorded(scene: Scene, served: Served, home: Path) -> Path:
    """Record one scene on stations that are served; give its folder, with derived tables."""
    home.mkdir()
    (home / "tip.toml").write_text(RECIPE.format(**TIP | scene.recipe))
    (home / "air.toml").write_text(AIR)
    families = {name: one.station.family for name, one in scene.cables.items()}
    more = {
        name: f'recipe = "{"air" if family == "jtse" else "tip"}.toml"\n{scene.keys}'
        for name, family in families.items()
    }
    urls = {name: served.urls[scene.place(name)] for name in scene.cables}
    (home / "line.toml").write_text(line_file(urls, families, name=scene.name, more=more))
    words = ["run", "--line", str(home / "line.toml"), *scene.words]
    reader = -1
    if scene.units:
        os.mkfifo(home / "reader")
        reader = os.open(home / "reader", os.O_RDWR)
        words += ["--units", str(home / "reader")]
    out, process = sampling(scene, words, home)
    try:
        scene.happens(Recording(scene, served, out, process, reader))
        process.communicate(timeout=SOON_S)
    finally:
        process.kill()
        process.communicate()
        if scene.units:
            os.close(reader)
    (folder,) = folders(out)
    if process.returncode not in (0, 1, 2, 3, 5):
        assert command("recover", folder).returncode in (0, 5)  # 5: a tool may still be hot
        assert command("report", folder).returncode == 0
    assert until(lambda: all(file(folder, name).exists() for name in DERIVED), SOON_S), scene.name
    return folder


def sampling(scene: Scene, words: list[str], home: Path) -> tuple[Path, subprocess.Popen[str]]:
    """Begin a run and wait for its rows. A busy machine may answer too slowly for its rate."""
    for attempt in range(ATTEMPTS):
        out = home / f"runs-{attempt}"
        process = begun(scene, [*words, "--out", str(out)])

        def is_decided(out: Path = out, process: subprocess.Popen[str] = process) -> bool:
            return is_sampling(out) or process.poll() is not None

        assert until(is_decided, SOON_S), scene.name
        if process.poll() is None:
            return out, process
        _, said = process.communicate()
        assert process.returncode == 3, said
    raise AssertionError(said)


def file(folder: Path, table: str) -> Path:
    return folder / "derived" / f"{table}.parquet"


def begun(scene: Scene, words: list[str]) -> subprocess.Popen[str]:
    """The command; on a host of its own where the scene has one."""
    if not scene.host:
        return started(*words)
    odd = program("faults.odd_host", scene.host, *words)
    pipe = subprocess.PIPE
    return subprocess.Popen(odd, stdout=pipe, stderr=pipe, text=True)


@pytest.fixture(scope="module")
def acts() -> list[Scene]:
    return scenes()


@pytest.fixture(scope="module")
def runs(acts: list[Scene], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The folder of each scene's run, all below one folder."""
    home = tmp_path_factory.mktemp("outside")
    together = home / "runs"
    together.mkdir()
    cables = {scene.place(name): one for scene in acts for name, one in scene.cables.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("JBCLOG_NO_DERIVED", raising=False)
        with Served(cables, home) as served, ThreadPoolExecutor(len(acts)) as threads:
            going = {
                scene.name: threads.submit(recorded, scene, served, home / scene.name)
                for scene in acts
            }
            ended = {name: each.result() for name, each in going.items()}
    return {name: Path(shutil.move(folder, together)) for name, folder in ended.items()}


# -- what the pages say of it ----------------------------------------------------------------------


def test_each_table_is_as_the_pages_say(runs: dict[str, Path]) -> None:
    wrong = {name: Folder(folder).wrong() for name, folder in runs.items()}
    assert {name: each for name, each in wrong.items() if each} == {}


def test_a_unit_begins_when_its_serial_is_read(acts: list[Scene], runs: dict[str, Path]) -> None:
    """Also where the host's clock is set in between."""
    for scene in acts:
        units = Folder(runs[scene.name]).frames["units"]
        if scene.units:
            assert [serial for serial, _ in scene.read] == units["unit"].tolist()
            began = [moment.timestamp() for moment in units["start"]]
            assert began == pytest.approx([moment for _, moment in scene.read], abs=1.5)


def cut(table: pa.Table) -> pa.Table:
    return table.slice(1)


def moved(column: str, by: int) -> Callable[[pa.Table], pa.Table]:
    """Add to a column."""

    def move(table: pa.Table) -> pa.Table:
        at, type_ = table.column_names.index(column), table.schema.field(column).type
        whole = pa.int64() if pa.types.is_timestamp(type_) else type_
        values = [
            None if one is None else one + by for one in table[column].cast(whole).to_pylist()
        ]
        changed = pa.array(values, whole).cast(type_)
        return table.set_column(at, table.schema.field(column), changed)

    return move


def told(column: str, text: str, row: int = -1) -> Callable[[pa.Table], pa.Table]:
    """Have another text in one row of a column."""

    def tell(table: pa.Table) -> pa.Table:
        values = table[column].to_pylist()
        values[row] = text
        at = table.column_names.index(column)
        return table.set_column(at, table.schema.field(column), pa.array(values, pa.string()))

    return tell


LIES: dict[str, tuple[str, str, Callable[[pa.Table], pa.Table], str]] = {
    "a row is gone": ("units", "samples", cut, "samples.seq: holes"),
    "a time is later": ("units", "samples", moved("time", 900_000), "read at"),
    "a tick is another": ("units", "samples", moved("tick", 7), "µs before it was due"),
    "a value is another's": ("", "joints", told("unit", "S-9"), "unit S-9"),
    "a reason is worse": ("disturbed", "samples", told("quality", "pulled"), "quality pulled"),
    "a run is another": ("killed", "events", told("run", "other"), "events.run: {'other'}"),
    "a text is another": ("killed", "events", told("text", "Nothing.", 0), "hash of the row"),
    "a gap is gone": ("disturbed", "gaps", cut, "derived/gaps"),
    "a gap is longer": ("max", "gaps", moved("stop", 50_000), "derived/gaps"),
    "a count is higher": ("late", "accounting", moved("obtained", 1), "due is not obtained"),
    "a power is higher": ("units", "samples", moved("power_permille", 1), "energy_permille_s"),
    "a metric is lower": ("fast", "metrics", moved("value", -1), "recounted"),
    "an alarm is longer": ("alarmed", "alarms", moved("stop", 1_000_000), " s from "),
    "a joint is gone": ("", "joints", cut, "joint"),
    "a joint begins later": ("", "joints", moved("start_s", 5), "start"),
    "a unit begins later": ("units", "units", moved("start", 1), "units: "),
    "a unit has more alarms": ("max", "units", moved("alarms", 1), "were on"),
    "a unit is covered": ("max", "units", moved("coverage", 1), "coverage"),
    "a tip is another": ("units", "tips", told("tip", "T-1"), "tips: "),
    "a part has no run": (
        "slow",
        "counters",
        lambda table: table.drop_columns(["run"]),
        "counters: columns",
    ),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_is_found(runs: dict[str, Path], lie: str, tmp_path: Path) -> None:
    scene, table, change, found = LIES[lie]
    most = max(runs, key=lambda name: len(Folder(runs[name]).tables[table]))
    run = runs[scene or most]
    folder = Path(shutil.copytree(run, tmp_path / run.name))
    path = file(folder, table) if table in DERIVED else folder / table / "part-0000.parquet"
    pq.write_table(change(pq.ParquetFile(path).read()), path)
    assert any(found in each for each in Folder(folder).wrong())


def test_what_a_full_disk_left_is_as_the_pages_say(tmp_path: Path) -> None:
    scene = Scene("full", {"hde": worked("hde", 99)}, filled, ("--unit", "F"))
    cables = {scene.place("hde"): scene.cables["hde"]}
    with small_disk(tmp_path / "disk", "24m") as disk, Served(cables, tmp_path) as served:
        folder = recorded(scene, served, disk / "home")
        assert Folder(folder).wrong() == []
        assert Folder(folder).manifest["exit_status"] != "success"


CALLS: dict[str, Callable[[Run], pd.DataFrame]] = {
    "joints": lambda run: run.joints(),
    "alarms": lambda run: run.alarms(witnesses=True),
    "units": lambda run: run.units(),
    "tips": lambda run: run.tips(),
    "metrics": lambda run: run.metrics(),
    "accounting": lambda run: run.accounting(),
    "gaps": lambda run: run.gaps(),
}


@pytest.mark.parametrize("table", DERIVED)
def test_a_call_gives_the_file_s_rows_also_without_the_file(
    runs: dict[str, Path], table: str, tmp_path: Path
) -> None:
    for folder in runs.values():
        written = pd.read_parquet(file(folder, table))
        called = CALLS[table](open_run(folder))
        without = Path(shutil.copytree(folder, tmp_path / folder.name))
        shutil.rmtree(without / "derived")
        computed = CALLS[table](open_run(without))
        for frame in (called, computed):
            pd.testing.assert_frame_equal(written, frame, check_dtype=False)


def test_all_runs_give_what_each_gives(runs: dict[str, Path]) -> None:
    home = next(iter(runs.values())).parent
    together = open_runs(home)
    each = [open_run(home / name) for name in together.manifests()["run"]]
    for table in ("samples", "events", "units", "gaps", "accounting", "joints", "alarms"):
        mine = pd.concat(getattr(run, table)() for run in each)
        assert rows_of(getattr(together, table)()) == rows_of(mine), table


def test_times_by_the_host_s_clock_follow_its_steps(runs: dict[str, Path]) -> None:
    for folder in runs.values():
        run, manifest = open_run(folder), Folder(folder).manifest
        by_run, by_host = run.samples(), run.samples(clock="wall")
        offsets = pd.Series(0.0, index=by_run.index)
        for step in manifest["clock_steps"]:
            offsets[by_run["time"] >= pd.Timestamp(step["time"])] = step["offset_s"]
        passed = (by_host["time"] - by_run["time"]).dt.total_seconds()
        assert passed.tolist() == pytest.approx(offsets.tolist(), abs=2e-6), folder.name


def test_the_setpoint_in_force_is_the_last_one_read_for_at_most_15_s(runs: dict[str, Path]) -> None:
    for folder in runs.values():
        samples = open_run(folder).samples(setpoint="in force")
        read = Folder(folder).frames["samples"]
        for place, rows in read.groupby(["station", "port"]):
            given = samples[(samples["station"] == place[0]) & (samples["port"] == place[1])]
            known = rows["setpoint_c"].notna()
            at = rows["time"].where(known).ffill()
            is_young = (rows["time"] - at).dt.total_seconds() <= 15
            expected = rows["setpoint_c"].ffill().where(is_young)
            assert given["setpoint_c"].tolist() == expected.tolist(), folder.name


@pytest.mark.parametrize("table", [*RECORDED, *DERIVED])
def test_others_read_all_runs_as_one_table(runs: dict[str, Path], table: str) -> None:
    home = next(iter(runs.values())).parent
    below = f"derived/{table}" if table in DERIVED else f"{table}/*"
    pattern = f"{home}/*/{below}.parquet"
    by_duckdb = duckdb.sql(f"SELECT * FROM '{pattern}'").arrow().read_all()
    by_polars = pl.read_parquet(pattern).to_arrow()
    assert by_duckdb.column_names == by_polars.column_names
    rows = sum(len(Folder(folder).tables[table]) for folder in runs.values())
    assert len(by_duckdb) == len(by_polars) == rows
    mine = rows_of(pd.concat(Folder(folder).frames[table] for folder in runs.values()))
    by_pandas = [
        pd.read_parquet(file(folder, table) if table in DERIVED else folder / table)
        for folder in runs.values()
    ]
    assert rows_of(pd.concat(by_pandas)) == mine
    assert rows_of(by_duckdb.to_pandas()) == mine
    assert rows_of(by_polars.to_pandas()) == mine


def rows_of(frame: pd.DataFrame) -> list[tuple[object, ...]]:
    """Its rows as plain values, in one order."""
    rows = [tuple(map(plain, row)) for row in frame.itertuples(index=False)]
    return sorted(rows, key=repr)


def plain(value: object) -> object:
    if pd.isna(value):  # type: ignore[call-overload]  # cells are scalars
        return None
    if isinstance(value, pd.Timestamp):
        return value.value // 1000
    if isinstance(value, str):
        return value
    return float(value)  # type: ignore[arg-type]  # a number


def test_the_published_tree_has_the_same_rows(runs: dict[str, Path], tmp_path: Path) -> None:
    told = command("publish", *runs.values(), tmp_path / "plant")
    assert told.returncode == 0, told.stderr
    for table in (*RECORDED, *DERIVED):
        tree = duckdb.sql(
            "SELECT * EXCLUDE (line, month) FROM read_parquet("
            f"'{tmp_path}/plant/{table}/**/*.parquet', hive_partitioning = true)"
        )
        mine = rows_of(pd.concat(Folder(folder).frames[table] for folder in runs.values()))
        assert rows_of(tree.arrow().read_all().to_pandas()) == mine, table
    for folder in runs.values():
        there, here = open_run(tmp_path / "plant" / folder.name), open_run(folder)
        pd.testing.assert_frame_equal(there.samples(), here.samples())
        pd.testing.assert_frame_equal(there.gaps(), here.gaps())


RELEASES = Path(__file__).parents[1] / "data" / "releases"


@pytest.mark.parametrize("release", ["0.1.0", "after-0.1.0"])
def test_runs_of_schema_1_have_the_columns_of_the_page(release: str) -> None:
    for manifest in (RELEASES / release).glob("**/manifest.json"):
        assert json.loads(manifest.read_text())["schema"] == 1
        run = open_run(manifest.parent)
        frames = {name: getattr(run, name)() for name in (*RECORDED, *DERIVED) if name != "alarms"}
        frames["alarms"] = run.alarms(witnesses=True)
        for name, frame in frames.items():
            assert list(frame) == [column.name for column in documented()[name]], name
            assert set(frame["run"]) <= {run.name}
        for name in ("samples", "settings", "counters"):
            assert frames[name]["seq"].isna().all()
        assert frames["events"]["seq"].tolist() == list(range(1, len(frames["events"]) + 1))
        words = frames["samples"]["reasons"].dropna().str.split(";").explode()
        signals = set(words.str.partition("=")[0]) | set(frames["accounting"]["signal"])
        assert signals.isdisjoint({"set_c", "limit", "unit"})
        assert list(Folder(manifest.parent).wrong_chain()) == []
