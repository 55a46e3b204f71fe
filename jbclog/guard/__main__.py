"""The guard's own process: ``python -m jbclog.guard RUN --recorder PID``, its lease on stdin. Started by `jbclog run`.

It is in a session of its own, so that neither a terminal that closes nor Ctrl-C nor Ctrl-Z reaches it, and it ignores
SIGTERM: it ends with its recorder. What could not be made safe at once is tried again for `GO_ON_S`: a cable may be put
back, a recorder may be long in dying.
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

from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.guard.action_log import ActionLog
from jbclog.guard.lease import StationLease
from jbclog.guard.lease_writer import LeaseWriter
from jbclog.guard.messages import STDERR, let_go, say
from jbclog.guard.process import ANSWER, READY, GuardLost
from jbclog.guard.recorder import Recorder
from jbclog.guard.single_guard import only_one
from jbclog.guard.takeover import CRITICAL, ERROR, TakeOver
from jbclog.guard.watch import HUNG_S, Verdict, Watch
from jbclog.transport.cpu_limit import cpu_limit

STDIN, STDOUT = 0, 1
READ_MOST = 65536
PREDECESSOR_S = 5.0  # that a guard which was killed may take to be gone
DYING_S = 0.3  # a recorder's pipe is closed a moment before its ports are
DEATH_S = 1.0  # that a killed recorder is given to let go of its ports
SHELF_S = 1.0
AGAIN_S = 5.0
GO_ON_S = 600.0
TRIES = 3


def main() -> int:
    """Watch until the recorder is done, or take its lines over."""
    folder, recorder = Path(sys.argv[1]), Recorder(int(sys.argv[3]))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    action_log = ActionLog(folder)
    lease_writer = LeaseWriter(folder, action_log)
    try:
        with only_one(folder, PREDECESSOR_S):
            with suppress(OSError):  # then it has to do without
                action_log.reserve()
            left, flooded = _guard(recorder, lease_writer, action_log)
            try:
                _keep(left, lease_writer, action_log)
            except Exception as error:  # what is left is tried again all the same
                _say_failed(error)
            let_go(STDOUT)  # a recorder that waits for the outcome sees that there is one
    except RecordError as error:
        say(str(error))
        return error.exit_code
    except OSError as error:
        say(f"{folder}: no guard can be there: {error}")
        return RecordError.exit_code
    except Exception as error:  # the recorder starts another one
        _say_failed(error)
        return RecordError.exit_code
    if left:
        let_go(STDERR)
        _go_on(folder, left, flooded, lease_writer, action_log)
    return 0


def _keep(left: Sequence[StationLease], lease_writer: LeaseWriter, action_log: ActionLog) -> None:
    """Close the lease as far as it is known what came of it: what could not be written down is nobody's to know."""
    if not action_log.is_torn:
        lease_writer.put(left)
        lease_writer.settle(SHELF_S)
    if not left:
        action_log.tidy()


def _guard(recorder: Recorder, lease_writer: LeaseWriter, action_log: ActionLog) -> tuple[Sequence[StationLease], Collection[str]]:
    """Watch, and take over where it comes to that; return what may still be hot, and the stations ordered over a flooded link.

    A guard that failed may have lost a lease. It answers no more, so that the recorder replaces it within 1.25 s, and watches
    until then: a recorder that dies first has nobody else.
    """
    os.set_blocking(STDOUT, False)
    _answer(READY)
    watch, answers = Watch(time.monotonic()), True
    for _ in range(TRIES):
        try:
            verdict = _watch(watch, lease_writer, answers=answers)
            return ((), ()) if verdict is Verdict.DONE else _take_over(watch, verdict, recorder, action_log)
        except Exception as error:  # of this program: memory was refused, say
            answers = False
            _say_failed(error)
    if _is_followed(watch, recorder):
        raise GuardLost(f"it failed {TRIES} times")
    return [station for station in watch.stations.values() if station.holds], ()


def _is_followed(watch: Watch, recorder: Recorder) -> bool:
    """Whether another guard comes when this one ends: the recorder lives, and renews its lease. Else there is nobody."""
    renews = not watch.has_failed and time.monotonic() - watch.heard_at < HUNG_S
    return renews and not recorder.is_gone_within(DYING_S)


def _say_failed(error: Exception) -> None:
    with suppress(Exception):
        say(f"the guard failed, {unexpected_error_text(error)}")


def _watch(watch: Watch, lease_writer: LeaseWriter, *, answers: bool) -> Verdict:
    poll = select.poll()
    poll.register(STDIN, select.POLLIN)
    while True:
        began = time.monotonic()
        patience_s = watch.patience_s(began)
        ready = poll.poll(patience_s * 1000)
        watch.overslept(time.monotonic() - began - patience_s, time.monotonic())
        ready = ready or poll.poll(0)  # whoever was starved looks again
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
    """So that the recorder sees that its guard lives."""
    with suppress(OSError):
        os.write(STDOUT, data)


def _take_over(
    watch: Watch, verdict: Verdict, recorder: Recorder, action_log: ActionLog
) -> tuple[Sequence[StationLease], Collection[str]]:
    if verdict is not Verdict.FAILED:  # one that failed has closed its ports
        recorder.end(0.0 if verdict is Verdict.HUNG else DYING_S, DEATH_S)
    taking_over = TakeOver(list(watch.stations.values()), action_log)
    left = taking_over.run()
    why = f"{verdict.value} for {HUNG_S:g} s and was ended" if verdict is Verdict.HUNG else verdict.value
    outcome = (ERROR, "every tool is in its safe state") if not left else (CRITICAL, "not every tool could be made safe")
    action_log.write("guard.took_over", outcome[0], f"The guard took over, because {why}: {outcome[1]}.")
    return left, taking_over.flooded


def _go_on(
    folder: Path, left: Sequence[StationLease], flooded: Collection[str], lease_writer: LeaseWriter, action_log: ActionLog
) -> None:
    """Try again, until all is safe, or somebody else has seen to it, or time is up. Between tries the folder is free."""
    end = time.monotonic() + GO_ON_S
    while left and time.monotonic() < end:
        time.sleep(AGAIN_S)
        with suppress(Exception), only_one(folder):
            if lease_writer.was_cleared:
                return
            taking_over = TakeOver(left, action_log, again=True, flooded=flooded)
            left, flooded = taking_over.run(), taking_over.flooded
            _keep(left, lease_writer, action_log)
    with suppress(RecordError, OSError), only_one(folder):
        action_log.tidy()


if __name__ == "__main__":
    with cpu_limit():
        code = main()
    sys.exit(code)
