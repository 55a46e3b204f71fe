"""Another program has the port open and takes the answers: it is named first."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.command import RECIPE, jbclog
from support.links.far_ends import terminal

READS = (
    "import sys; port = open(sys.argv[1], 'rb+', buffering=0); print('open', flush=True);"
    " port.read()"
)


@contextmanager
def other_program(url: str) -> Iterator[int]:
    """A program that reads from the port without a lock: its number."""
    command = [sys.executable, "-c", READS, url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        try:
            yield process.pid
        finally:
            process.kill()


def line_file(folder: Path, url: str) -> Path:
    line = folder / "line.toml"
    line.write_text(
        f'[line]\nname = "l"\n[[station]]\nname = "dde-1"\nurl = "{url}"\nfamily = "dde"\n'
    )
    return line


@pytest.mark.parametrize(
    "command",
    [("run", str(RECIPE), "--duration", "1s", "--no-guard"), ("read", "dde-1", "model")],
)
def test_the_other_program_is_named_before_station_and_cable(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    with terminal() as far, other_program(far.url) as process:
        line = line_file(tmp_path, far.url)
        out = ["--out", tmp_path / "runs"] if command[0] == "run" else []
        ended = jbclog(*command, "--line", line, *out)
    assert ended.returncode == 3
    start = f"dde-1: {far.url} is open in process {process} (a Python program)"
    message = next(text for text in ended.stderr.splitlines() if start in text)
    assert message.index("end that program") < message.index("no usable answer")


def test_alone_on_the_port_the_message_is_about_station_cable_and_robot_mode(
    tmp_path: Path,
) -> None:
    with terminal() as far:
        ended = jbclog("read", "dde-1", "model", "--line", line_file(tmp_path, far.url))
    assert f"dde-1: no usable answer on {far.url}" in ended.stderr
    assert "Robot mode is switched on" in ended.stderr
