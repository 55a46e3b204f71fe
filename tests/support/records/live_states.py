"""A run as a follower may know it, made up: every condition of a port at once."""

from __future__ import annotations

import math
from pathlib import Path

from jbclog.app.watch.batch_queue import BatchQueue, QueuedJob
from jbclog.core.rows import EventRow, Severity
from jbclog.live import (
    Condition,
    Counter,
    Coverage,
    Joints,
    NumberedEvent,
    Phase,
    PortState,
    Reading,
    RunState,
    Setting,
    StationState,
    Trace,
)

T0_US = 1_790_000_000_000_000
HOSTILE = "[bold]<img src=x onerror=alert(1)>\x1b[31m"


QUEUE = BatchQueue(
    "batch night: 1 of 3 jobs have ended",
    (
        QueuedJob("smd-1", "done", "ACCEPT"),
        QueuedJob("smd-2", "running", "recording, 42 s of 90 s"),
        QueuedJob("smd-3", "waiting", f"after {HOSTILE}"),
    ),
)


def known(value: float | str) -> Reading:
    return Reading(value, 0.3, None, is_stale=False)


def failed(value: float, why: str) -> Reading:
    return Reading(value, 12.0, why, is_stale=False)


def stale(value: float) -> Reading:
    return Reading(value, 95.0, None, is_stale=True)


def trace(depth: float = 0.0, gap: range = range(0), last_s: float = 100.0) -> Trace:
    seconds = tuple(round(last_s - 60 + number / 10, 1) for number in range(601))
    values = [350 - depth * max(math.sin(number / 40), 0) for number in range(601)]
    return Trace(
        seconds,
        tuple(None if number in gap else value for number, value in enumerate(values)),
        (100,) * 601,
    )


def hour() -> Trace:
    """An hour of means, with a step in the middle."""
    return Trace(
        tuple(2.5 + 5 * number for number in range(720)),
        (300.0,) * 360 + (350.0,) * 360,
        (100.0,) * 720,
    )


def port(
    number: int, condition: Condition, temperature: Reading, station: str = "dde-1", **more: object
) -> PortState:
    fields: dict[str, object] = {
        "tool_name": "T210",
        "quality": "ok",
        "row_age_s": 0.3,
        "readings": {
            "temperature_c": temperature,
            "setpoint_c": known(350),
            "power_permille": known(123),
            "status": known("working"),
        },
        "alarms": (),
        "problems": (),
        "coverage": Coverage(12_000, 12_000, is_whole=True),
        "trace": trace(depth=20),
        "joints": Joints(128, 128, 4.0),
    }
    return PortState(station, number, condition=condition, **{**fields, **more})  # type: ignore[arg-type]


def station(name: str, *ports: PortState, **more: object) -> StationState:
    return StationState(
        name, "dde", "DDE_01", "running", "", 10.0, "recipes/sac305.toml", (), ports, **more
    )  # type: ignore[arg-type]


def run(
    folder: Path = Path("runs/20261123T060000Z-bench-3-k7qd"), phase: Phase = Phase.RECORDING
) -> RunState:
    dde = station(
        "dde-1",
        port(1, Condition.NORMAL, known(349), trace=trace(depth=20, last_s=3600.0), hour=hour()),
        port(
            2,
            Condition.ALARM,
            known(392),
            alarms=("T 392 °C is above the limit of 380 °C.",),
            joints=Joints(96, 96, 190.0),
        ),
        settings=(
            Setting(1, "T210", "temperature_select_c", "350", "°C", "confirmed"),
            Setting(None, None, "pin", None, "", "refused"),
        ),
        counters=(
            Counter(1, "work_h", 123.5, "h", "00123"),
            Counter(2, "work_h", None, "h", "<timeout>"),
        ),
    )
    other = station(
        "ucr-1",
        port(
            1,
            Condition.NOT_KNOWN,
            failed(351, "timeout"),
            "ucr-1",
            quality="timeout",
            trace=trace(gap=range(300, 400)),
        ),
        port(
            2,
            Condition.STALE,
            stale(350),
            "ucr-1",
            row_age_s=95.0,
            coverage=Coverage(12_000, 11_050, is_whole=False),
        ),
    )
    strange = station(
        "nae-1",
        port(
            1,
            Condition.ATTENTION,
            known(350),
            "nae-1",
            problems=(f"Station error: {HOSTILE}",),
            trace=Trace(),
            joints=Joints(None, 7, 4.0, "Between 1 and 7 were found."),
        ),
        port(
            2,
            Condition.ENDED,
            Reading(),
            "nae-1",
            tool_name=None,
            readings={},
            row_age_s=None,
            coverage=Coverage(),
            trace=Trace(),
            joints=Joints(why="not counted yet"),
        ),
    )
    events = (
        EventRow(T0_US, "run.start", Severity.INFO, "The run begins."),
        EventRow(
            T0_US + 5_000_000,
            "read.timeout",
            Severity.WARNING,
            "ucr-1: No answer since 12 s.",
            "ucr-1",
            1,
        ),
        EventRow(
            T0_US + 6_000_000, "station.error", Severity.ERROR, f"Station error: {HOSTILE}", "nae-1"
        ),
        EventRow(
            T0_US + 7_000_000,
            "alarm.high",
            Severity.CRITICAL,
            "T 392 °C is above the limit of 380 °C.",
            "dde-1",
            2,
        ),
    )
    return RunState(
        folder=folder,
        phase=phase,
        text="Recording.",
        commit_age_s=0.4,
        line="bench-3",
        order="88123",
        unit="SN-0012",
        units=("SN-0012",),
        stations=(dde, other, strange),
        events=tuple(NumberedEvent(number, event) for number, event in enumerate(events)),
        is_whole=True,
    )
