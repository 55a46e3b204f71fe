"""A run that does not start leaves its record: sealed, with what was to run, who wanted it, and why
it did not.
"""

from __future__ import annotations

import json
import os
import pty
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.product import (
    FoundRun,
    LineFormat,
    Metadata,
    RecordError,
    RunFilter,
    RunPlan,
    RunResult,
    StartRefused,
    check_run,
    conduct_run,
    find_runs,
    open_port,
    patch,
    read_manifest,
    row_groups_of,
)
from support.records.few_rows import table
from support.virtual.recorded_run import Nobody, RecordedRun, plan_in
from support.virtual.virtual_run import RECIPE, line_text

SAID = Metadata("A. Rossi", "88123", units=("SN-1",), tags={"shift": "1"})


def plan_of(folder: Path, line: str, recipe: str = RECIPE, **wanted: object) -> RunPlan:
    return plan_in(folder, line, recipe, 2.0, metadata=SAID, **wanted)


def expect_record(result: RunResult, outcome: str, *words: str) -> None:
    """The record of a start that failed, as it is found again."""
    manifest = read_manifest(result.folder)
    assert result.exit_code == 3
    assert (manifest.state, manifest.exit_status, manifest.exit_code) == ("sealed", "failed", 3)
    assert check_run(result.folder) == []
    (station,) = manifest.stations
    assert station.outcome == outcome
    assert all(word in station.reason for word in words), station.reason
    assert next(row_groups_of(result.folder, "samples"), None) is None
    events = table(result.folder, "events")
    assert f"station.{outcome}" in events["kind"].to_pylist()
    assert events["time"].to_pylist() == sorted(events["time"].to_pylist())
    (found,) = find_runs(
        result.folder.parent,
        RunFilter(order="88123", unit="SN-1", state="ended with error", tags={"shift": "1"}),
    )
    assert isinstance(found, FoundRun)
    assert found.folder == result.folder


# -- what a station does not let happen ------------------------------------------------------------

REFUSED = {
    "the recipe is above what the station takes": (
        "settings = {maximum_temperature = 340}",
        "",
        RECIPE,
        "maximum of 340 °C",
    ),
    "a tool that never cools": (
        "settings = {sleep_delay = 'off'}",
        "",
        RECIPE.replace("[sleep]\ndelay_min = 5", ""),
        "never cools",
    ),
    "robot mode is off": ("robot_mode = false", "", RECIPE, "Robot mode is off"),
    "another model": ('model = "NAE"', "", RECIPE, "model NAE"),
    "no tool": ("tool = 0", "", RECIPE, "no tool in port 1"),
    "a setting is refused": (
        (
            '[[station.sim.fault]]\nkind = "nak"\ncode = 3\ncommand = "alarm_high_limit"\nonly ='
            ' "write"'
        ),
        "",
        RECIPE,
        "requested 380 °C, but ",
    ),
}


@pytest.mark.parametrize(("sim", "keys", "recipe", "words"), REFUSED.values(), ids=REFUSED)
def test_a_station_that_does_not_fit(
    tmp_path: Path, sim: str, keys: str, recipe: str, words: str
) -> None:
    plan = plan_of(tmp_path, line_text(sim, keys), recipe)
    expect_record(RecordedRun(plan, tmp_path / "runs").result, "refused", words)


def test_a_rate_that_the_station_turns_out_too_slow_for(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, line_text().replace("turnaround_ms = 1.0", "turnaround_ms = 60.0"))
    expect_record(RecordedRun(plan, tmp_path / "runs").result, "refused", "10 Hz does not fit")


def test_a_station_that_does_not_answer(tmp_path: Path) -> None:
    plan = plan_of(
        tmp_path, line_text('[[station.sim.fault]]\nkind = "dropout"\nat_s = 0\nfor_s = 100')
    )
    expect_record(RecordedRun(plan, tmp_path / "runs").result, "gone")


# -- what this machine does not let happen ---------------------------------------------------------


def line_at(url: str) -> str:
    return (
        f'[line]\nname = "l"\n[[station]]\nname = "dde-1"\nurl = {json.dumps(url)}\nfamily ='
        ' "dde"\n'
    )


@contextmanager
def taken() -> Iterator[str]:
    """A terminal that somebody else has open for himself."""
    ours, theirs = pty.openpty()
    name = os.ttyname(theirs)
    port = open_port(name, LineFormat())
    yield name
    port.close()
    os.close(ours)
    os.close(theirs)


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, line_at(str(tmp_path / "nowhere")), guard=False)
    expect_record(conduct_run(plan, tmp_path / "runs", Nobody()), "gone", "nowhere")


def test_a_server_that_is_not_there(tmp_path: Path) -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        plan = plan_of(
            tmp_path, line_at(f"socket://127.0.0.1:{bound.getsockname()[1]}"), guard=False
        )
        expect_record(conduct_run(plan, tmp_path / "runs", Nobody()), "gone")


def test_a_port_that_another_program_has(tmp_path: Path) -> None:
    with taken() as name:
        plan = plan_of(tmp_path, line_at(name), guard=False)
        expect_record(conduct_run(plan, tmp_path / "runs", Nobody()), "gone", "in use by")


def test_a_port_that_another_run_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "runs" / "20261121T013000Z-hand-k7qd"
    patch(monkeypatch, "port_owner.runs_that_hold", lambda urls: [other])
    patch(monkeypatch, "port_owner.holds", lambda run, urls: True)
    plan = plan_of(tmp_path, line_at(str(tmp_path / "nowhere")))
    expect_record(
        conduct_run(plan, tmp_path / "mine", Nobody()),
        "refused",
        f"the run {other} holds this port",
        "nothing was sent",
    )


def test_the_others_of_its_line_were_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "port_owner.runs_that_hold", lambda urls: [tmp_path])
    patch(monkeypatch, "port_owner.holds", lambda run, urls: urls[0].endswith("a"))
    line = line_at("a") + '[[station]]\nname = "dde-2"\nurl = "b"\nfamily = "dde"\n'
    result = conduct_run(plan_of(tmp_path, line), tmp_path / "mine", Nobody())
    one, two = result.manifest.stations
    assert "holds this port" in one.reason
    assert two.reason == "dde-2: not asked, for the run was not started"


def test_a_guard_that_does_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def start(*_: object) -> None:
        raise StartRefused(
            "the guard could not be started (no more processes); --no-guard runs without one"
        )

    patch(monkeypatch, "RunGuard.start", start)
    plan = plan_of(tmp_path, line_at(str(tmp_path / "nowhere")))
    result = conduct_run(plan, tmp_path / "runs", Nobody())
    expect_record(result, "refused", "--no-guard")
    assert result.manifest.guard == "none"


def test_what_has_no_place_for_a_record_leaves_none_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(RecordError, match="cannot hold a record"):
        conduct_run(plan_of(tmp_path, line_at("nowhere")), tmp_path / "runs", Nobody())
