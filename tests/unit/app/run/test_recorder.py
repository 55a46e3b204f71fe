"""What the recorder looks at beside its sessions: a wall clock that was stepped, and a program that
has opened a port, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

from jbclog.app.run.recorder import Recorder
from jbclog.app.run.run_record import RunRecord
from jbclog.core.clock import UtcOffset
from jbclog.core.rows import Severity
from jbclog.core.states import StationOutcome
from jbclog.record.manifest import ClockStep
from support.campaigns.awaited import CLOCK_STEPPED


@dataclass
class Host:
    """Clocks that stand still."""

    utc_s: float = 1_790_000_000.0

    def utc(self) -> float:
        return self.utc_s

    def monotonic(self) -> float:
        return 1000.0


def recorder(**parts: object) -> Recorder:
    """One that has nothing but these parts."""
    made = object.__new__(Recorder)
    made.__dict__.update({f"_{name}": part for name, part in parts.items()})
    return made


def test_a_step_of_the_clock_is_an_event_with_both_times_that_moves_none_of_the_run() -> None:
    host, noted = Host(), list[tuple[object, ...]]()
    manifest = SimpleNamespace(clock_steps=[])
    run_record = object.__new__(RunRecord)
    run_record.__dict__.update(utc=UtcOffset(host), manifest=manifest)  # type: ignore[arg-type]
    one = recorder(
        clock=host,
        run_record=run_record,
        note=lambda *said, value, raw: noted.append((*said, value, raw)),
    )
    one._look_at_clock()
    assert noted == []
    host.utc_s += 3600.0
    one._look_at_clock()
    text = (
        f"{CLOCK_STEPPED} +3600.000 s, from 2026-09-21T14:13:20.000000Z to"
        " 2026-09-21T15:13:20.000000Z. The times of this run continue: 2026-09-21T14:13:20.000000Z."
    )
    after = "2026-09-21T15:13:20.000000Z"
    assert noted == [("clock.step", text, Severity.WARNING, 3600.0, after)]
    host.utc_s -= 3620.0
    one._look_at_clock()
    one._look_at_clock()
    assert [said[3] for said in noted] == [3600.0, -3620.0]
    now = "2026-09-21T14:13:20.000000Z"
    assert manifest.clock_steps == [ClockStep(now, 3600.0, 3600.0), ClockStep(now, -3620.0, -20.0)]


def test_small_steps_of_the_clock_add_up_to_one() -> None:
    host = Host()
    utc = UtcOffset(host)
    steps = []
    for _ in range(4):
        host.utc_s += 0.2
        steps.append(utc.check())
    assert steps == [0.0, 0.0, 0.6, 0.0]
    assert utc.micros(1000.0) == 1_790_000_000_000_000


def test_a_program_that_has_opened_a_port_is_named_at_the_station_that_still_runs() -> None:
    noted: list[tuple[object, ...]] = []

    def station(url: str, outcome: StationOutcome) -> SimpleNamespace:
        return SimpleNamespace(
            order=SimpleNamespace(url=url),
            state=SimpleNamespace(facts=SimpleNamespace(outcome=outcome)),
            log=SimpleNamespace(note=lambda *said: noted.append((url, *said))),
        )

    found = [("/dev/a", "process 7 (cat)"), ("/dev/b", "process 8 (minicom)")]
    recorder(
        sharers=SimpleNamespace(news=lambda: found),
        contexts=[
            station("/dev/a", StationOutcome.RUNNING),
            station("/dev/b", StationOutcome.COMPLETED),
        ],
    )._note_sharers()
    text = (
        "/dev/a is open in process 7 (cat), too, which may take answers that were meant for this"
        " run; end that program."
    )
    assert noted == [("/dev/a", "link.contention", Severity.ERROR, text)]
