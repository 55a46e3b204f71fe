"""The ten jobs of the pages "Query runs in SQL" and "Ten questions": their blocks run as they stand
there, on runs of virtual stations and on the demo's, are short, and both pages give equal figures.
"""

from __future__ import annotations

import ast
import re
import shutil
import tarfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import pandas as pd
import pytest

from support.campaigns.each_row import each_row
from support.lazy import duckdb
from support.product import (
    DERIVED_TABLES,
    STORED_TABLES,
    Charted,
    NoChart,
    PublishedTree,
    Run,
    Runs,
    individuals_chart,
    open_runs,
    publish_runs,
)
from support.readers.repository import ROOT
from support.readers.texts import Demo, blocks, rows, section, text_of
from support.records.derived import derive
from support.records.quality_runs import make_runs

SQL_PAGE: Final = text_of("how-to/sql.md")
PYTHON_PAGE: Final = text_of("how-to/ten-questions.md")
JOBS: Final = (
    "Temperature and setpoint of a port",
    "Share of working time within ±10 °C",
    "Gaps and their reasons",
    "Energy of each unit",
    "Alarms",
    "Joints of a unit",
    "Recovery in two runs",
    "Control chart over runs",
    "Units that a tip soldered",
    "Counters before and after",
)
CHART: Final = "Control chart over runs"
MOST_LINES: Final = 5
VIEWS, TREE_VIEWS = blocks("sql", section("Views", SQL_PAGE))
OPENING: Final = blocks("python", PYTHON_PAGE)[0]
every_job = each_row((job, (job,)) for job in JOBS)

Row = tuple[object, ...]


def block_of(language: str, job: str) -> str:
    page = SQL_PAGE if language == "sql" else PYTHON_PAGE
    (block,) = blocks(language, section(job, page))
    return block


def lines_of(block: str) -> list[str]:
    return [line for line in block.splitlines() if line.strip()]


# -- the runs --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose `runs` has three runs with units, tips, gaps and alarms."""
    home = tmp_path_factory.mktemp("bench")
    make_runs(home / "runs")
    return home


