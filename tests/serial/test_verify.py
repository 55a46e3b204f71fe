"""`jbclog verify` on a real pseudo-terminal reads the station and writes nothing to it."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from support.command import WireLog, jbclog, started
from support.invoked import invoked
from support.product import patch, read_verification_book

SAID = ("--instrument", "TC-7", "--due", "2099-03-01", "--tip", "T-17", "--by", "A. Rossi")
SIM = "joints_per_minute = 60\nsensor_error_c = 9\nnoise_c = 0.4\nambient_c = 60"


def test_a_tip_is_verified_and_the_station_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, log = tmp_path / "source.toml", tmp_path / "wire.jsonl"
    source.write_text(
        '[line]\nname = "l"\n[[station]]\nname = "ucr-1"\nurl = "ucr-1"\nfamily ='
        f' "ucr"\n[station.sim]\n{SIM}\n'
    )
    patch(monkeypatch, "read.EVERY_S", 0.1)
    stations = started("sim", source, "--no-joints", "--dir", tmp_path / "bench", "--log", log)
    try:
        assert stations.stdout is not None
        line = stations.stdout.readline().strip()
        assert (
            jbclog("write", "ucr-1", "status", "working", "-p", "1", "--line", line).returncode == 0
        )
        words = [
            "verify",
            "ucr-1",
            "-p",
            "1",
            "--reading",
            "341",
            *SAID,
            "--line",
            line,
            "--out",
            str(tmp_path / "runs"),
        ]
        for _ in range(40):  # until it is hot; a second each
            ended = invoked(*words)
            if ended.exit_code != 3:
                break
            assert "is not stable" in ended.stderr, ended.stderr
    finally:
        stations.send_signal(signal.SIGINT)
        stations.communicate(timeout=60)
    assert ended.exit_code == 0, ended.stderr
    (kept,) = read_verification_book(tmp_path / "runs").all
    assert kept.offset_c == pytest.approx(-9, abs=1.5)
    assert 0 < (kept.station_sd_c or 0) < 1.5
    assert WireLog(log).writes("ucr-1") == ["WPS100000"]
