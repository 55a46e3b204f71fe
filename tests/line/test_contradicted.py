"""An old answer comes again directly before the true one: its value is never recorded.

The cable here repeats an earlier answer to the same question right before the true one, in the same
read or in one of its own. Which values are wrong is decided by what the station answered
(`wrong_values`), without any code of the client.
"""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from support.golden import framed
from support.links.repeating import BEGUN_S, Repeating
from support.oracles.account import assert_account_holds, counted, wrong_values
from support.product import (
    COLUMN,
    FINISH_S,
    HELD_S,
    Peer,
    SampleRow,
    StationFacts,
    StationTask,
    Steps,
)
from support.virtual.lines import fault
from support.virtual.virtual_run import Memory, VirtualRun, line_text, prepare

BYTE_S = 10 / 19200
LONGEST_S = 1.5  # of readings that are asked for again
NEAR_S = 0.12  # less than a scan without pause
NOISY = "noise_c = 3.0"  # so that hardly any reading equals an earlier one


def repeated(
    share: float,
    *,
    gap_s: float = len("\x020100ATT100350\x03*") * BYTE_S,
    torn: bool = False,
    rate: float | None = None,
    duration_s: float = 40.0,
    seed: int = 1,
    end_s: float | None = None,
) -> tuple[VirtualRun, Repeating]:
    cables: list[Repeating] = []

    def pulled(
        _order: StationTask, session: Steps[StationFacts], cable: Peer
    ) -> tuple[Steps[StationFacts], Peer]:
        cables.append(Repeating(cable, share, seed, gap_s, torn=torn))
        return session, cables[0]

    run = prepare(
        line_text(f"seed = {seed}\n{NOISY}"),
        duration_s=duration_s,
        rate=rate,
        pulled=pulled,
    )
    if end_s is not None:
        run.at(end_s, lambda: run.driver.end("stopped"))
    return run.go(), cables[0]


WAYS = {
    "right behind it": {},
    "in one read": {"gap_s": 0.0},
    "torn": {"torn": True},
    "late": {"gap_s": 0.05},
    "at 2 Hz": {"rate": 2.0, "duration_s": 150.0},
    "flat out": {"rate": "max"},
}


def wrong_temperatures(run: VirtualRun) -> list[object]:
    """The tip temperatures that the station did not answer right before the row's time; a doubtful
    one is asked for twice.
    """
    wrong = list[object]()
    for row in run.memory.samples:
        port, value = row[COLUMN["port"]], row[COLUMN["temperature_c"]]
        at = float(str(row[COLUMN["time"]])) / 1e6 + 1e-6
        asked = [
            int(str(one.clean)[-5:])
            for one in run.heard
            if one.text == f"RTT{port}" and at - NEAR_S < run.utc_s(one.at) < at
        ]
        if value is not None and value not in asked:
            wrong.append(row)
    return wrong


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("share", [0.01, 0.05, 0.2])
def test_no_old_value_is_recorded(share: float, way: str) -> None:
    run, cable = repeated(share, **WAYS[way])  # type: ignore[arg-type]
    assert run.facts.outcome == "completed", run.facts.reason
    assert cable.repeated > 3
    assert wrong_values(run) == []
    assert wrong_temperatures(run) == []
    assert_account_holds(run)


@pytest.mark.parametrize("way", WAYS)
def test_a_clean_link_loses_nothing(way: str) -> None:
    run, _ = repeated(0.0, **WAYS[way])  # type: ignore[arg-type]
    reasons = {reason for count in counted(run).values() for reason in count}
    assert "contradicted" not in reasons
    assert run.memory.of_kind("read.contradicted") == []


FAULTS = {
    "good": "",
    "silent": fault("silence", at_s=BEGUN_S, every=7),
    "hanging": fault("late", at_s=BEGUN_S, by_s=0.6, every=11),
}


