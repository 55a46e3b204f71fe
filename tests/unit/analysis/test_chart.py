"""Charts within a run and over runs, and limits that are learnt once and cited."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pandas as pd
import pytest

from jbclog.analysis import spc
from jbclog.analysis.chart_words import lines
from jbclog.analysis.charts import (
    Fixed,
    Series,
    charted,
    joined,
    joint_metrics,
    series_of_run,
)
from jbclog.analysis.control_limits import learn
from jbclog.analysis.count_charts import loss_counts, ranked
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.spc.refusal import there_are
from jbclog.record.manifest import read_manifest, write_manifest
from support.invoked import invoked
from support.records.many_runs import many_runs, one_run

STEADY = np.random.default_rng(15).lognormal(0.3, 0.5, 60)


def made(values: list[float], port: int = 1) -> Series:
    return Series(
        "dde-1",
        port,
        "dwell_s",
        "s",
        "joint",
        np.array(values),
        [f"joint {n}" for n in range(1, len(values) + 1)],
    )


def joints(values: list[float]) -> pd.DataFrame:
    """The joints of a port, whose dwell is these values."""
    rows = [
        dict.fromkeys(JOINTS_SCHEMA.names) | {"station": "dde-1", "port": 1, "joint": n}
        for n in range(1, len(values) + 1)
    ]
    table = pd.DataFrame(rows)
    return table.assign(dwell_s=pd.array(values, dtype="Float64"))


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return one_run(tmp_path_factory.mktemp("runs"), 0)


@pytest.fixture
def dwells(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the joints of every run dwell, until a test says otherwise: what is made of joints is
    looked at, not their finding.
    """
    values = list(STEADY)
    monkeypatch.setattr(Run, "joints", lambda _, station=None: joints(values))
    return values


def test_a_chart_within_a_run(home: Path, dwells: list[float]) -> None:
    dwells[40] = 30.0
    ended = invoked("chart", home, "-m", "dwell_s")
    assert ended.exit_code == 0
    assert "dde-1 port 1  dwell_s  60 joints" in ended.stdout
    assert "joint 41: test 1: one point beyond three sigma" in ended.stdout
    assert (
        "0.87 false alarms in 100 points, the first after 118 on average; 53 % of series of 100"
        " have one" in ended.stdout
    )
    assert "1.5 false alarms" in invoked("chart", home, "-m", "dwell_s", "--all-tests").stdout


def test_a_joint_without_the_metric_is_counted_and_no_point(
    home: Path, dwells: list[float]
) -> None:
    dwells[3] = np.nan
    (series,) = series_of_run(open_run(home), "dwell_s")
    assert (len(series.values), series.missing, series.names[3]) == (59, 1, "joint 5")


def test_capability_of_a_skewed_feature_is_given_with_its_distribution(
    home: Path, dwells: list[float]
) -> None:
    assert "lognormal" in invoked("chart", home, "-m", "dwell_s", "--upper", "9").stdout
    found = json.loads(invoked("chart", home, "-m", "dwell_s", "--upper", "9", "--json").stdout)
    (one,) = found["charts"]
    again = spc.capability(STEADY, upper=9)
    assert isinstance(again, spc.Capability)
    assert one["capability"]["ppk"]["bound"] == pytest.approx(again.ppk.bound, rel=1e-11)
    assert one["charts"][0]["false_alarms"]["run_length"] == 118.0


def test_every_kind_of_values(home: Path, dwells: list[float], tmp_path: Path) -> None:
    dwells[:] = list(np.random.default_rng(16).normal(2, 0.2, 123))
    dwells[100:] = [value + 0.3 for value in dwells[100:]]
    for kind, said in (
        ("ewma", "EWMA"),
        ("cusum", "CUSUM up"),
        ("xbar-s", "subgroup standard deviations"),
    ):
        ended = invoked(
            "chart", home, "-m", "dwell_s", "-k", kind, "--plot", tmp_path / f"{kind}.svg"
        )
        assert (ended.exit_code, ended.exception) == (0, None)
        assert f"  {said}: centre" in ended.stdout
        assert (tmp_path / f"{kind}.svg").stat().st_size > 5000
    assert "The last 3 of 123 values fill no subgroup of 5" in ended.stdout
    few = invoked("chart", home, "-m", "dwell_s", "-k", "xbar-s", "--size", "10").stdout
    assert "There are 12 subgroups; it takes at least 20." in few


