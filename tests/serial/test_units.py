"""Serials of units, entered during a run on real pipes and terminals, as by barcode readers."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from support.command import RECIPE, WireLog, is_sampling, jbclog, only_run, sampled, until
from support.product import MAIN, Manifest, check_run, open_run, read_manifest
from support.warm_start import Warm

Bench = tuple[Path, WireLog]
INTERPRETER = (sys.executable, "-c", MAIN)


def arguments(line: Path, out: Path, *more: str) -> list[str]:
    words = ["run", RECIPE, "--line", line, "--out", out, "-s", "ucr-1", "--rate", "2", *more]
    return [*map(str, words)]


def told_of_units(out: Path, count: int) -> bool:
    """Wait until `count` events of units are committed; return False on a time-out."""
    return until(
        lambda: (
            sum(kind.startswith("unit.") for kind in open_run(only_run(out)).events()["kind"])
            == count
        )
    )


def serials(manifest: Manifest) -> list[str]:
    return [unit.unit for unit in manifest.units]


def end(run: subprocess.Popen[str]) -> str:
    run.send_signal(signal.SIGINT)
    _, notes = run.communicate(timeout=200)
    return notes


def fresh(words: Sequence[str], stdin: int | IO[bytes]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        words, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@contextmanager
def running(*words: str, stdin: int | IO[bytes]) -> Iterator[subprocess.Popen[str]]:
    with Warm(words, stdin=stdin) if words[0] == "run" else fresh(words, stdin) as run:
        try:
            yield run
        finally:
            run.kill()


def test_lines_of_a_reader_begin_units(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    out = tmp_path / "runs"
    with running(*arguments(line, out, "--units", "-"), stdin=subprocess.PIPE) as run:
        assert run.stdin is not None
        assert until(lambda: is_sampling(out))
        # the last ends one and begins one
        for typed, told in (("SN-1\r\n", 1), ("SN-1\n", 2), ("\n", 2), ("SN\x1d2\n", 4)):
            run.stdin.write(typed)
            run.stdin.flush()
            assert told_of_units(out, told)
        seen = sampled(out)
        assert until(lambda: sampled(out) > seen)
        notes = end(run)
    folder = only_run(out)
    manifest = read_manifest(folder)
    first, second = manifest.units
    assert (first.unit, second.unit) == ("SN-1", "SN\\x1d2")
    assert first.stop == second.start
    assert second.stop is not None
    assert second.stop > second.start
    assert "run: Unit SN-1 begins." in notes
    assert check_run(folder) == []
    found = jbclog("runs", out, "--unit", "SN\\x1d2")
    assert found.stdout.splitlines()[1].endswith(folder.name)
    samples = open_run(folder).samples(columns=["time"])
    units = open_run(folder).unit_at(samples["time"])
    assert set(units.dropna()) <= {"SN-1", "SN\\x1d2"}
    assert units.iloc[-1] == "SN\\x1d2"


@pytest.mark.parametrize(
    "given", ["closed", pytest.param("a pipe that ends", marks=pytest.mark.campaign)]
)
def test_a_stdin_that_ends_ends_nothing_else(bench: Bench, tmp_path: Path, given: str) -> None:
    line, _ = bench
    out = tmp_path / "runs"
    words = arguments(line, out, "--units", "-", "-d", "2s")
    if given == "closed":
        words = ["sh", "-c", 'exec "$@" <&-', "sh", *INTERPRETER, *words]
    with running(
        *words, stdin=subprocess.PIPE if given == "a pipe that ends" else subprocess.DEVNULL
    ) as run:
        notes = run.communicate("SN-1\nSN-2" if given == "a pipe that ends" else None, timeout=200)[
            1
        ]
    manifest = read_manifest(only_run(out))
    assert manifest.exit_status == "success", notes
    assert serials(manifest) == (["SN-1", "SN-2"] if given == "a pipe that ends" else [])
    assert "No more serials come from stdin, which was closed" in notes


@pytest.mark.campaign
def test_a_flood_does_not_hold_up_a_run(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    out = tmp_path / "runs"
    with subprocess.Popen(["yes", "SN-1"], stdout=subprocess.PIPE) as flood:
        assert flood.stdout is not None
        with running(*arguments(line, out, "--units", "-", "-d", "2s"), stdin=flood.stdout) as run:
            run.communicate(timeout=200)
        flood.kill()
    folder = only_run(out)
    manifest = read_manifest(folder)
    assert manifest.exit_status == "success"
    assert serials(manifest) == ["SN-1"]
    assert manifest.stations[0].skipped == 0
    assert len(open_run(folder).events()) < 400


def test_a_serial_that_was_read_before_is_refused_where_the_recipe_says_so(
    bench: Bench, tmp_path: Path
) -> None:
    """END is echoed as well, because a pipe does not show what is typed."""
    line, _ = bench
    out, recipe = tmp_path / "runs", tmp_path / "recipe.toml"
    recipe.write_text(RECIPE.read_text() + '\n[units]\nrepeat = "refuse"\n')
    words = [
        recipe if word == str(RECIPE) else word
        for word in arguments(line, out, "--units", "-", "--until-units", "3")
    ]
    with running(*map(str, words), stdin=subprocess.PIPE) as run:
        assert run.stdin is not None
        assert until(lambda: is_sampling(out))
        for typed, told in (("SN-1", 1), ("SN-2", 3), ("SN-1", 5), ("SN-3", 6), ("END", None)):
            run.stdin.write(typed + "\n")
            run.stdin.flush()
            if told is not None:
                assert told_of_units(out, told)
                seen = sampled(out)
                # more than a second at 2 Hz after it, be rows committed a second after their time
                assert until(lambda seen=seen: sampled(out) > seen + 6)
        _, notes = run.communicate(timeout=200)
    assert "error     run: Serial SN-1 was read before, at 20" in notes
    assert "SN-2 read again continues that one" in notes
    assert "run: END was read: unit SN-3 is finished. Units finished: 3, wanted: 3." in notes
    assert "run: Units finished: 3, wanted: 3; the run ends." in notes
    folder = only_run(out)
    assert serials(read_manifest(folder)) == ["SN-1", "SN-2", "SN-3"]
    events, samples = open_run(folder).events(), open_run(folder).samples(columns=["time"])
    (refused,) = events.loc[events["kind"] == "unit.repeated", "time"]
    (third,) = events.loc[(events["kind"] == "unit.begin") & (events["raw"] == "SN-3"), "time"]
    between = samples["time"][(samples["time"] > refused) & (samples["time"] < third)]
    assert len(between) > 3
    assert open_run(folder).unit_at(between).isna().all()


# -- on a terminal ---------------------------------------------------------------------------------


class Terminal:
    """A terminal with a program, and its screen."""

    def __init__(self, *words: str) -> None:
        self._ours, self._theirs = pty.openpty()
        self.run = subprocess.Popen(
            words,
            stdin=self._theirs,
            stdout=self._theirs,
            stderr=self._theirs,
            start_new_session=True,
            preexec_fn=self._take,
        )
        self.shown = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _take(self) -> None:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    def _read(self) -> None:
        while True:
            try:
                self.shown += os.read(self._ours, 4096)
            except OSError:
                return

    @property
    def echoes(self) -> bool:
        return bool(termios.tcgetattr(self._theirs)[3] & termios.ECHO)

    def type(self, text: str) -> None:
        os.write(self._ours, text.encode())

    def close(self) -> None:
        self.run.kill()
        self.run.wait(60)
        os.close(self._theirs)
        os.close(self._ours)


def test_a_reader_types_beside_the_table_without_spoiling_it(bench: Bench, tmp_path: Path) -> None:
    line, _ = bench
    out = tmp_path / "runs"
    terminal = Terminal(*INTERPRETER, *arguments(line, out, "--units", "-", "--until-units", "9"))
    try:
        assert until(lambda: is_sampling(out)), (terminal.run.poll(), terminal.shown)
        assert not terminal.echoes
        terminal.type("SN-1\r")
        assert until(lambda: b"Unit SN-1 begins" in terminal.shown)
        terminal.type("SN-2\r")
        assert until(lambda: b"Unit SN-2 begins" in terminal.shown)
        terminal.type("END\r")
        assert until(lambda: b"END was read: unit SN-2" in terminal.shown)
        terminal.type("\x03")  # Ctrl-C
        assert until(lambda: terminal.run.poll() is not None)
        assert terminal.echoes
    finally:
        terminal.close()
    assert terminal.shown.count(b"Unit SN-1 begins") == 1
    # as an event or in the table's heading, and not as it was typed
    assert not re.search(rb"(?<!unit )(?<!Unit )SN-1", terminal.shown)
    assert serials(read_manifest(only_run(out))) == ["SN-1", "SN-2"]
