"""A link that is faster than its line file states: a station at 57600 or 115200 bit/s behind a real
TCP server.

A scan cannot set a rate there, so it assumes 19200 8N1 and writes that; answers arrive sooner than
that rate allows.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.command import RECIPE, jbclog
from support.invoked import invoked
from support.product import SimProcess, check_run, load_line


@contextmanager
def served(folder: Path, baudrate: int) -> Iterator[str]:
    """Serve a virtual UCR at `baudrate` behind a TCP server; return its URL."""
    keys = (
        'name = "ucr-1"\nurl = "ucr-1"\nfamily = "ucr"\nbaudrate ='
        f" {baudrate}\n[station.sim]\nturnaround_ms = 0.5\n"
    )
    (folder / "bench.toml").write_text(f'[line]\nname = "bench"\n[[station]]\n{keys}')
    with SimProcess(folder / "bench.toml", folder / "virtual", tcp="127.0.0.1:0") as sim:
        yield load_line(sim.line_path).stations[0].url


@pytest.mark.parametrize("baudrate", [57600, 115200])
def test_the_line_file_is_written_and_says_it(tmp_path: Path, baudrate: int) -> None:
    file = tmp_path / "line.toml"
    with served(tmp_path, baudrate) as url:
        for _ in range(6):  # on a busy machine the answers come later than the stated rate allows
            scan = jbclog("scan", url, "--write", file, "--force")
            assert scan.returncode == 0, scan.stderr
            if "0.00 ms median" in scan.stdout:
                break
    assert "0.00 ms median" in scan.stdout
    assert (
        "the link is faster than its stated 19200 8N1: a question and its answer take"
        in scan.stdout
    )
    assert load_line(file).stations[0].turnaround_ms == 0.0
    assert "# The link is faster than its stated 19200 8N1" in file.read_text()


def test_every_command_takes_it(tmp_path: Path) -> None:
    """A stated rate that is too low costs only speed: each command works, no time is negative."""
    file, stated = tmp_path / "line.toml", 9600
    with served(tmp_path, 115200) as url:
        keys = (
            f'name = "ucr-1"\nurl = "{url}"\nfamily = "ucr"\nbaudrate = {stated}\nturnaround_ms'
            " = 0\n"
        )
        file.write_text(f'[line]\nname = "bench"\n[[station]]\n{keys}')
        plan = invoked("plan", "--verbose", RECIPE, "--line", file, "--rate", "fit")
        assert f"at 0 ms the link may be faster than {stated} 8N1" in plan.stdout, plan.stderr
        doctor = invoked("doctor", "--line", file, "--out", tmp_path)
        assert f"(the link is faster than its stated {stated} 8N1" in doctor.stdout
        read = invoked("read", "ucr-1", "--all", "--line", file)
        assert read.exit_code == 0, read.stderr
        audit = invoked("audit", "--line", file, "--ledger", tmp_path / "ledger.sqlite")
        assert audit.exit_code == 0, audit.stderr
        for rate, seconds in (("fit", "1s"), ("max", "0.3s")):
            words = (
                "run",
                RECIPE,
                "--line",
                file,
                "--out",
                tmp_path / "runs",
                "-d",
                seconds,
                "--rate",
                rate,
                "--json",
            )
            run = jbclog(*words)
            assert json.loads(run.stdout)["safe_state"]["ucr-1"] == {"1": "verified"}, run.stderr
            folder = Path(json.loads(run.stdout)["folder"])
            assert check_run(folder) == []
            (station,) = json.loads((folder / "manifest.json").read_text())["stations"]
            assert station["turnaround_us"]["median"] == 0.0 <= station["turnaround_us"]["p99"]
            assert station["turnaround_us"]["faster_by"] > 1000
            assert (
                f"answers in 0.00 ms (median) (the link is faster than its stated {stated} 8N1"
                in _ready(folder)
            )


def _ready(folder: Path) -> str:
    import pandas as pd

    events = pd.read_parquet(folder / "events")
    return str(events.loc[events["kind"] == "station.ready", "text"].iloc[0])