def test_a_shift_shows_in_sums_before_it_shows_in_values() -> None:
    values = np.random.default_rng(17).normal(0, 1, 60)
    values[30:] += 1.0
    fixed = Fixed("dde-1", 1, 0.0, -3.0, 3.0, "normal", 100)
    found = charted(made(list(np.where(np.arange(60) == 0, 0.0, values))), "cusum", fixed=fixed)
    if isinstance(found.charts, spc.Refused):
        # its own limits: the shift makes neighbours alike
        assert found.charts.kind == "autocorrelated"
    assert [one.last for one in spc.cusum(values, centre=0, sigma=1)[0].signals]


def test_limits_are_learnt_kept_and_cited(home: Path, dwells: list[float], tmp_path: Path) -> None:
    file = tmp_path / "dwell.json"
    learnt = invoked("limits", "learn", home, "-m", "dwell_s", "--out", file)
    assert (learnt.exit_code, learnt.exception) == (0, None)
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    assert f"SHA-256 {sha256}" in learnt.stdout
    assert invoked("limits", "show", file).stdout == learnt.stdout
    document = json.loads(file.read_bytes())
    assert document["sources"][0]["run"] == home.name
    chart = spc.phase_one(STEADY)
    assert isinstance(chart, spc.Chart)
    assert (document["limits"][0]["upper"], document["limits"][0]["distribution"]) == (
        chart.upper[0],
        "lognormal",
    )
    again = invoked("limits", "learn", home, "-m", "dwell_s", "--out", file)
    assert (again.exit_code, "exists; charts cite" in again.stderr) == (2, True)
    # later, everything takes four times as long: no signal by its own limits
    dwells[:] = [value * 4 for value in dwells]
    later = json.loads(invoked("chart", home, "-m", "dwell_s", "--limits", file, "--json").stdout)
    assert later["limits_sha256"] == sha256
    assert len(later["charts"][0]["fixed"]["signals"]) > 20
    assert not [one for one in later["charts"][0]["charts"][0]["signals"] if "test 1" in one[1]]
    wrong = invoked("chart", home, "-m", "recovery_s", "--limits", file)
    assert (wrong.exit_code, "the limits are of dwell_s" in wrong.stderr) == (2, True)


def test_a_recovery_that_most_joints_lack_has_no_chart_no_capability_no_limits() -> None:
    few, many = (
        Series(
            "dde-1",
            1,
            "recovery_s",
            "s",
            "joint",
            STEADY,
            [str(n) for n in range(60)],
            late,
            late=late,
        )
        for late in (3, 4)
    )
    kept, refused = charted(few, upper=9), charted(many, upper=9)
    assert not isinstance(kept.charts, spc.Refused)
    assert "3 joints left out: the next one came before the tip was back" in " ".join(lines(kept))
    assert isinstance(refused.charts, spc.Refused)
    assert isinstance(refused.capability, spc.Refused)
    assert "After 4 of 64 joints the next one came before the tip was back." in " ".join(
        lines(refused)
    )
    assert isinstance(learn(many), spc.Refused)
    assert joined([few, many])[0].late == 7


