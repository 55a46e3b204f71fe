"""Processes that follow a run, ten at once or one that is stopped while it reads: they see every
row, and the recorder's log stays bounded.
"""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from support.product import STOPPED_FOLLOWER, bytes_kept_for_readers
from support.records.live_rows import Recording


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    made = Recording(tmp_path)
    made.rows(1)
    made.commit()
    yield made
    made.abandon()


FOLLOWING = """
import os, sys
from jbclog.live import follow
def following():
    with follow(sys.argv[1]) as follower:
        for run in follower.stream(0.02):
            if run.ports:
                os.write(1, b"follows\\n")  # at once: ten write here
                break
        for run in follower.stream(0.02):
            if run.ports[0].coverage.due >= int(sys.argv[2]) and run.is_whole:
                break
        os.write(1, f"{run.ports[0].coverage.due} {len(run.events)} {run.problems}\\n".encode())
children = []
for _ in range(int(sys.argv[3])):
    children.append(os.fork())
    if not children[-1]:
        following()
        os._exit(0)
sys.exit(any([os.waitpid(child, 0)[1] for child in children]))
"""
"""As many processes that follow as it is asked for, forked from one that has everything
imported.
"""


def test_ten_followers_see_every_row_and_the_log_stays_bounded(recording: Recording) -> None:
    commits = 120
    command = [sys.executable, "-c", FOLLOWING, str(recording.folder), str(commits + 1), "10"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as followers:
        assert followers.stdout is not None
        try:
            assert [followers.stdout.readline() for _ in range(10)] == ["follows\n"] * 10
            for _ in range(commits):
                recording.rows(1, reasons=f"status={secrets.token_hex(50_000)}")
                recording.event("host.busy", "late")
                recording.commit()
            size = bytes_kept_for_readers(recording.folder)
            told, wrong = followers.communicate(timeout=200)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(followers.pid, signal.SIGKILL)
    assert (told, wrong, followers.returncode) == (f"{commits + 1} {commits} ()\n" * 10, "", 0)
    assert size < 5 << 20
    assert recording.store.failure is None


def test_the_log_stays_bounded_while_a_follower_is_stopped_in_the_middle_of_a_read(
    recording: Recording,
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", STOPPED_FOLLOWER, str(recording.folder)],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "reading\n"
        for _ in range(250):
            recording.rows(1, reasons=secrets.token_hex(50_000))
            recording.commit()
        size = bytes_kept_for_readers(recording.folder)
        process.kill()
    assert size <= 6 << 20, size
