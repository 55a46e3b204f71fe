"""Counts the joints of each port so far, in a process of its own: ``python -m
jbclog.live.joint_counter RUN``.

Finds joints as the report does, in the committed rows, without a lock (`growing_joints`). When
models are identified and joints counted depends on the run's commits alone (`Schedule`): two
processes that count the same run show the same numbers at the same age, whenever they started. The
CPU time is limited to a share of a core. Each count is written as a line (`joint_numbers.Counted`).
A line on stdin requests a count of everything now: `NOW`, or `LAST` once all rows are committed.
The process ends after `LAST`, when the run is finalized and counted, or when stdin is closed.
"""

from __future__ import annotations

import math
import os
import select
import sys
import time
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.core.errors import RecordError, unexpected_error_text
from jbclog.core.locks import commit_status
from jbclog.core.operating_system import lower_priority
from jbclog.core.text import json_line
from jbclog.live.growing_joints import GrowingJoints, count
from jbclog.live.joint_numbers import LAST, Counted
from jbclog.live.run_follower import stations_of
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import RunState, read_manifest

LOOK_S: Final = 1.0
NO_COMMIT_S: Final = 5.0  # a run without commits for this long is counted to its end
BATCH_S: Final = 0.67  # run time per batch: most commits, 0.8 s apart, have one batch, some more
# Budget for the models, as a share of one core: `ALLOWED_S`, plus a share of the run's time that
# falls with the number of ports. Together with the counts in between and the follower this is below
# 3 % for up to `MANY` ports, and grows in proportion beyond.
MANY: Final = 64
ALLOWED_S: Final = 8.0
MODEL_SHARES, COUNT_SHARES = (0.0035, 0.012), (0.0015, 0.006)
# CPU time to identify models: per port, and per batch of its rows. Batches after the first 20
# minutes cost less, because a model uses at most 20 minutes.
PORT_S, MODEL_S, ROWS_S, MODEL_BATCHES = 0.05, 1.8e-4, 2e-5, 1800
SLOW: Final = 4  # on a machine this many times slower, the schedule depends on the machine
LATER, MOST_LATER = 1.25, 450  # growth of the time to the next models, and its limit in batches
FIRST, PORTS_WAIT = 16, 0.1  # batches before the first models, and batches per square of the ports
COUNT_S: Final = 0.012  # CPU time of a count per port, for half a window of rows
NICENESS: Final = 19
STDIN: Final = 0


def main(arguments: list[str]) -> int:
    """Run the process. `arguments`: the run's folder."""
    lower_priority(NICENESS)
    pa.set_cpu_count(1)  # the recorder needs the cores
    pa.set_io_thread_count(1)
    warnings.simplefilter("ignore")  # about damage: missing data is not counted
    try:
        _count_until_final(Path(arguments[0]))
    except Exception as error:
        _write(
            Counted(
                trouble=(
                    str(error) if isinstance(error, RecordError) else unexpected_error_text(error)
                )
            )
        )
    return 0


def _count_until_final(folder: Path) -> None:
    counter, growth, asked = _Counter(folder), _Growth(), _Asked()
    while not (asked or asked.is_over or (folder / MANIFEST).exists()) and folder.is_dir():
        asked.wait()  # wait for the run to begin
    while not asked.is_over:
        last = commit_status(folder).last
        if asked or growth.has_ended(last):
            counted = counter.everything(last, is_last=LAST in asked.words)
        else:
            counted = counter.scheduled(last)
        if counted is not None:
            _write(counted)
            if counted.is_final:
                return
        asked.wait()


class _Counter:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._joints = GrowingJoints(folder)
        self._schedule = Schedule(1)
        self._models = self._through = 0
        self._ended: int | None = None

    def close(self) -> None:
        self._joints.close()

    def everything(self, last: int, *, is_last: bool) -> Counted | None:
        """Count all committed rows, as the report does; None once that is done and no more will
        come.
        """
        state = read_manifest(self._folder).state
        is_known = self._ended == last and not is_last and state != RunState.SEALED
        self._ended = last
        return None if is_known else count(self._folder, last or None, is_last=is_last)

    def scheduled(self, last: int) -> Counted | None:
        """Count if the schedule says so."""
        self._ended = None
        models, through = self._schedule.batches(last)
        if models and not self._models:  # ports are known some seconds after the run's begin
            manifest = read_manifest(self._folder)
            ports = sum(len(facts.ports) for facts in stations_of(self._folder, manifest))
            self._schedule = Schedule(max(ports, 1))
            models, through = self._schedule.batches(last)
        if through == self._through:
            return None
        if models != self._models:
            began, is_first = time.process_time(), not self._models
            counted = self._joints.identify(models)
            if not is_first:  # imports heavy packages
                self._schedule.took(time.process_time() - began)
        if through != models:
            counted = self._joints.count(through)
        self._models, self._through = models, through
        return counted


class _Asked:
    """Requests on stdin since the last look. `is_over`: stdin is closed."""

    def __init__(self) -> None:
        self.words, self.is_over = b"", False

    def __bool__(self) -> bool:
        return bool(self.words)

    def wait(self) -> None:
        """Wait `LOOK_S`, or until a request arrives."""
        self.words = b""
        if select.select([STDIN], [], [], LOOK_S)[0]:
            self.words = os.read(STDIN, 1 << 16)
            self.is_over = not self.words


class _Growth:
    """Detects that a run has stopped growing: a crashed one has no further commits."""

    def __init__(self) -> None:
        self._last, self._since = -1, 0.0

    def has_ended(self, last: int) -> bool:
        """Return whether there was no new batch for `NO_COMMIT_S`."""
        if last != self._last:
            self._last, self._since = last, time.monotonic()
        return time.monotonic() - self._since >= NO_COMMIT_S


class Schedule:
    """When to count the joints of a run with this many ports; the same in each counting process."""

    def __init__(self, ports: int) -> None:
        self._ports, self._slower = ports, 1.0
        few, self._times = max(1 - ports / MANY, 0.0), max(ports / MANY, 1.0)
        self._share, count_share = (
            self._times * (least + few * (most - least))
            for least, most in (MODEL_SHARES, COUNT_SHARES)
        )
        self._models, self._spent_s = 0, 0.0
        self._following = FIRST + round(PORTS_WAIT * min(ports, MANY) ** 2)
        self._apart = math.ceil(COUNT_S * ports / count_share / BATCH_S)

    def batches(self, last: int) -> tuple[int, int]:
        """Return the batches up to which to identify models and to count joints; 0: too early.

        `last` is the newest batch.
        """
        while self._following <= last:
            spent_s = self._spent_s + self._slower * self.models_s(self._following)
            allowed_s = self._times * ALLOWED_S + self._share * BATCH_S * self._following
            if spent_s <= allowed_s:
                self._models, self._spent_s = self._following, spent_s
                self._following += min(math.ceil((LATER - 1) * self._models), MOST_LATER)
            else:
                self._following += max(1, self._following // 64)
        return self._models, max(self._models, last - last % self._apart if self._models else 0)

    def took(self, models_s: float) -> None:
        """Record how long the last identification took; matters only on a much slower machine."""
        self._slower = max(models_s / self.models_s(self._models) / SLOW, 1.0)

    def models_s(self, batch: int) -> float:
        """Return the CPU time, in s, to identify the models in the rows up to a batch."""
        each = MODEL_S * min(batch, MODEL_BATCHES) + ROWS_S * batch
        return self._ports * (PORT_S + each)


def _write(counted: Counted) -> None:
    sys.stdout.write(json_line(asdict(counted)) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