def test_a_port_whose_joints_are_not_known_is_named_with_the_reason(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        ("joints", 0, "Only 2.0 s of the record are without contact."),
        ("power_mean_permille", 900, None),
    ]
    metrics = pd.DataFrame(
        [
            {"station": "dde-1", "port": 1, "metric": name, "n": n, "why": why}
            for name, n, why in rows
        ]
    )
    monkeypatch.setattr(Run, "joints", lambda *_: JOINTS_SCHEMA.empty_table().to_pandas())
    monkeypatch.setattr(Run, "metrics", lambda *_: metrics)
    (series,) = series_of_run(open_run(home), "recovery_s")
    assert (
        "chart: none. Joints are not known: only 2.0 s of the record are without contact."
        in " ".join(lines(charted(series)))
    )
    metrics.loc[0, "why"] = None  # there are none, and that is known
    assert series_of_run(open_run(home), "recovery_s") == []


def test_a_port_whose_number_of_joints_is_not_known_has_no_chart_of_their_dwell(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = "Between 12 and 24 were found."
    rows = [("joints", 24, why), ("power_mean_permille", 900, None)]
    metrics = pd.DataFrame(
        [
            {"station": "dde-1", "port": 1, "metric": name, "n": n, "why": why}
            for name, n, why in rows
        ]
    )
    listed = joints([np.nan] * 24).assign(recovery_s=pd.array([1.5] * 24, dtype="Float64"))
    monkeypatch.setattr(Run, "joints", lambda *_: listed)
    monkeypatch.setattr(Run, "metrics", lambda *_: metrics)
    (series,) = series_of_run(open_run(home), "dwell_s")
    assert "between 12 and 24 were found" in " ".join(lines(charted(series)))
    (series,) = series_of_run(open_run(home), "recovery_s")
    assert len(series.values) == 24


@pytest.mark.parametrize(
    ("count", "text"), [(1, "There is 1 day with alarms"), (0, "There are 0 days with alarms")]
)
def test_one_is_one(count: int, text: str) -> None:
    assert there_are(count, "days with alarms") == text
    assert there_are(1, "stretches") == "There is 1 stretch"
    assert there_are(1, "values") == "There is 1 value"


def test_what_does_not_count_is_no_loss() -> None:
    @dataclass
    class Manifest:
        ledger: dict[str, dict[str, dict[str, dict[str, int]]]]

    @dataclass
    class Record:
        manifest: Manifest

    ledger = {"dde-1": {"1": {"delay_s": {"due": 9, "ok": 3, "not_counting": 5, "timeout": 1}}}}
    assert loss_counts(Record(Manifest(ledger))) == {"dde-1 timeout": 1}  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["ewma", "cusum"])
def test_every_kind_states_its_false_alarms(kind: str) -> None:
    chart = (spc.ewma(np.arange(5.0)),) if kind == "ewma" else spc.cusum(np.arange(5.0))
    generator, lengths = np.random.default_rng(3), []
    for _ in range(60):
        points = generator.normal(size=4000)
        found = (
            (spc.ewma(points, centre=0, sigma=1),)
            if kind == "ewma"
            else spc.cusum(points, centre=0, sigma=1)
        )
        lengths.append(
            min((signal.last for one in found for signal in one.signals), default=3999) + 1
        )
    # 60 of them: 13 % by chance
    assert np.mean(lengths) == pytest.approx(spc.RUN_LENGTHS[chart[0].name], rel=0.45)


