"""Signals during a run: handled between two instructions of the main thread, and kept until there
is a handler.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection
from types import FrameType
from typing import Self

OnSignal = Callable[[signal.Signals], None]


class Signals:
    """Handle the signals `heard` and ignore those in `ignored` during a ``with``, in the main
    thread only.

    Keeps signals that arrive before `notify`. With `stay_ignored` all of them stay ignored
    afterwards, while the program prints its result.
    """

    def __init__(
        self,
        heard: Collection[signal.Signals],
        ignored: Collection[signal.Signals] = (),
        *,
        stay_ignored: bool = False,
    ) -> None:
        self._stay_ignored = stay_ignored
        self._heard = heard
        self._ignored = ignored
        self._before: dict[signal.Signals, object] = {}
        self._early: list[signal.Signals] = []
        self._on_notify: OnSignal | None = None

    def __enter__(self) -> Self:
        for number in self._heard:
            self._before[number] = signal.signal(number, self._on_signal)
        for number in self._ignored:
            self._before[number] = signal.signal(number, signal.SIG_IGN)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._stay_ignored else before)  # type: ignore[arg-type]  # the previous handler

    def notify(self, notify: OnSignal) -> None:
        """Call `notify` for each signal kept so far and each later one, between two instructions of
        the main thread.
        """
        self._on_notify = notify
        while self._early:
            notify(self._early.pop(0))

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if self._on_notify is None:
            self._early.append(signal.Signals(number))
        else:
            self._on_notify(signal.Signals(number))
