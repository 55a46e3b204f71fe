"""What holds of a run on two ports whatever happened to it: an account, few writes, and tools that
are safe or told of.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from support.oracles.account import assert_account_holds
from support.product import STAND, WORKING
from support.virtual.virtual_run import Heard, VirtualRun

SETTINGS = ("HA1", "HA2", "LA1", "LA2", "HD1", "HD2", "LD1", "LD2", "ST2")

MOST_MB = 500  # of this process: a campaign goes through its runs one by one and keeps none
PAGE_MB = 4096 / 2**20


def must_end_within(run: VirtualRun, seconds: float) -> None:
    """Let a run that does not end fail, before it fills the memory."""

    def fail() -> None:
        raise AssertionError(f"the run has not ended after {seconds:g} s")

    run.at(seconds, fail)


def assert_memory_is_bounded() -> None:
    """A campaign must not keep what it has been through."""
    pages = Path("/proc/self/statm")
    assert not pages.exists() or int(pages.read_text().split()[1]) * PAGE_MB < MOST_MB


def assert_sane(run: VirtualRun) -> None:
    assert run.facts.outcome in ("completed", "stopped", "refused", "gone")
    assert_account_holds(run)
    assert_writes_are_few(run)
    assert_safe_or_told(run)


def assert_writes_are_few(run: VirtualRun) -> None:
    """Every write once; the safe state three times at most, and again for a new tool that would not
    cool.

    What the station says it did not understand was not done, and is sent again.
    """
    sent = Counter(one.text for one in run.writes if not is_not_understood(one))
    for text, times in sent.items():
        assert text[1:4] in SETTINGS or text in (
            "WPS100000",
            "WPS200000",
            "WPS100001",
            "WPS200001",
        ), text
        assert times <= (6 if text.endswith("00001") and text.startswith("WPS") else 1), text


def is_not_understood(write: Heard) -> bool:
    answer = write.clean or ""
    return answer.startswith("N") and answer.endswith(("00001", "00002"))


def assert_safe_or_told(run: VirtualRun) -> None:
    """What was heated is standing, or the facts say which tool may be hot; nothing was put to work
    after it stood.
    """
    for port in (1, 2):
        orders = [write.value for write in run.station.log.written("status") if write.port == port]
        sent = [one.text for one in run.writes if one.text.startswith(f"WPS{port}")]
        assert orders in (
            [],
            *([WORKING] * heated + [STAND] * stood for heated in (0, 1) for stood in range(7)),
        )
        if sent and not (
            orders and orders[-1] == STAND and run.facts.safe_state.get(port) == "verified"
        ):
            assert any(f"port {port}:" in text for text in run.facts.unsafe), (sent, run.facts)
        assert (run.facts.safe_state.get(port) in ("failed", "sent")) == any(
            f"port {port}:" in text for text in run.facts.unsafe
        )
