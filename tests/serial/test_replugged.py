"""Adapters that come back under another name, or under each other's name, on real pseudo-terminals
with links as udev makes them.

By default one adapter gets another number; ``pytest -n0 -m campaign
tests/serial/test_replugged.py`` swaps two, ten times.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from support.command import started, until
from support.product import check_run
from support.virtual.served_line import ServedLine

EXIT_STATION = 3
OUT_S, FOR_S, RUN_S = 9.0, 2.5, 16  # a busy machine takes seconds until its first sample
STATION = """
[[station]]
name = "{name}"
url = "{name}"
family = "dde"
ports = [1]
[station.sim]
counters = {{plugged_hours = {hours}}}
[[station.sim.fault]]
kind = "dropout"
at_s = {out_s}
for_s = {for_s}
"""


def line(**hours: int) -> str:
    stations = (
        STATION.format(name=name, hours=hours[name], out_s=OUT_S, for_s=FOR_S) for name in hours
    )
    return '[line]\nname = "udev"\n' + "".join(stations)


class Udev:
    """Links by which the recorder finds the adapters."""

    def __init__(self, folder: Path, served: ServedLine) -> None:
        self.folder, self.line, self._served = folder, folder / "line.toml", served
        folder.mkdir()
        text = served.path.read_text()
        for name in served.stations:
            text = text.replace(f'"{served.url(name)}"', f'"{folder / name}"')
            self.name(name, name)
        self.line.write_text(text)

    def name(self, name: str, end: str) -> None:
        """Let `name` lead to the adapter at `end` from now on."""
        link = self.folder / name
        link.unlink(missing_ok=True)
        link.symlink_to(self._served.url(end))

    def device(self, name: str) -> str:
        """Return the target of the link; empty while the adapter is out."""
        path = self.folder / name
        return os.path.realpath(path) if path.exists() else ""


def run(
    udev: Udev, served: ServedLine, out: Path, meanwhile: Callable[[], object]
) -> tuple[int, Path]:
    """Run `jbclog run`, and call `meanwhile` when the adapters are out; return exit code and
    folder.
    """
    recorder = started(
        "run", served.recipe, "--line", udev.line, "--out", out, "-d", f"{RUN_S}s", "--rate", "fit"
    )
    assert until(lambda: all(not udev.device(name) for name in served.stations), every_s=0.01)
    meanwhile()
    said, errors = recorder.communicate(timeout=200)
    assert "Traceback" not in errors
    return recorder.returncode, Path(said.splitlines()[-1])


def kinds(folder: Path, station: str) -> list[str]:
    events = pd.read_parquet(folder / "events")
    return list(events.loc[events["station"] == station, "kind"])


def assert_only_asked_writes(served: ServedLine) -> None:
    """The stations accepted only settings of the recipe and status words."""
    names = {write.name for station in served.stations.values() for write in station.log.writes}
    assert names <= {"selected_temperature", "sleep_delay", "hibernation_delay", "status"}


def take_number(device: str, held: list[int]) -> bool:
    """Hold the pseudo-terminal with this number, after all lower ones, which the system gives
    first. Return False if another process has it.
    """
    while True:
        ours, theirs = os.openpty()
        taken = os.ttyname(theirs)
        if int(Path(taken).name) > int(Path(device).name):
            os.close(ours)
            os.close(theirs)
            return False
        held += [ours, theirs]
        if taken == device:
            return True


def test_an_adapter_comes_back_under_another_name(tmp_path: Path) -> None:
    """A trial shows nothing if another test holds the number during the outage and frees it in
    time, or if a busy machine starts sampling after the outage.
    """
    assert any(renamed(tmp_path / str(trial)) for trial in range(4))


def renamed(tmp_path: Path) -> bool:
    """Return True if the adapter came back under another name; then also check the recorder."""
    tmp_path.mkdir()
    with ServedLine(tmp_path, line(one=100)) as served:
        udev = Udev(tmp_path / "dev", served)
        before, held = udev.device("one"), list[int]()
        code, folder = run(
            udev,
            served,
            tmp_path / "runs",
            lambda: until(lambda: take_number(before, held), FOR_S / 2, every_s=0.01),
        )
        after = udev.device("one")
        for descriptor in held:
            os.close(descriptor)
        if before == after or code == EXIT_STATION:
            return False
        assert code == 0
        told = kinds(folder, "one")
        # a busy machine may lose it once more
        assert told.count("link.lost") == told.count("link.back") >= 1
        assert "identity.changed" not in told
        assert check_run(folder) == []
        assert_only_asked_writes(served)
        assert served.at_work() == 0
        return True


def swapped(tmp_path: Path, trial: int) -> None:
    folder = tmp_path / str(trial)
    folder.mkdir()
    with ServedLine(folder, line(one=100, two=5000)) as served:
        udev = Udev(folder / "dev", served)

        def swap() -> None:
            udev.name("one", "two")
            udev.name("two", "one")

        code, run_folder = run(udev, served, folder / "runs", swap)
        assert code == 5  # neither can be told to stand, which is said
        for name, hours in (("one", 100), ("two", 5000)):
            assert "identity.changed" in kinds(run_folder, name)
            assert "link.back" not in kinds(run_folder, name)
            counters = pd.read_parquet(run_folder / "counters")
            own = counters[(counters["station"] == name) & (counters["counter"] == "plugged_h")]
            assert set(own["value"].dropna()) == {hours}
        assert check_run(run_folder) == []
        assert_only_asked_writes(served)


@pytest.mark.campaign
@pytest.mark.timeout(900)
def test_two_adapters_swap_their_names(tmp_path: Path, counted: Callable[..., None]) -> None:
    for trial in range(10):
        swapped(tmp_path, trial)
    counted(pairs_swapped=10, resumed_as_the_wrong_one=0, values_of_the_other=0)
