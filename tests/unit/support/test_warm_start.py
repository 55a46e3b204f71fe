"""What is forked in place of an interpreter ends, reads and says as the interpreter would."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from support.command import until
from support.warm_start import Forked


def test_it_says_what_the_interpreter_says_and_ends_as_that(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "jbclog.record.seal", str(tmp_path / "gone")]
    ends = []
    for begin in (subprocess.Popen, Forked):
        with begin(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            ends.append((*process.communicate(timeout=60), process.returncode))
    assert ends[0] == ends[1]
    assert (ends[0][1] != "", ends[0][2] != 0) == (True, True)


def test_descriptors_keep_their_numbers_and_the_session_is_its_own(tmp_path: Path) -> None:
    (tmp_path / "some.json").write_text('{"a": 1}')
    reading, writing = os.pipe()
    with (
        (tmp_path / "some.json").open() as some,
        Forked(
            [sys.executable, "-P", "-m", "json.tool", "--compact", f"/dev/fd/{reading}"],
            stdin=some,
            stdout=subprocess.PIPE,
            pass_fds=[reading],
            start_new_session=True,
        ) as process,
        os.fdopen(writing, "wb") as sink,
    ):
        os.close(reading)
        assert until(lambda: os.getsid(process.pid) == process.pid)
        assert process.poll() is None  # it waits for the pipe
        sink.write(b"[1, 2]")
        sink.close()
        assert process.communicate(timeout=60)[0] == b"[1,2]\n"
    assert process.returncode == 0
