"""What the recorder looks at beside its sessions: a wall clock that was stepped, and a program that
has opened a port, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

from jbclog.app.run.recorder import Recorder
from jbclog.core.clock import UtcOffset
from jbclog.core.rows import Severity
from jbclog.core.states import StationOutcome
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


def test_a_step_of_the_clock_is_an_event_with_both_times() -> None:
    host, noted = Host(), list[tuple[object, ...]]()
    one = recorder(
        clock=host,
        run_record=SimpleNamespace(utc=UtcOffset(host)),
        note=lambda *said, value: noted.append((*said, value)),
    )
    one._look_at_clock()
    assert noted == []
    host.utc_s += 3600.0
    one._look_at_clock()
    text = (
        f"{CLOCK_STEPPED} +3600.000 s, from 2026-09-21T14:13:20.000000Z to"
        " 2026-09-21T15:13:20.000000Z; sampling times and durations are not affected."
    )
    assert noted == [("clock.step", text, Severity.WARNING, 3600.0)]


def test_a_program_that_has_opened_a_port_is_named_at_the_station_that_still_runs() -> None:
    noted: list[tuple[object, ...]] = []

    def station(url: str, outcome: StationOutcome) -> SimpleNamespace:
        return SimpleNamespace(
            order=SimpleNamespace(url=url),
            facts=SimpleNamespace(outcome=outcome),
            note=lambda *said: noted.append((url, *said)),
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
