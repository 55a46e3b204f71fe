"""Two runs side by side: what differs is told, what does not is not, and sameness is tested."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from typer.testing import Result

from jbclog.analysis import compare_words, spc
from jbclog.analysis.compare import Comparison, compare
from jbclog.analysis.run import open_run
from jbclog.core.errors import RecordError, UsageError
from jbclog.record.manifest import read_manifest, write_manifest
from support.faults.hostile_names import HOSTILE, MOVES
from support.invoked import invoked
from support.records import few_rows, small_run
from support.records.many_runs import one_run, told
from support.records.sealed_run import RECIPE, limit

ROWS = 6400


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs: the first two alike, the third 6 °C off and with another recipe, limit and
    operator.
    """
    out = tmp_path_factory.mktemp("runs")
    for number in (0, 1):
        one_run(
            out,
            number,
            rows=ROWS,
            settings=[limit("high", "380")],
            metadata=told(operator="A. Rossi"),
        )
    other = RECIPE.replace("revision = 7", "revision = 8").replace("idle_sd_c = 5", "idle_sd_c = 3")
    one_run(
        out,
        2,
        6.0,
        rows=ROWS,
        recipe=other,
        settings=[limit("high", "400")],
        metadata=told(operator="B. Bianchi"),
    )
    return out


