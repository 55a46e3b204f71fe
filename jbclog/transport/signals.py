"""The system's signals, heard from the first moment on: one that comes before there is anybody to tell is told later."""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection
from types import FrameType, TracebackType
from typing import Self

Tell = Callable[[signal.Signals], None]


class Signals:
    """Hears the signals `heard` and lets nothing come of those `ignored`, while a ``with`` lasts. In the main thread only.

    With `for_good` nothing comes of any of them afterwards either: what is left of the program is its last words.
    """

    def __init__(
        self, heard: Collection[signal.Signals], ignored: Collection[signal.Signals] = (), *, for_good: bool = False
    ) -> None:
        self._for_good = for_good
        self._heard = heard
        self._ignored = ignored
        self._before: dict[signal.Signals, object] = {}
        self._early: list[signal.Signals] = []
        self._tell: Tell | None = None

    def __enter__(self) -> Self:
        for number in self._heard:
            self._before[number] = signal.signal(number, self._on_signal)
        for number in self._ignored:
            self._before[number] = signal.signal(number, signal.SIG_IGN)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._for_good else before)  # type: ignore[arg-type]  # it was there before

    def tell(self, tell: Tell) -> None:
        """Call `tell` for each that came so far and each that comes, between two instructions of the main thread."""
        self._tell = tell
        while self._early:
            tell(self._early.pop(0))

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if self._tell is None:
            self._early.append(signal.Signals(number))
        else:
            self._tell(signal.Signals(number))
