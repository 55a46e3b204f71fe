"""What a run leases: all that it touched while a session goes on, then what is not known to be
safe.
"""

from __future__ import annotations

import pytest

from jbclog.core.rows import StationFacts
from jbclog.guard.supervisor import RunGuard, lease_of


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
