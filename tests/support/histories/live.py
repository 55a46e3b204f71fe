"""A history with real processes: `jbclog run` as a person starts it, on TCP ports of this machine,
and its guard.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from signal import SIGKILL, Signals

from support.histories import normal
from support.histories.benches import Wire
from support.histories.drawn import History
from support.oracles.outside_bench import Served

READINGS = 15  # of the temperature, before anything is done to the run
LONGEST_S = 120.0
QUIET_S = 5.0  # without a question: the guard has ended
UNTIL_UNITS, UNTIL_JOINTS = 2, 3
PROGRAM = (sys.executable, "-m", "jbclog")


def lived(
    told: History, home: Path, write_files: Callable[[History, dict[str, str], Path], None]
) -> Iterator[normal.Line]:
    """Live it; yield its lines."""
    wires = {bench.name: Wire(bench) for bench in told.benches}
    environment = {**os.environ, "JBCLOG_NO_METRICS": "1", "HOME": str(home)}
    for name in ("XDG_CACHE_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
        environment[name] = str(home / name)
        (home / name).mkdir(mode=0o700)
    # nothing of the two trees but what is installed
    environment.pop("PYTHONPATH", None)
    with Served(wires, home, tcp=True) as served:  # type: ignore[arg-type]  # a wire is a cable
        write_files(told, served.urls, home)
        run = subprocess.Popen(
            [*PROGRAM, "run", "--line", "line.toml", *_options(told)],
            cwd=home,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            notes = _meet_its_end(run, told, wires)
        finally:
            run.kill()
        if told.live == "killed":
            _wait_for_quiet(wires)
    codes = {}
    (folder,) = (home / "runs").iterdir() if (home / "runs").is_dir() else (None,)
    if folder is None:
        yield {"table": "refused", "station": "", "row": 0, "is": {"text": notes}}
        return
    if told.live == "killed":
        words = [*PROGRAM, "recover", "runs"]
        recovered = subprocess.run(
            words, cwd=home, env=environment, capture_output=True, check=False
        )
        codes["recover"] = recovered.returncode
    yield {"table": "result", "station": "", "row": 0, "is": codes}
    text = normal.Text(home, folder, served.urls)
    yield from normal.without_timing(normal.lines(folder, text, 0))
    yield from _writes(wires)


def _options(told: History) -> list[str]:
    words = ["--rate", str(told.rate)]
    if told.duration_s is not None:
        words += ["--duration", f"{told.duration_s:g}s"]
    if told.live == "units":
        words += ["--units", "-", "--until-units", str(UNTIL_UNITS)]
    if told.live == "joints":
        words += ["--until-joints", str(UNTIL_JOINTS)]
    return words


def _meet_its_end(run: subprocess.Popen[str], told: History, wires: dict[str, Wire]) -> str:
    """Let the run end as the history says; return what it wrote for people."""
    assert run.stdin is not None
    _wait_for_readings(run, wires, READINGS)
    for wire in wires.values():
        if "silence" in wire.bench.faults:
            wire.cable.silent_from = time.monotonic()
    _wait_for_readings(run, wires, READINGS)
    if told.live == "killed":
        run.send_signal(SIGKILL)
    elif told.live in Signals.__members__:
        run.send_signal(Signals[told.live])
    elif told.live == "units":
        for number in range(UNTIL_UNITS + 1):
            run.stdin.write(f"SN-{number}\n")
            run.stdin.flush()
            _wait_for_readings(run, wires, READINGS + 5 * number)
    return run.communicate(timeout=LONGEST_S)[1]


def _wait_for_readings(run: subprocess.Popen[str], wires: dict[str, Wire], count: int) -> None:
    """Wait until each station that is not silent was asked for its temperature so many times since
    it was told a status.
    """
    until = time.monotonic() + LONGEST_S
    while run.poll() is None and time.monotonic() < until:
        if all(_is_silent(wire) or _readings(wire) >= count for wire in wires.values()):
            return
        time.sleep(0.02)


def _readings(wire: Wire) -> int:
    """Count the temperatures that it was asked for since its last order."""
    count = 0
    for row in [*wire.cable.rows]:
        if row.what == "asked" and b"WPS" in row.data:
            count = 0
        if row.what == "asked" and (b"RTT1" in row.data or b"RAT1" in row.data):
            count += 1
    return count


def _is_silent(wire: Wire) -> bool:
    """Whether it has been silent for some questions."""
    since = wire.cable.silent_from
    asked = sum(row.what == "asked" and row.at > since for row in wire.cable.rows) if since else 0
    return asked > 3


def _wait_for_quiet(wires: dict[str, Wire]) -> None:
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        last = max(wire.cable.rows[-1].at for wire in wires.values())
        if time.monotonic() - last > QUIET_S:
            return
        time.sleep(0.1)


def _writes(wires: dict[str, Wire]) -> Iterator[normal.Line]:
    """Yield what was written to each station, and its state at the end."""
    for name, wire in wires.items():
        row = 0
        before = ("", "", 0)
        for _, *written in wire.cable.written:
            code, data, error = written
            if (code, data, error) != before:  # once more, for its answer came late
                values = {"code": code, "data": data, "error": error}
                yield {"table": "frames", "station": name, "row": row, "is": values}
                row += 1
            before = (code, data, error)
        ports = wire.cable.station.ports
        left = {port: [its.units, its.extractor, its.selected] for port, its in ports.items()}
        state = {"left": left or wire.cable.station.stored("PS1", wire.cable.rows[-1].at)}
        yield {"table": "frames", "station": name, "row": row, "is": state}
