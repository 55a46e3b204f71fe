from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What a guard in this process says to people, in place of stderr."""
    told: list[str] = []
    monkeypatch.setattr("jbclog.guard.takeover.show", told.append)
    return told
