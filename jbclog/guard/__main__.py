"""The guard's process: ``python -m jbclog.guard RUN --recorder PID [FORMER]``, with its leases on
stdin. `jbclog run` starts it. FORMER is a descriptor of the guard that it replaces.

It runs in its own session, out of reach of a closed terminal, Ctrl-C and Ctrl-Z, and ignores
SIGTERM: it ends with its recorder. It retries for `RETRY_FOR_S` to make the remaining tools safe,
because a cable may be plugged in again.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from jbclog.core.clock import elapsed
from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.guard.action_log import STDERR, ActionLog, close_stream, show
from jbclog.guard.continuity import Continuity
from jbclog.guard.inquiry import Inquiries, Unsafe, answer
from jbclog.guard.lease import StationLease, guard_lock
from jbclog.guard.lease_writer import LeaseWriter
from jbclog.guard.takeover import CRITICAL, ERROR, Problems, TakeOver
from jbclog.guard.watch import ANSWER, HUNG_S, READY, GuardLost, Recorder, Verdict, Watch
from jbclog.transport.cpu_limit import cpu_limit

STDIN, STDOUT = 0, 1
READ_MOST = 65536
PREDECESSOR_S = 5.0  # until a killed guard is gone
DYING_S = 0.3  # a dying recorder's pipe closes a moment before its ports
DEATH_S = 1.0  # until a killed recorder has released its ports
WRITE_S = 1.0  # until the lease is written
RETRY_EVERY_S = 5.0
ORDER_AGAIN_S = 0.5  # while a station that does not answer may still be ordered
RETRY_FOR_S = 600.0
TRIES = 3


def main() -> int:
    """Watch until the recorder is done, or make its tools safe; return the exit code."""
    folder, recorder = Path(sys.argv[1]), Recorder(int(sys.argv[3]))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    for former in map(int, sys.argv[4:]):
        _kill(former)
    action_log = ActionLog(folder)
    lease_writer = LeaseWriter(folder, action_log)
    try:
        with guard_lock(folder, PREDECESSOR_S):
            with suppress(OSError):  # works without reserved space
                action_log.reserve()
            watch, inquiries = Watch(time.monotonic()), Inquiries(folder)
            left, flooded = _guard(watch, recorder, lease_writer, action_log)
            try:
                _close_lease(left, lease_writer, action_log)
            except Exception as error:  # retry the rest all the same
                _show_failure(error)
            close_stream(STDOUT)  # shows a waiting recorder that the guard is done
    except RecordError as error:
        show(str(error))
        return error.exit_code
    except OSError as error:
        show(f"{folder}: the guard cannot be set up: {error}")
        return RecordError.exit_code
    except Exception as error:  # the recorder starts another guard
        _show_failure(error)
        return RecordError.exit_code
    if left:
        close_stream(STDERR)
        with inquiries:
            _retry(folder, left, flooded, watch.continuity, inquiries, lease_writer, action_log)
    return 0


def _kill(former: int) -> None:
    """Kill the previous guard; a dead recorder no longer can."""
    with suppress(OSError):
        signal.pidfd_send_signal(former, signal.SIGKILL)
    with suppress(OSError):
        os.close(former)


def _close_lease(
    left: Sequence[StationLease], lease_writer: LeaseWriter, action_log: ActionLog
) -> None:
    """Close the lease except for what is left; leave it open if the log lost a line."""
    if not action_log.is_torn:
        lease_writer.put(left)
    # for a lease that stays open too: a take-over may be faster than the disk
    lease_writer.settle(WRITE_S)
    if not left:
        action_log.tidy()


def _guard(
    watch: Watch, recorder: Recorder, lease_writer: LeaseWriter, action_log: ActionLog
) -> tuple[Sequence[StationLease], Collection[str]]:
    """Watch, and take over if necessary; return what may still be hot, and the stations ordered
    over a flooded link.

    A guard with an internal error may have lost a lease. It stops answering, so that the recorder
    replaces it within 1.25 s, and keeps watching until then in case the recorder dies first.
    """
    os.set_blocking(STDOUT, False)
    _answer(READY)
    answers = True
    for _ in range(TRIES):
        try:
            verdict = _watch(watch, lease_writer, answers=answers)
            return (
                ((), ())
                if verdict is Verdict.DONE
                else _take_over(watch, verdict, recorder, action_log)
            )
        except Exception as error:  # a bug, or for example refused memory
            answers = False
            _show_failure(error)
    if _is_followed(watch, recorder):
        raise GuardLost(f"it failed {TRIES} times")
    return [station for station in watch.stations.values() if station.holds], ()


def _is_followed(watch: Watch, recorder: Recorder) -> bool:
    """Return True if the recorder lives and renews, so that it will start another guard."""
    renews = not watch.has_failed and time.monotonic() - watch.heard_at < HUNG_S
    return renews and not recorder.is_gone_within(DYING_S)


def _show_failure(error: Exception) -> None:
    with suppress(Exception):
        show(f"the guard failed, {unexpected_error_text(error)}")


def _watch(watch: Watch, lease_writer: LeaseWriter, *, answers: bool) -> Verdict:
    poll = select.poll()
    poll.register(STDIN, select.POLLIN)
    while True:
        began = time.monotonic()
        patience_s = watch.patience_s(began)
        ready = poll.poll(patience_s * 1000)
        watch.overslept(time.monotonic() - began - patience_s, time.monotonic())
        ready = ready or poll.poll(0)  # after a starved wait, look again
        data = os.read(STDIN, READ_MOST) if ready else b""
        now = time.monotonic()
        if data:
            if answers:
                _answer(ANSWER)
            if watch.hear(data, now):
                lease_writer.put(watch.stations.values())
        verdict = watch.verdict(now, closed=bool(ready) and not data)
        if verdict is not Verdict.WATCH and not (data and verdict is Verdict.HUNG):
            return verdict


def _answer(data: bytes) -> None:
    """Show the recorder that this guard lives."""
    with suppress(OSError):
        os.write(STDOUT, data)


def _take_over(
    watch: Watch, verdict: Verdict, recorder: Recorder, action_log: ActionLog
) -> tuple[Sequence[StationLease], Collection[str]]:
    if verdict is not Verdict.FAILED:  # a failed recorder has closed its ports
        recorder.end(0.0 if verdict is Verdict.HUNG else DYING_S, DEATH_S)
    watch.continuity.died_at = elapsed()
    taking_over = TakeOver(list(watch.stations.values()), action_log, continuity=watch.continuity)
    left = taking_over.run()
    why = (
        f"{verdict.value} for {HUNG_S:g} s and was ended"
        if verdict is Verdict.HUNG
        else verdict.value
    )
    outcome = (
        (ERROR, "every tool is in its safe state")
        if not left
        else (CRITICAL, "not every tool could be made safe")
    )
    action_log.write(
        "guard.took_over", outcome[0], f"The guard took over, because {why}: {outcome[1]}."
    )
    return left, taking_over.flooded


def _retry(
    folder: Path,
    left: Sequence[StationLease],
    flooded: Collection[str],
    continuity: Continuity,
    inquiries: Inquiries,
    lease_writer: LeaseWriter,
    action_log: ActionLog,
) -> None:
    """Retry until all is safe, another process has closed the lease, or time is up. Unlock the
    folder between tries; `jbclog safe` gets a try, its result, and then the ports.
    """
    end = time.monotonic() + RETRY_FOR_S
    while left and time.monotonic() < end:
        asking = inquiries.wait(_pause_s(left, continuity))
        # checked without the lock too: a guard without descriptors cannot take it
        if lease_writer.was_cleared:
            return
        problems: Problems = {}
        with suppress(Exception), guard_lock(folder):
            if lease_writer.was_cleared:
                return
            taking_over = TakeOver(
                left, action_log, again=True, flooded=flooded, continuity=continuity
            )
            left, flooded = taking_over.run(), taking_over.flooded
            problems = taking_over.problems
            _close_lease(left, lease_writer, action_log)
        if asking is not None:
            answer(asking, [_unsafe(station, problems, continuity) for station in left])
    with suppress(RecordError, OSError), guard_lock(folder):
        action_log.tidy()


def _unsafe(station: StationLease, problems: Problems, continuity: Continuity) -> Unsafe:
    name = station.name
    return Unsafe(
        name,
        station.url,
        problems.get(name, {}),
        continuity.orders[name],
        continuity.others.get(name),
    )


def _pause_s(left: Sequence[StationLease], continuity: Continuity) -> float:
    now = elapsed()
    if any(continuity.has_orders_left(station.name, now) for station in left):
        return ORDER_AGAIN_S
    return RETRY_EVERY_S


if __name__ == "__main__":
    with cpu_limit():
        code = main()
    sys.exit(code)
