"""A metric over many runs: points, chart, capability, refusals as sentences, and how it is told."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from typer.testing import Result

from jbclog.analysis import run_metrics, spc
from jbclog.analysis.derived_files import MetricRow
from jbclog.analysis.run import Run
from jbclog.analysis.runs import open_runs
from jbclog.analysis.trend import metric_unit, title_of, trends
from jbclog.core.errors import UsageError
from jbclog.record.manifest import NAME, read_manifest, write_manifest
from support.invoked import invoked
from support.records.many_runs import many_runs, one_run, told

STEADY = list(np.random.default_rng(5).normal(1.5, 0.8, 30))


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty runs whose idle errors are stable and normal."""
    out = tmp_path_factory.mktemp("runs")
    many_runs(out, STEADY)
    return out


@pytest.fixture(scope="module", autouse=True)
def _measured_once() -> Iterator[None]:
    """A sealed run is measured once for all tests: they are of what is made of the figures, not of
    the measuring.
    """
    measure, kept = run_metrics.metric_rows_of, dict[tuple[bytes, str | None], list[MetricRow]]()

    def once(run: Run, station: str | None = None) -> list[MetricRow]:
        manifest = (run.folder / NAME).read_bytes()  # it holds the digests of all that is measured
        if (manifest, station) not in kept:
            kept[manifest, station] = measure(run, station)
        return list(kept[manifest, station])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_metrics, "metric_rows_of", once)
        yield


def trend(*words: str | Path) -> Result:
    return invoked("trend", *words)


def test_a_point_is_a_runs_metric_in_the_order_of_the_runs(home: Path) -> None:
    (found,) = trends(open_runs(home))
    assert (found.station, found.port, found.metric, found.uom) == (
        "dde-1",
        1,
        "idle_error_c",
        "°C",
    )
    assert len(found.points) == 30
    assert [one.run for one in found.points] == sorted(one.run for one in found.points)
    own = open_runs(home)[7].metrics().set_index("metric").loc["idle_error_c", "value"]
    assert found.points[7].value == own
    # whole degrees, dithered; noise of the readings
    assert found.values == pytest.approx(STEADY, abs=0.5)


def test_chart_and_capability_are_those_of_spc(home: Path) -> None:
    (found,) = trends(open_runs(home), lower=-15, upper=15)
    chart, index = found.chart, found.capability
    assert isinstance(chart, tuple)
    assert isinstance(index, spc.Capability)
    step = float(np.median([one.resolution for one in found.points if one.resolution is not None]))
    expected = spc.control_chart(found.values, resolution=step)
    assert isinstance(expected, tuple)
    assert chart[0].centre == expected[0].centre
    again = spc.capability(found.values, lower=-15, upper=15, resolution=step)
    assert isinstance(again, spc.Capability)
    assert index.cpk.bound == again.cpk.bound


def test_a_run_that_is_off_is_a_signal_with_its_name(home: Path, tmp_path: Path) -> None:
    copytree(home, tmp_path, dirs_exist_ok=True)
    one_run(tmp_path, 40, 14.0)
    (found,) = trends(open_runs(tmp_path))
    assert (found.points[-1].run, "test 1: one point beyond three sigma") in found.signals
    assert f"{found.points[-1].run}: test 1" in trend(tmp_path).stdout


def test_a_run_that_several_folders_have_counts_once(tmp_path: Path) -> None:
    first, _ = many_runs(tmp_path, [0.0, 1.0])
    (alone,) = trends(open_runs(tmp_path))
    assert (len(alone.points), alone.warnings) == (2, [])
    names = ("0 copy", "a copy")  # before and behind the name of the run
    for name in names:
        copytree(first, tmp_path / name)
    (found,) = trends(open_runs(tmp_path))
    assert found.points == alone.points
    assert found.warnings == [
        f"{tmp_path / name} has the same run as {first.name} (the same manifest); only"
        f" {first.name} counts"
        for name in names
    ]
    assert f"  warning: {found.warnings[0]}" in trend(tmp_path).stdout
    told = json.loads(trend(tmp_path, "--json").stdout)
    assert (told["runs"], told["trends"][0]["warnings"]) == (2, found.warnings)


def test_a_copy_with_other_contents_is_named_first_and_does_not_count(tmp_path: Path) -> None:
    first, _ = many_runs(tmp_path, [0.0, 1.0])
    (alone,) = trends(open_runs(tmp_path))
    forged = one_run(tmp_path, 2, 14.0).rename(tmp_path / "forged")
    write_manifest(forged, replace(read_manifest(forged), run=first.name))
    copytree(first, tmp_path / "a copy")
    (found,) = trends(open_runs(tmp_path))
    assert found.points == alone.points
    assert found.warnings[0] == (
        f"{forged} has the same run as {first.name} (another manifest); only {first.name} counts"
    )
    assert "(the same manifest)" in found.warnings[1]
    # a run that has lost its name: the first folder by name counts
    first.rename(tmp_path / "moved")
    (found,) = trends(open_runs(tmp_path))
    assert {point.run for point in found.points} == {alone.points[1].run, "a copy"}
    assert {text.split(" has ")[0] for text in found.warnings} == {
        str(tmp_path / name) for name in ("forged", "moved")
    }


