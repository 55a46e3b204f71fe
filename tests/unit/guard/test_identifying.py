"""Which station a guard takes for the leased one: model, software and plugged hours must fit."""

from __future__ import annotations

from dataclasses import replace

import pytest

from support.clients.making_safe import ASKED_AT, Cable, station
from support.product import (
    NO_HOURS,
    Hours,
    LineFormat,
    Station,
    StationLease,
    VirtualStation,
    identify_for_guard,
)

READ_AT = ASKED_AT - 60.0


def dde(hours: int = 1200) -> VirtualStation:
    return station("dde", sim=f"counters = {{plugged_hours = {hours}}}")


def lease_of(device: VirtualStation) -> StationLease:
    facts = device.device.identity
    return StationLease(
        "dde-1",
        "/dev/ttyUSB0",
        19200,
        "8N1",
        1,
        "dde",
        facts.model,
        facts.software,
        "stand",
        (1, 2),
        False,
    )


def identified(
    device: VirtualStation, lease: StationLease, hours: Hours
) -> tuple[bool | None, list[str], list[str]]:
    """The result, what was found instead, and the questions."""
    others: list[str] = []
    asked: list[str] = []
    result: list[bool] = []

    async def steps() -> None:
        is_it = await identify_for_guard(Station(LineFormat()), lease, hours, others.append)
        result.append(is_it)

    Cable(device, before=asked.append).pull(steps())
    return result[0], others, asked


@pytest.mark.parametrize(
    ("hours", "found"),
    [
        (NO_HOURS, None),  # the run never read them: model and software prove it
        ({1: (1200, READ_AT)}, None),
        ({1: (1199, READ_AT), 2: (1200, READ_AT)}, None),  # they grow
        ({1: (1198, READ_AT)}, "a DDE with 1200 plugged hours on port 1, not the one with 1198"),
        (
            {1: (1200, READ_AT), 2: (1201, READ_AT)},
            "a DDE with 1200 plugged hours on port 2, not the one with 1201",
        ),
        ({1: (1100, ASKED_AT - 100 * 3600)}, None),  # as time allows
    ],
)
def test_another_station_of_the_same_model_is_told_by_its_hours(
    hours: Hours, found: str | None
) -> None:
    device = dde()
    is_it, others, _ = identified(device, lease_of(device), hours)
    assert is_it is (found is None)
    assert others == ([] if found is None else [found])


def test_another_software_is_found_before_the_hours_are_asked_for() -> None:
    device = dde()
    lease = replace(lease_of(device), software="0000001")
    is_it, others, asked = identified(device, lease, {1: (1200, READ_AT)})
    assert not is_it
    assert len(others) == 1
    assert "with software" in others[0]
    assert not any(text.startswith("RCP") for text in asked)


def test_a_station_that_refuses_to_report_hours_is_not_the_one_that_reported_them() -> None:
    device = dde()
    is_it, others, _ = identified(device, lease_of(device), {3: (1200, READ_AT)})  # it has no third
    assert (is_it, others) == (False, [])