@pytest.fixture(scope="module")
def capability(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose `runs` has the twenty runs of notebook 04, with their derived tables."""
    home = tmp_path_factory.mktemp("capability")
    with tarfile.open(ROOT / "notebooks/data/capability.tar.xz") as packed:
        packed.extraction_filter = getattr(tarfile, "data_filter", None)  # none before 3.11.4
        packed.extractall(home / "runs")
    for run in (home / "runs").iterdir():
        derive(run)
    return home


@pytest.fixture(scope="module")
def home_of_demo(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("demo")
    (home / "runs").symlink_to(demo.place / "demo-runs")
    return home


@pytest.fixture(params=["bench", "home_of_demo"])
def home(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with the folder `runs`."""
    folder: Path = request.getfixturevalue(request.param)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(autouse=True)
def _without_windows(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    from matplotlib import pyplot as plt

    monkeypatch.setenv("MPLBACKEND", "agg")
    plt.switch_backend("agg")
    yield
    plt.close("all")


# -- how a block is run ----------------------------------------------------------------------------


def by_library(job: str) -> list[Row]:
    """Run the page's block in the working directory; the rows that its last line shows."""
    shown, names = executed(OPENING + block_of("python", job))
    if job == CHART:
        assert has_picture(shown)
        return [limits_of(names["chart"])]
    if isinstance(shown, pd.Series) or any(shown.index.names):
        shown = shown.reset_index()
    return [plain(row) for row in shown.itertuples(index=False)]


def executed(code: str) -> tuple[Any, dict[str, Any]]:
    """Run code as a notebook does; the value of its last line, and all names."""
    names: dict[str, Any] = {}
    tree = ast.parse(code)
    last = tree.body.pop()
    assert isinstance(last, ast.Expr)
    exec(compile(tree, "page", "exec"), names)
    return eval(compile(ast.Expression(last.value), "page", "eval"), names), names


def has_picture(figure: Any) -> bool:
    return any(axes.lines or axes.texts or axes.collections for axes in figure.axes)


def limits_of(chart: Charted) -> Row:
    """Centre, lower and upper limit; where they are refused, those of the same values."""
    if not isinstance(chart.charts, NoChart):
        individuals = chart.charts[0]
        return individuals.centre, float(individuals.lower[0]), float(individuals.upper[0])
    values = chart.series.values
    if len(values) < 2:
        return float(values.mean()), None, None
    individuals = individuals_chart(values)
    return individuals.centre, float(individuals.lower[0]), float(individuals.upper[0])


def by_sql(job: str, views: str = VIEWS) -> list[Row]:
    """Run the page's query in the working directory; its rows."""
    with duckdb.connect() as database:
        database.execute(views)
        # not fetchall(): it wants the module pytz for times
        table = database.sql(block_of("sql", job)).to_arrow_table()
    columns = [column.to_pylist() for column in table.columns]
    return [plain(row) for row in zip(*columns, strict=True)]


def plain(row: Sequence[Any]) -> Row:
    """Values as Python has them; times in µs, so that nothing is rounded."""
    return tuple(plain_value(value) for value in row)


def plain_value(value: Any) -> object:
    if pd.isna(value):
        return None
    if isinstance(value, datetime):
        return pd.Timestamp(value).value // 1000
    return value.item() if hasattr(value, "item") else value


def assert_equal(by_python: list[Row], by_query: list[Row]) -> None:
    """The same rows; jbclog has stations in the order of the line file, the queries by name."""
    assert len(by_python) == len(by_query)
    for expected, row in zip(
        sorted(by_python, key=key_of), sorted(by_query, key=key_of), strict=True
    ):
        assert row == tuple(map(about, expected))


def key_of(row: Row) -> list[str]:
    return [str(value) for value in row if not isinstance(value, float)]


def about(value: object) -> object:
    return pytest.approx(value, rel=1e-6) if isinstance(value, float) else value


# -- the jobs --------------------------------------------------------------------------------------


def test_both_pages_have_the_ten_jobs() -> None:
    for page in (SQL_PAGE, PYTHON_PAGE):
        headings = [line.removeprefix("## ") for line in page.splitlines() if line[:3] == "## "]
        assert [heading for heading in headings if heading != "Views"] == [*JOBS]


@every_job
def test_a_job_takes_five_lines_at_most(job: str) -> None:
    assert len(lines_of(block_of("sql", job))) <= MOST_LINES
    assert len(lines_of(OPENING + block_of("python", job))) <= MOST_LINES


@every_job
def test_library_and_sql_give_equal_figures(job: str, home: Path) -> None:
    answer = by_library(job)
    assert answer
    assert_equal(answer, by_sql(job))


def test_the_figures_are_those_of_what_was_done_to_the_stations(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that a change of an answer is seen, also if it is the same on both pages."""
    monkeypatch.chdir(bench)
    first, _, last = sorted(run.name for run in (bench / "runs").iterdir())
    answers = {job: by_library(job) for job in JOBS}
    course = answers[JOBS[0]]
    assert len(course) == 600
    assert {setpoint for _, _, setpoint in course} == {350}
    shares = {row[:3]: row[3] for row in answers[JOBS[1]]}
    assert len(shares) == 3 * 6
    assert shares[last, "dde-1", 1] == pytest.approx(0.785844, abs=1e-6)
    gaps = [(row[1], row[2], row[6]) for row in answers[JOBS[2]]]
    assert gaps == [
        ("dde-1", 1, "timeout;disconnected"),
        ("dde-1", 1, "pulled;no_tool"),
        ("dde-1", 2, "disconnected"),
        ("dde-2", 1, "disconnected"),
        ("dde-2", 2, "disconnected"),
    ]
    energies = {row[1]: row[4] for row in answers[JOBS[3]]}
    known = {unit for unit, joules in energies.items() if joules is not None}
    assert known == {"SN-0091", "SN-0092", "SN-0093", "SN-0101", "SN-0104"}
    assert energies["SN-0101"] == pytest.approx(3376, rel=0.05)
    assert [row[:4] for row in answers[JOBS[4]]] == [(last, "ucr-1", 1, "high")] * 2
    assert len([row for row in answers[JOBS[5]] if row[1:3] == ("dde-2", 1)]) == 3
    assert [row[:2] for row in answers[JOBS[6]]] == [(first, 23), (last, 20)]
    joints = {row[:2]: row[2] for row in answers[JOBS[8]]}
    assert joints["T-17", "SN-0103"] == 3  # its tool was out for 5 s
    assert {unit for tip, unit in joints if tip == "T-21"} == known | {"SN-0102", "SN-0103"}
    assert {row[:2] for row in answers[JOBS[9]]} >= {(first, "ale-1"), (last, "dde-2")}


def test_limits_of_twenty_runs_are_equal(capability: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(capability)
    (limits,) = by_library(CHART)
    assert limits == pytest.approx((1.5787, 1.3611, 1.7964), abs=1e-4)
    assert_equal([limits], by_sql(CHART, views_of_0_1_0()))


def views_of_0_1_0() -> str:
    """The views that the page has for runs of 0.1.0: the derived tables, with today's names."""
    assert "use only the views from\n  `joints` to `gaps`" in SQL_PAGE
    lines = VIEWS.splitlines()
    (first,) = [at for at, line in enumerate(lines) if " VIEW joints " in line]
    (last,) = [at for at, line in enumerate(lines) if " VIEW gaps " in line]
    assert last - first == len(DERIVED_TABLES) - 1
    return "\n".join([*lines[:2], *lines[first : last + 1]])


def count_in(database: Any, table: str) -> int:
    ((count,),) = database.execute(f"SELECT count(*) FROM {table}").fetchall()
    return int(count)


# -- what else the page of Python says -------------------------------------------------------------


def test_a_run_and_runs_have_the_calls_of_the_table() -> None:
    calls = [cells[1].strip("`") for cells in rows(PYTHON_PAGE)]
    for call in calls:
        owner, name = re.findall(r"^(?:(runs?)\.)?(\w+)", call)[0]
        of_run, of_runs = hasattr(Run, name), hasattr(Runs, name)
        assert (of_run, of_runs) == (owner != "runs", owner != "run"), call


# -- what else the page of SQL says ----------------------------------------------------------------


@pytest.fixture(scope="module")
def plant(bench: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    tree = tmp_path_factory.mktemp("plant")
    for run in (bench / "runs").iterdir():
        publish_runs(run, PublishedTree.at(tree))
    return tree


def views_of(plant: Path) -> str:
    """The views of a tree, with the two for which the page only says what is other."""
    kept = VIEWS[VIEWS.index("CREATE OR REPLACE VIEW runs ") :]
    assert "`runs` reads `'/runs/**/*.json'`" in SQL_PAGE
    kept = kept.replace("'/*/manifest.json'", "'/runs/**/*.json'")
    return (TREE_VIEWS + kept).replace("/data/plant", str(plant))


@every_job
def test_a_published_tree_gives_the_same(
    job: str, bench: Path, plant: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    assert by_sql(job, views_of(plant)) == by_sql(job)
    with duckdb.connect() as database:
        database.execute(views_of(plant))
        for table in (*STORED_TABLES, *DERIVED_TABLES):
            assert database.execute(f"SELECT DISTINCT line FROM {table}").fetchall() == [("bench",)]


def test_the_samples_of_a_unit_are_those_of_the_library(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    (joined,) = re.findall(r"`(samples AS s JOIN [^`]+)`", SQL_PAGE)
    with duckdb.connect() as database:
        database.execute(VIEWS)
        counts = database.execute(f"SELECT unit, count(*) FROM {joined} GROUP BY unit").fetchall()
    expected: dict[str, int] = {}
    for run in open_runs("runs"):
        units = run.unit_at(run.samples(columns=["time"])["time"]).dropna()
        expected |= units.value_counts().to_dict()
    assert len(expected) == 7
    assert dict(counts) == expected


def test_every_table_has_a_view(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(bench)
    runs = open_runs("runs")
    with duckdb.connect() as database:
        database.execute(VIEWS)
        for table in (*STORED_TABLES, *DERIVED_TABLES):
            every = {"witnesses": True} if table == "alarms" else {}
            expected = getattr(runs, table)(**every)
            columns = database.sql(f"FROM {table}").columns
            assert columns == [*expected], table
            assert count_in(database, table) == len(expected), table


def test_two_stars_mix_the_tables(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(bench)
    tables = (*STORED_TABLES, *DERIVED_TABLES)
    assert f"mixes the {['ten', 'eleven', 'twelve'][len(tables) - 10]} tables" in SQL_PAGE
    with duckdb.connect() as database:
        database.execute(VIEWS)
        mixed = count_in(database, "'runs/**/*.parquet'")
        assert mixed == sum(count_in(database, table) for table in tables)
        with pytest.raises(duckdb.Error):
            database.execute("SELECT * FROM 'runs/**/*.parquet'").fetchall()


# of DuckDB's own making, not ours
@pytest.mark.filterwarnings("ignore:The inplace keyword")
def test_times_are_utc_and_join_with_those_of_the_library(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    late = "samples WHERE time >= '2026-11-26 06:31:00'"
    with duckdb.connect() as database:
        database.execute("SET TimeZone = 'Europe/Rome'")
        database.execute(VIEWS.replace("SET TimeZone = 'UTC';", ""))
        by_computer = count_in(database, late)
        database.execute(VIEWS)
        by_utc = count_in(database, late)
        joints = database.sql("SELECT start, joint FROM joints ORDER BY start").df()
    rows = open_runs("runs").samples(start="2026-11-26T06:31:00")
    assert by_utc == len(rows) != by_computer
    joined = pd.merge_asof(rows.sort_values("time"), joints, left_on="time", right_on="start")
    assert len(joined) == len(rows)


def test_both_pages_give_the_same_times_of_shifts(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(bench)
    (in_sql,) = re.findall(r"`(start AT TIME ZONE [^`]+)`", SQL_PAGE)
    (in_pandas,) = re.findall(r"`(joints\S+tz_convert[^`]+)`", PYTHON_PAGE)
    with duckdb.connect() as database:
        database.execute(VIEWS)
        by_sql = database.sql(f"SELECT {in_sql} AS start FROM joints ORDER BY start").df()["start"]
    joints = open_runs("runs").joints().sort_values("start")
    by_pandas = eval(in_pandas, {"joints": joints}).dt.tz_localize(None)
    assert by_pandas.iloc[0].isoformat()[:16] == "2026-11-24T07:30"  # 06:30 UTC
    assert [*by_sql] == [*by_pandas]


def test_a_run_of_0_1_0_is_not_of_this_schema(
    capability: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(capability)
    with duckdb.connect() as database, pytest.raises(duckdb.Error, match="setpoint_c"):
        database.execute(VIEWS)


def test_a_copy_counts_twice_in_sql_only(
    bench: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = min((bench / "runs").iterdir())
    for name in (run.name, f"backup of {run.name}"):
        shutil.copytree(run, tmp_path / "runs" / name)
    monkeypatch.chdir(tmp_path)
    joints = open_runs("runs").joints()
    with duckdb.connect() as database:
        database.execute(VIEWS)
        assert count_in(database, "joints") == 2 * len(joints)