def test_of_many_copies_ten_are_named(tmp_path: Path) -> None:
    (first,) = many_runs(tmp_path, [0.0])
    for number in range(12):
        copytree(first, tmp_path / f"copy {number}")
    (found,) = trends(open_runs(tmp_path))
    assert (len(found.points), len(found.warnings)) == (1, 11)
    assert found.warnings[-1].startswith("2 more folders have runs that another folder has;")


def test_what_would_mislead_is_refused_in_a_sentence(home: Path, tmp_path: Path) -> None:
    few = trend(home, "--upper", "15", "--until", "2026-09-21T10:00")
    assert few.exit_code == 0
    assert "chart: none. There are 4 values; it takes at least 20." in few.stdout
    assert "capability: none. There are 4 values; it takes at least 30." in few.stdout
    many_runs(tmp_path, list(np.linspace(-4, 4, 20)))
    assert "chart: none. Neighbouring values are alike" in trend(tmp_path).stdout
    assert "chart: none. The values come in steps" in trend(tmp_path, "-m", "recovery_s").stdout


def test_a_mean_of_readings_that_do_not_spread_shows_no_less_than_their_step(
    tmp_path: Path,
) -> None:
    for number in range(3):
        one_run(tmp_path, number, still=number == 0)
    (found,) = trends(open_runs(tmp_path))
    assert found.points[0].resolution == 1.0
    assert found.points[1].resolution == pytest.approx(1 / found.points[1].n ** 0.5)


def test_a_run_without_the_metric_is_no_point_and_is_counted_with_its_reason(
    tmp_path: Path,
) -> None:
    many_runs(tmp_path, STEADY[:3])
    one_run(tmp_path, 5, rows=20)  # two seconds: never idle
    (found,) = trends(open_runs(tmp_path))
    assert ([one.value is None for one in found.points], len(found.values)) == (
        [False, False, False, True],
        3,
    )
    assert re.search(r"no value in 1 run: \S", trend(tmp_path).stdout)


def test_runs_that_were_not_sampled_as_often_are_warned_of(tmp_path: Path) -> None:
    folders = many_runs(tmp_path, STEADY[:4])
    assert trends(open_runs(tmp_path))[0].warnings == []
    manifest = read_manifest(folders[2])
    write_manifest(
        folders[2],
        replace(manifest, stations=[replace(facts, period_s=0.2) for facts in manifest.stations]),
    )
    (found,) = trends(open_runs(tmp_path))
    (warning,) = found.warnings
    assert warning.startswith("rates differ: 10 Hz in 3 runs, 5 Hz in 1 run; results (joints")
    assert f"  warning: {warning}" in trend(tmp_path).stdout
    assert json.loads(trend(tmp_path, "--json").stdout)["trends"][0]["warnings"] == [warning]


def test_changes_of_recipe_and_tip_are_listed(tmp_path: Path) -> None:
    for number, tip in enumerate(("dde-1:1=T-1", "dde-1=T-1", "T-2")):
        one_run(tmp_path, number, metadata=told(tips=[tip]))
    (found,) = trends(open_runs(tmp_path))
    assert [change.partition(": ")[2] for change in found.changes] == [
        "the tip is T-2, before it was T-1"
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-m", "idle_eror"), "did you mean idle_error_c"),
        (("--lower", "5", "--upper", "5"), "must be below"),
        (("--upper", "nan"), "must be a finite number"),
        (("--plot", "x.exe"), ".png"),
    ],
)
def test_wrong_usage(home: Path, words: tuple[str, ...], said: str) -> None:
    ended = trend(home, *words)
    assert (ended.exit_code, said in ended.stderr) == (2, True)


def test_json_has_points_chart_and_refusals(home: Path) -> None:
    found = json.loads(trend(home, "--json", "--upper", "15").stdout)
    (one,) = found["trends"]
    assert (found["runs"], one["n"], len(one["points"])) == (30, 30, 30)
    assert one["points"][0].keys() == {
        "run",
        "start",
        "value",
        "n",
        "coverage",
        "resolution",
        "why",
    }
    assert one["capability"]["cp"] is None
    assert (
        json.loads(trend(home, "--json", "-m", "energy_j").stdout)["trends"][0]["chart"]["refused"][
            "kind"
        ]
        == "too_few"
    )


def test_filters_leave_runs_out(home: Path) -> None:
    assert "no run has" in trend(home, "--order", "none").stderr
    assert json.loads(trend(home, "--json", "--since", "2026-09-22").stdout)["runs"] == 12
    assert json.loads(trend(home, "--json", "--port", "2").stdout)["trends"] == []


def test_picture_and_page_are_written_and_the_same_again(home: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        ended = trend(
            home,
            "--plot",
            tmp_path / f"{name}.png",
            "--html",
            tmp_path / f"{name}.html",
            "--upper",
            "15",
        )
        assert ended.exit_code == 0, ended.stderr
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert page == (tmp_path / "b.html").read_text(encoding="utf-8")
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert page.count("<tr>") == 31
    assert not re.search(r"(src|href|url)\s*[=(]\s*[\"']?https?:", page)


def test_every_metric_has_a_unit_and_a_title() -> None:
    assert metric_unit("recovery_s") == "s"
    assert [title_of(name) for name in ("recovery_s", "joint_energy_permille_s")] == [
        "recovery",
        "joint energy",
    ]
    with pytest.raises(UsageError):
        metric_unit("goodness")
    assert "recovery_p95_s" in trend("x", "-m", "list").stdout
