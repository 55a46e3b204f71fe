"""A test over every row of a table, as one test: all rows are tried, and those that fail are told
by name.

A test of its own for each of thousands of rows costs more in being collected and reported than in
being run. ``pytest --row TEXT`` tries the rows that have TEXT in their name.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable
from typing import Any

import pytest

CHOSEN = "JBCLOG_ROW"
"""What ``--row`` sets, for the workers, too."""
SHOWN = 5
"""So many failures are told whole; of the others the name."""


def each_row(
    rows: Iterable[tuple[str, tuple[object, ...]]],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Of rows (name, what the test is called with first). What else it takes are fixtures, which
    all rows share.
    """
    table = list(rows)
    assert table, "a table without rows proves nothing"

    def over(test: Callable[..., None]) -> Callable[..., None]:
        def every_row(**fixtures: Any) -> None:
            chosen = os.environ.get(CHOSEN, "")
            some = [(name, row) for name, row in table if chosen in name]
            if not some:
                pytest.skip(f"no row has {chosen!r} in its name")
            failed = [
                (name, why)
                for name, row in some
                if (why := _failure(test, row, fixtures)) is not None
            ]
            for name, why in failed:
                why.add_note(f"row: {name}")
            if failed:
                text = f"{len(failed)} of {len(some)} rows: {', '.join(name for name, _ in failed)}"
                raise BaseExceptionGroup(text, [why for _, why in failed][:SHOWN])

        every_row.__name__, every_row.__qualname__ = test.__name__, test.__qualname__
        every_row.__module__, every_row.__doc__ = test.__module__, test.__doc__
        shared = [*inspect.signature(test).parameters.values()][len(table[0][1]) :]
        every_row.__signature__ = inspect.Signature(shared)  # type: ignore[attr-defined]  # pytest asks for it
        return every_row

    return over


def _failure(
    test: Callable[..., None], row: tuple[object, ...], fixtures: dict[str, Any]
) -> BaseException | None:
    try:
        test(*row, **fixtures)
    # the second is what `pytest.raises` ends with
    except (Exception, pytest.fail.Exception) as why:
        return why
    return None
