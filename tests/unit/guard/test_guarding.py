"""What a run leases: all it touched while a session lasts, then what is not known safe."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import RunGuard, StartRefused, StationFacts, lease_of, patch


def facts(outcome: str, may_feed: bool, **safe_state: str) -> StationFacts:
    found = StationFacts(
        "ale-1",
        "/dev/ttyX",
        "ale",
        "ALE",
        "1.00a",
        1,
        touched=[1, 2],
        outcome=outcome,
        may_feed=may_feed,
    )
    found.asked_safe_state = "stand"
    found.safe_state = {
        int(port.removeprefix("port_")): state for port, state in safe_state.items()
    }
    return found


@pytest.mark.parametrize(
    ("told", "ports", "feeds"),
    [
        (facts("running", True), (1, 2), True),
        (facts("running", True, port_1="verified"), (1, 2), True),  # it may be put to work again
        (facts("completed", False, port_1="verified", port_2="verified"), (), False),
        (facts("gone", True, port_1="verified", port_2="failed"), (2,), True),
        (facts("stopped", False, port_1="sent", port_2="verified"), (1,), False),
    ],
)
def test_what_is_leased(told: StationFacts, ports: tuple[int, ...], feeds: bool) -> None:
    lease = lease_of(told)
    assert (lease.ports, lease.feeds) == (ports, feeds)
    assert (lease.name, lease.url, lease.family, lease.model, lease.software) == (
        "ale-1",
        "/dev/ttyX",
        "ale",
        "ALE",
        "1.00a",
    )
    assert lease.holds == bool(ports or feeds)


def test_without_a_guard_nobody_is_told() -> None:
    guarding = RunGuard()
    guarding.update(facts("running", True))
    guarding.renew()
    guarding.take_over()
    guarding.end()


class Process:
    """A guard process that is asked for, and what becomes of it; the first `refused` are none."""

    made: list[Process]
    refused = 0

    def __init__(self, folder: Path) -> None:
        if type(self).refused:
            type(self).refused -= 1
            raise StartRefused("no more processes")
        self.calls: list[str] = []
        self.made.append(self)

    def await_ready(self) -> None:
        self.calls.append("ready")

    def end(self) -> None:
        self.calls.append("end")


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> type[Process]:
    class Mine(Process):
        made: list[Process] = []  # noqa: RUF012  # of this test

    patch(monkeypatch, "supervisor.GuardProcess", Mine)
    return Mine


def test_the_guard_that_was_begun_is_the_one_that_is_waited_for(
    processes: type[Process], tmp_path: Path
) -> None:
    guarding = RunGuard()
    guarding.begin(tmp_path)
    assert [one.calls for one in processes.made] == [[]]
    guarding.start(tmp_path, lambda *_: None)
    guarding.end()
    assert [one.calls for one in processes.made] == [["ready", "end"]]


def test_one_that_was_begun_for_nothing_is_ended(processes: type[Process], tmp_path: Path) -> None:
    guarding = RunGuard()
    guarding.begin(tmp_path)
    guarding.end()
    assert [one.calls for one in processes.made] == [["end"]]


def test_one_that_could_not_be_begun_is_tried_again_when_it_is_needed(
    processes: type[Process], tmp_path: Path
) -> None:
    guarding, processes.refused = RunGuard(), 2
    guarding.begin(tmp_path)
    with pytest.raises(StartRefused, match="no more processes"):
        guarding.start(tmp_path, lambda *_: None)
    guarding.start(tmp_path, lambda *_: None)
    assert [one.calls for one in processes.made] == [["ready"]]
