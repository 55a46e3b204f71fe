"""The guard's own process: ``python -m jbclog.guard RUN --recorder PID``, its lease on stdin. Started by `jbclog run`.

It is in a session of its own, so that neither a terminal that closes nor Ctrl-C nor Ctrl-Z reaches it, and it ignores
SIGTERM: it ends with its recorder, and not before the tools are safe.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

from jbclog.guard import lease
from jbclog.guard.diary import Diary
from jbclog.guard.only_one import only_one
from jbclog.guard.process import READY
from jbclog.guard.takeover import CRITICAL, ERROR, take_over
from jbclog.guard.watch import HUNG_S, Verdict, Watch

STDIN, STDOUT = 0, 1
READ_MOST = 65536
DEATH_S = 1.0  # that a killed recorder is given to let go of its ports


def main() -> None:
    """Watch until the recorder is done, or take its lines over."""
    folder, recorder = Path(sys.argv[1]), int(sys.argv[3])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    died = os.pidfd_open(recorder)
    if os.getppid() != recorder:  # it died before it could be watched; it had touched nothing yet
        return
    with only_one(folder):
        os.write(STDOUT, READY)
        watch = Watch(time.monotonic())
        verdict = _watch(watch, folder)
        if verdict is Verdict.DONE:
            lease.keep(folder, [])
            return
        _take_over(watch, verdict, folder, died)


def _watch(watch: Watch, folder: Path) -> Verdict:
    poll = select.poll()
    poll.register(STDIN, select.POLLIN)
    while True:
        ready = poll.poll(watch.patience_s(time.monotonic()) * 1000) or poll.poll(0)  # whoever was starved looks again
        data = os.read(STDIN, READ_MOST) if ready else b""
        now = time.monotonic()
        if data and watch.hear(data, now):
            with suppress(OSError):  # a full disk is no reason to stop watching
                lease.keep(folder, watch.stations.values())
        verdict = watch.verdict(now, closed=bool(ready) and not data)
        if verdict is not Verdict.WATCH and not (data and verdict is Verdict.HUNG):
            return verdict


def _take_over(watch: Watch, verdict: Verdict, folder: Path, died: int) -> None:
    diary = Diary(folder)
    if verdict is Verdict.HUNG:
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(died, signal.SIGKILL)
        select.select([died], [], [], DEATH_S)
    left = take_over(list(watch.stations.values()), diary)
    why = verdict.value if verdict is Verdict.DEAD else f"{verdict.value} for {HUNG_S:g} s and was ended"
    outcome = (ERROR, "every tool is in its safe state") if not left else (CRITICAL, "not every tool could be made safe")
    diary.write("guard.took_over", outcome[0], f"The guard took over, because {why}: {outcome[1]}.")
    lease.keep(folder, left)


if __name__ == "__main__":
    main()
