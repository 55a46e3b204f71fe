from __future__ import annotations

import pytest

from support.product import patch


@pytest.fixture(autouse=True)
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What a guard in this process says to people, in place of stderr."""
    told: list[str] = []
    patch(monkeypatch, "takeover.show", told.append)
    return told