@pytest.mark.parametrize("link", FAULTS)
@pytest.mark.parametrize("rate", [0.5, 2.0, 5.0, 10.0])
def test_a_row_waits_a_quarter_of_a_second_at_most(
    rate: float, link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited_s: list[float] = []
    run = prepare(line_text(FAULTS[link]), duration_s=30.0, rate=rate)
    keep = Memory.sample

    def sample(memory: Memory, row: SampleRow) -> None:
        keep(memory, row)
        late, scan = row[COLUMN["late_us"]], row[COLUMN["scan_us"]]
        if isinstance(late, int) and isinstance(scan, int):
            answered = run.t0 + int(str(row[COLUMN["tick"]])) / rate + (late + scan) / 1e6
            waited_s.append(run.driver.clock.monotonic() - answered)

    monkeypatch.setattr(Memory, "sample", sample)
    run.go()
    assert len(waited_s) > 5
    # a row also waits for those before it, and for the end of its tick
    assert max(waited_s) < HELD_S + (0.05 if link == "good" else LONGEST_S)


def test_it_is_counted_and_reported_once_and_at_the_end() -> None:
    run, _ = repeated(0.2)
    count = sum(
        number
        for reasons in counted(run).values()
        for reason, number in reasons.items()
        if reason == "contradicted"
    )
    first, total = run.memory.of_kind("read.contradicted")
    assert count > 20
    assert (total.value, total.raw) == (count, "total")
    assert first.value is None
    assert first.time < total.time


class OneOld:
    """A cable that sends `old` before the answer to `question`, once."""

    def __init__(self, cable: Peer, question: str, old: str) -> None:
        self._cable = cable
        self._question = question.encode()
        self._old = framed(old, "0100")
        self._began: float | None = None
        self._is_sent = False

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        self._began = now if self._began is None else self._began
        replies = self._cable.receive(data, now)
        if self._is_sent or now < self._began + BEGUN_S or data[5:-2] != self._question:
            return replies
        self._is_sent = True
        return [(replies[0][0] - 1e-4, self._old), *replies]

    def is_unplugged(self, now: float) -> bool:
        return self._cable.is_unplugged(now)


def with_one_old(question: str, old: str) -> VirtualRun:
    return prepare(
        line_text(keys="ports = [1]"),
        duration_s=20.0,
        pulled=lambda _order, session, cable: (session, OneOld(cable, question, old)),
    ).go()


@pytest.mark.parametrize("flags", ["00001", "00010", "00011"])
def test_old_alarm_flags_raise_no_alarm(flags: str) -> None:
    """Flags are read once, so nothing else would catch it."""
    run = with_one_old("RTA1", f"ATA1{flags}")
    assert [event.text for event in run.memory.of_kind("alarm.unknown")] == [
        "Port 1: the answer to the alarm flags was lost (contradicted); whether an alarm was raised"
        " is not known."
    ]
    assert run.facts.alarms == run.facts.unconfirmed_alarms == 0
    assert {kind for kind in run.memory.kinds() if kind.startswith("alarm.")} <= {
        "alarm.unknown",
        "alarm.low.not_working",
        "alarm.low.ended",
    }
    assert_account_holds(run)


@pytest.mark.parametrize(
    ("question", "old"),
    [("RCT1", "ACT100000"), ("RPE1", "APE100004"), ("RST1", "AST100300"), ("RPS1", "APS100001")],
)
def test_an_old_tool_error_setpoint_or_status_changes_nothing(question: str, old: str) -> None:
    run = with_one_old(question, old)
    kinds = set(run.memory.kinds())
    assert run.facts.outcome == "completed", run.facts.reason
    assert not kinds & {"tool.changed", "port.state", "port.error", "setting.changed"}
    assert "no_tool" not in {reason for row in counted(run).values() for reason in row}


@pytest.mark.parametrize("seed", range(8))
def test_the_last_row_of_a_run_that_is_ended_waits_as_well(seed: int) -> None:
    """The tools do not: their order is sent at once."""
    end_s = 8.0 + 0.013 * seed
    run, _ = repeated(1.0, seed=seed, end_s=end_s)
    assert wrong_values(run) == []
    assert wrong_temperatures(run) == []
    assert_account_holds(run)
    order = next(one for one in run.writes if one.at > run.t0 + end_s)
    assert order.at - run.t0 - end_s < FINISH_S + 0.1