def test_of_many_settings_that_differ_some_are_printed_and_all_are_in_json(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, last = runs(home)[0], runs(home)[2]
    assert "alarm_high_limit" in "".join(invoked("compare", first, last).stdout)
    monkeypatch.setattr(compare_words, "MOST_SETTINGS", 0)
    ended = invoked("compare", first, last)
    assert "and 1 more; --json lists all" in ended.stdout
    assert "alarm_high_limit" not in ended.stdout
    assert "alarm_high_limit" in invoked("compare", first, last, "--json").stdout


def runs(home: Path) -> list[Path]:
    return sorted(path for path in home.iterdir() if path.is_dir())


@cache
def compared(home: Path, first: int, second: int, margin: float = 2.0) -> Comparison:
    return compare(open_run(runs(home)[first]), open_run(runs(home)[second]), margin)


def on_line(*words: str | Path) -> Result:
    return invoked("compare", *words)


def test_two_that_are_alike_differ_in_nothing_and_idle_the_same(home: Path) -> None:
    found = compared(home, 0, 1)
    assert (found.facts, found.recipe, len(found.settings), len(found.alarms)) == ([], [], 0, 0)
    (idle,) = found.idle
    assert isinstance(idle.result, spc.Equivalence)
    assert idle.result.verdict == "equivalent"
    assert abs(idle.result.difference) < 0.5


def test_differences_are_listed(home: Path) -> None:
    found = compared(home, 0, 2)
    assert [(one.what, one.first, one.second) for one in found.facts] == [
        ("operator", "A. Rossi", "B. Bianchi")
    ]
    changed = [line for line in found.recipe if line[:1] in "+-" and line[:3] not in ("+++", "---")]
    assert changed == ["-revision = 7", "+revision = 8", "-idle_sd_c = 5", "+idle_sd_c = 3"]
    (setting,) = found.settings.to_dict("records")
    assert (setting["setting"], setting["first"], setting["second"]) == (
        "alarm_high_limit",
        "380",
        "400",
    )
    metrics = found.metrics.set_index("metric")
    assert metrics.loc["idle_error_c", "difference"] == pytest.approx(6, abs=0.5)
    (idle,) = found.idle
    assert isinstance(idle.result, spc.Equivalence)
    assert (idle.result.verdict, round(idle.result.difference)) == ("different", 6)
    assert compared(home, 0, 2, 10.0).idle[0].result.verdict == "equivalent"  # type: ignore[union-attr]  # as above


def test_the_other_way_round_the_signs_are_the_other_way_round(home: Path) -> None:
    there, back = compared(home, 0, 2), compared(home, 2, 0)
    assert there.metrics["difference"].dropna().tolist() == pytest.approx(
        (-back.metrics["difference"]).dropna().tolist()
    )


def test_stations_of_only_one_run_are_listed(home: Path, tmp_path: Path) -> None:
    found = compare(open_run(runs(home)[0]), open_run(small_run.make_run(tmp_path, 20.0)))
    assert ("station ale-1", "not recorded", "recorded") in [
        (one.what, one.first, one.second) for one in found.facts
    ]
    assert found.alarms["second"].sum() > 0
    assert set(found.alarms["first"]) == {0}


def at_rate(folder: Path, hz: float | None) -> Path:
    """The run, as if its station had been sampled so often (None: without pause)."""
    manifest = read_manifest(folder)
    stations = [
        replace(facts, period_s=None if hz is None else 1 / hz) for facts in manifest.stations
    ]
    write_manifest(folder, replace(manifest, stations=stations))
    return folder


@pytest.mark.parametrize(("hz", "other"), [(5.0, "5 Hz"), (None, "max"), (0.4, "0.4 Hz")])
def test_runs_that_were_not_sampled_as_often_are_warned_of(
    home: Path, tmp_path: Path, hz: float | None, other: str
) -> None:
    slower = at_rate(one_run(tmp_path, 9, rows=150), hz)
    found = compare(open_run(runs(home)[0]), open_run(slower))
    (warning,) = found.warnings
    assert warning.startswith(f"dde-1: sampled at 10 Hz and at {other}; results (joints")
    assert ("dde-1 rate", "10 Hz", other) in [
        (one.what, one.first, one.second) for one in found.facts
    ]


def test_the_warning_is_printed_and_in_the_json(home: Path, tmp_path: Path) -> None:
    slower = at_rate(one_run(tmp_path, 9, rows=150), 5.0)
    (warning,) = compare(open_run(runs(home)[0]), open_run(slower)).warnings
    told_ = on_line(runs(home)[0], slower)
    assert f"warning: {warning}" in told_.stdout
    assert json.loads(on_line(runs(home)[0], slower, "--json").stdout)["warnings"] == [warning]


def test_runs_that_were_sampled_alike_are_not(home: Path) -> None:
    assert compared(home, 0, 2).warnings == []
    assert "warning" not in on_line(*runs(home)[:2]).stdout


def test_a_short_run_is_not_called_the_same(home: Path, tmp_path: Path) -> None:
    found = compare(open_run(runs(home)[0]), open_run(one_run(tmp_path, 9, rows=150)))
    assert isinstance(found.idle[0].result, spc.Refused)


def test_only_runs_that_have_ended_are_compared(home: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="not sealed"):
        compare(open_run(runs(home)[0]), open_run(few_rows.abandoned(tmp_path)))
    with pytest.raises(UsageError, match="margin"):
        compared(home, 0, 1, -2.0)


def test_on_the_command_line(home: Path, tmp_path: Path) -> None:
    one, two, three = runs(home)
    told_ = on_line(one, three, "--plot", tmp_path / "both.png")
    assert told_.exit_code == 0, told_.stderr
    for text in (
        "operator: A. Rossi | B. Bianchi",
        "+revision = 8",
        "alarm_high_limit: 380 | 400 °C",
        "different: +",
    ):
        assert text in told_.stdout
    assert (tmp_path / "both.png").read_bytes()[:4] == b"\x89PNG"
    assert "The recipes are the same." in on_line(one, two).stdout
    assert (on_line(one, tmp_path).exit_code, on_line(one, two, "--plot", "x.doc").exit_code) == (
        2,
        2,
    )


def test_as_json(home: Path) -> None:
    one, _, three = runs(home)
    found = json.loads(on_line(one, three, "--json").stdout)
    assert found["idle"][0]["verdict"] == "different"
    assert {row["metric"] for row in found["metrics"]} >= {"idle_error_c", "recovery_s"}
    assert [row["first"] for row in found["metrics"] if row["metric"] == "energy_j"] == [None]
    assert found["settings"][0]["second"] == "400"


def test_hostile_texts_do_not_steer_the_terminal(home: Path, tmp_path: Path) -> None:
    names = (
        "colour",
        "bidi",
        "script",
        "line of its own",
        "title of the window",
        "markup",
        "formula of a figure",
    )
    texts = [HOSTILE[name] for name in names]
    said = told(operator=" ".join([*texts, "the last one"]), tips=texts)
    other = one_run(
        tmp_path, 5, rows=150, metadata=said, recipe="".join(f"# {text}\n" for text in texts)
    )
    ended = on_line(runs(home)[0], other)
    assert ended.exit_code == 0
    assert "the last one" in ended.stdout
    assert not MOVES.search(ended.stdout + ended.stderr)
