"""Every line format of the older stations (manual 000, 2.1): 12 rates, three parities, one or two
stop bits.

A plan is computed from transmission times. These tests compute them a second time, from the bits,
and then run each format on a virtual clock at the best rate of its plan.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from support.campaigns.each_row import each_row
from support.product import COLUMN, Problems, StationPlan, parse_line
from support.virtual.recorded_run import plan_in
from support.virtual.virtual_run import Heard, VirtualRun, line_text, prepare

RATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000)
FORMATS = tuple(f"8{parity}{stop}" for parity, stop in product("NEO", (1, 2)))
BITS = {"8N1": 10, "8N2": 11, "8E1": 11, "8O1": 11, "8E2": 12, "8O2": 12}
"""Start bit, eight data bits, parity if any, stop bits."""
READ, ANSWER = 11, 16
"""Characters of an addressed read, and of its answer with five digits (manual 000, 3)."""

RECIPE = """
[recipe]
name = "test"
revision = 1
families = ["soldering"]
[temperature]
select_c = 320
[sampling]
rate_hz = 10
[run]
status = "working"
"""

every_format = each_row((f"{rate} {form}", (rate, form)) for rate, form in product(RATES, FORMATS))


def line_of(baudrate: int, form: str) -> str:
    keys = f'ports = [1]\nbaudrate = {baudrate}\nformat = "{form}"'
    return line_text(keys=keys).replace('"dde"', '"soldering"').replace("dde-1", "old-1")


def planned(folder: Path, baudrate: int, form: str) -> StationPlan:
    return plan_in(folder, line_of(baudrate, form), RECIPE, rate="fit").stations[0]


def test_the_formats_are_the_seventy_two_that_are_printed() -> None:
    assert len(list(product(RATES, FORMATS))) == 72
    assert set(FORMATS) == set(BITS)


@every_format
def test_a_plan_reckons_with_its_bits(baudrate: int, form: str, tmp_path: Path) -> None:
    station = planned(tmp_path, baudrate, form)
    character_s = BITS[form] / baudrate
    assert station.spec.line_format.character_s == pytest.approx(character_s)
    assert station.demand is not None
    # temperature, power, status
    assert station.demand.fast_s == pytest.approx(3 * (READ + ANSWER) * character_s)
    assert station.rate_hz is not None
    assert station.rate_hz * station.demand.fast_s < 0.95  # 5 % of the wire are kept for repeats
    assert (station.rate_hz < 10) == (baudrate < 9600 or (baudrate == 9600 and BITS[form] > 10))


@every_format
def test_a_whole_run_keeps_the_rate_that_fits(baudrate: int, form: str) -> None:
    run = prepare(
        line_of(baudrate, form), RECIPE, duration_s=max(4.0, 5000 / baudrate), rate="fit"
    ).go()
    facts = run.facts
    assert (facts.outcome, facts.baudrate, facts.format) == ("completed", baudrate, form)
    assert facts.skipped == 0
    assert set(run.memory.column("quality")) == {"ok"}
    assert set(run.memory.column("reasons")) <= {None, "delay_s=not_counting"}
    assert_no_exchange_beats_its_bits(run, BITS[form] / baudrate)
    assert facts.safe_state == {1: "verified"}


def assert_no_exchange_beats_its_bits(run: VirtualRun, character_s: float) -> None:
    """The time between two questions is enough for all characters of the first one and of its
    answer.
    """
    for one, following in zip(run.heard, run.heard[1:], strict=False):
        assert following.at - one.at >= _characters(one) * character_s * 0.999
    scans = [row[COLUMN["scan_us"]] for row in run.memory.samples]
    assert all(
        isinstance(scan, int) and scan >= 3 * (READ + ANSWER) * character_s * 0.999e6
        for scan in scans
    )


def _characters(one: Heard) -> int:
    """Return the characters of a question and its answer. Beside the text there are seven: STX,
    four digits of addresses, ETX and the check byte. A missing answer takes no time.
    """
    return 7 + len(one.text) + (7 + len(one.sent) if one.sent else 0)


@pytest.mark.parametrize("form", ["7E1", "8M1", "8N3", "8n1", "8E", "9N1"])
def test_no_other_format_is_taken(form: str) -> None:
    with pytest.raises(Problems, match="is not a line format such as 8N1"):
        parse_line(line_of(19200, form), Path("line.toml"))


@pytest.mark.parametrize("baudrate", [300, 14400, 1000000, 0, -19200])
def test_no_other_rate_is_taken(baudrate: int) -> None:
    with pytest.raises(Problems, match="one of 1200, 2400"):
        parse_line(line_of(baudrate, "8N1"), Path("line.toml"))
