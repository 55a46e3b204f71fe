"""Signals are heard from the first moment on, told in their order, and left as they were found."""

from __future__ import annotations

import os
import signal

from jbclog.transport.signals import Signals

HEARD, IGNORED = signal.SIGUSR1, signal.SIGUSR2


def test_what_comes_before_there_is_anybody_to_tell_is_told_later() -> None:
    told: list[signal.Signals] = []
    before = signal.getsignal(HEARD), signal.getsignal(IGNORED)
    with Signals([HEARD, signal.SIGALRM], [IGNORED]) as signals:
        os.kill(os.getpid(), signal.SIGALRM)
        os.kill(os.getpid(), HEARD)
        os.kill(os.getpid(), IGNORED)
        signals.notify(told.append)
        assert told == [signal.SIGALRM, HEARD]
        os.kill(os.getpid(), HEARD)
        assert told == [signal.SIGALRM, HEARD, HEARD]
    assert (signal.getsignal(HEARD), signal.getsignal(IGNORED)) == before


def test_for_good_nothing_comes_of_them_afterwards() -> None:
    before = signal.getsignal(HEARD)
    try:
        with Signals([HEARD], stay_ignored=True):
            pass
        assert signal.getsignal(HEARD) == signal.SIG_IGN
    finally:
        signal.signal(HEARD, before)
