from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from jbclog.conduct import CUT_SHORT


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    """`run` ignores signals at its end, because its process ends then; the tests' goes on."""
    before = {number: signal.getsignal(number) for number in CUT_SHORT}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