def test_what_is_not_stable_teaches_no_limits(
    home: Path, dwells: list[float], tmp_path: Path
) -> None:
    dwells[30:] = [value * 2.5 for value in dwells[30:]]
    ended = invoked("limits", "learn", home, "-m", "dwell_s", "--out", tmp_path / "none.json")
    assert ended.exit_code == 1
    assert "dde-1 port 1: no limits." in ended.stderr
    assert not (tmp_path / "none.json").exists()


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "x"}', "\x00"])
def test_a_file_that_is_none(home: Path, dwells: list[float], tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    ended = invoked("chart", home, "-m", "dwell_s", "--limits", tmp_path / "x.json")
    assert (ended.exit_code, "is not a file of control limits" in ended.stderr) == (4, True)


def test_series_of_several_runs_are_one_behind_the_other() -> None:
    both = joined([made([1.0, 2.0]), made([5.0], port=2), made([3.0])])
    assert [(one.port, list(one.values)) for one in both] == [(1, [1.0, 2.0, 3.0]), (2, [5.0])]
    assert isinstance(learn(both[0]), spc.Refused)


def test_alarms_and_losses_of_a_run(home: Path) -> None:
    ended = invoked("chart", home, "-m", "alarms", "--every", "2s")
    assert ended.exit_code == 0
    assert ended.stdout.startswith("alarms: 0 in 0.00")
    assert "u: centre 0" in ended.stdout
    assert (
        "There is 1 stretch; a chart of counts takes at least 10."
        in invoked("chart", home, "-m", "alarms").stdout
    )
    assert invoked("chart", home, "-m", "losses").stdout.startswith("losses: ")


def test_a_pareto_ranks() -> None:
    found = ranked("losses", {"b timeout": 30, "a timeout": 10, "c bcc": 60})
    assert [(name, count, so_far) for name, count, _, so_far in found.rows] == [
        ("c bcc", 60, 60.0),
        ("b timeout", 30, 90.0),
        ("a timeout", 10, 100.0),
    ]


def test_rejects_by_day(tmp_path: Path) -> None:
    folders = many_runs(tmp_path, [0.0] * 12)
    for number, folder in enumerate(folders):
        manifest = read_manifest(folder)
        day = f"2026-09-{10 + number}T06:00:00.000000Z"
        write_manifest(
            folder, replace(manifest, verdict="REJECT" if number == 4 else "ACCEPT", start=day)
        )
    found = json.loads(invoked("chart", tmp_path, "-m", "rejects", "--json").stdout)["charts"][0]
    assert (sum(found["counts"]), sum(found["sizes"]), found["names"][4]) == (
        1.0,
        12.0,
        "2026-09-14",
    )
    assert found["chart"]["centre"] == pytest.approx(1 / 12)


@pytest.mark.parametrize("metric", ["idle_error_c", "rejects", "alarms", "losses"])
def test_a_run_that_several_folders_have_counts_once(tmp_path: Path, metric: str) -> None:
    first, *_ = many_runs(tmp_path, [0.0] * 3)
    write_manifest(first, replace(read_manifest(first), verdict="REJECT"))
    alone = invoked("chart", tmp_path, "-m", metric, "--json")
    assert (alone.exit_code, "counts" in alone.stderr) == (0, False)
    copytree(first, tmp_path / "a copy")
    found = invoked("chart", tmp_path, "-m", metric, "--json")
    assert json.loads(found.stdout) == json.loads(alone.stdout)
    said = f"a copy has the same run as {first.name} (the same manifest); only {first.name} counts"
    assert said in found.stderr


def test_limits_are_not_learnt_of_a_run_that_is_given_twice(
    home: Path, dwells: list[float], tmp_path: Path
) -> None:
    copy, out = copytree(home, tmp_path / "a copy"), tmp_path / "none.json"
    for twice in (copy, home):
        ended = invoked("limits", "learn", home, twice, "-m", "dwell_s", "--out", out)
        assert (ended.exit_code, "give each run once" in ended.stderr) == (2, True)
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-m", "dwel_s"), "did you mean dwell_s"),
        (("-k", "u"), "--kind u"),
        (("-m", "alarms", "-k", "imr"), "--kind imr"),
        (("-m", "rejects"), "give a folder of runs"),
        (("-m", "alarms", "--every", "x"), "--every x"),
        (("-m", "alarms", "--upper", "3"), "are counts"),
        (("--plot", "x.exe"), ".png"),
        (("--lower", "5", "--upper", "5"), "must be below"),
    ],
)
def test_wrong_usage(home: Path, words: tuple[str, ...], said: str) -> None:
    ended = invoked("chart", home, *words)
    assert (ended.exit_code, said in ended.stderr) == (2, True)


def test_a_metric_is_any_number_of_a_joint() -> None:
    assert joint_metrics()["dwell_s"] == "s"
    assert "confidence" not in joint_metrics()
