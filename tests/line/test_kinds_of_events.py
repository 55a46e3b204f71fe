"""Kinds of events that no other test of whole runs names: how a station ended, series of lost
readings, and what an OMEGA says besides its errors.
"""

from __future__ import annotations

import pytest

from support.product import Severity, before_each_value
from support.virtual.lines import fault
from support.virtual.virtual_run import VirtualRun, line_text, prepare

OMEGA_LINE = (
    '[line]\nname = "test"\n[[station]]\nname = "omega-1"\nurl = "omega-1"\nfamily = "omega"\n'
    "[station.sim]\n{sim}\n"
)
OMEGA_RECIPE = '[recipe]\nname = "test"\nrevision = 1\nfamilies = ["omega"]\n'


def omega(sim: str) -> VirtualRun:
    return prepare(OMEGA_LINE.format(sim=sim), OMEGA_RECIPE, duration_s=10)


def endings(run: VirtualRun) -> list[tuple[str, Severity]]:
    return [
        (event.kind, event.severity)
        for event in run.memory.events
        if event.kind == f"station.{run.facts.outcome}"
    ]


def test_a_run_that_is_ended_early_completes_each_station() -> None:
    run = prepare(line_text(), duration_s=60)
    run.at(5, lambda: run.driver.end("ended by SIGINT"))
    run.go()
    assert endings(run) == [("station.completed", Severity.INFO)]


def test_a_setting_that_somebody_changes_stops_the_station() -> None:
    run = prepare(duration_s=60)
    run.at(5, lambda: setattr(run.station.plant.ports[1].settings, "selected_temperature", 300))
    run.go()
    assert endings(run) == [("station.stopped", Severity.ERROR)]


def test_an_internal_error_fails_the_station(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ZeroDivisionError("injected")

    before_each_value(monkeypatch, broken)
    run = prepare(duration_s=5).go()
    assert endings(run) == [("station.failed", Severity.ERROR)]


@pytest.mark.parametrize(
    ("trouble", "kind"),
    [
        (fault("silence", command="power", at_s=5, for_s=3), "read.timeout"),
        (fault("flip", command="power", at_s=5, for_s=3, bits=1), "read.bcc"),
    ],
)
def test_a_series_of_lost_readings_is_one_event_a_port(trouble: str, kind: str) -> None:
    run = prepare(line_text(trouble), duration_s=12).go()
    events = run.memory.of_kind(kind)
    assert sorted(event.port or 0 for event in events) == [1, 2]
    assert {event.severity for event in events} == {Severity.WARNING}


def test_a_control_unit_that_was_preparing_is_ready() -> None:
    run = omega(fault("not_ready", at_s=2, for_s=4)).go()
    kinds = [event.kind for event in run.memory.events if event.kind.startswith("control")]
    assert kinds == ["control.preparing", "control.ready"]


def test_the_first_stage_of_a_joint_is_an_event() -> None:
    """Manual 003, 11.3.14: the controller sends i by itself."""
    run = omega("turnaround_ms = 20")
    receive, said = run.omega.receive, [b"\x02i\x0369"]

    def with_i(sent: bytes, now: float) -> list[tuple[float, bytes]]:
        replies = [*receive(sent, now)]
        if said and now > run.t0 + 5:
            replies.append((now + 0.3, said.pop()))
        return replies

    run.omega.receive = with_i  # type: ignore[method-assign,assignment]
    run.go()
    (event,) = run.memory.of_kind("omega.first_stage")
    assert event.raw == "i"
