"""What the shell offers for `read` and `write`: asked for as the shell does, through the program's
own variable.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from jbclog.cli.app import app
from jbclog.protocol.commands.family import FAMILIES
from support.virtual.manual import Make, station_text

AS_INSTALLED = "import sys; sys.argv[0] = 'jbclog'; from jbclog.cli import main; main()"
BENCH = (
    station_text("dde-1", "dde"),
    station_text("ale-1", "ale"),
    station_text("x", "auto", sim='model = "UCR245"'),
)


def offered(words: str) -> list[str]:
    """What a bash with `words` typed, the last of them incomplete, would offer."""
    count = len(words.split(" ")) - 1
    variables = {"_JBCLOG_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(count)}
    ended = CliRunner().invoke(app, env=variables, prog_name="jbclog")
    return ended.stdout.split()


def with_help(words: str) -> dict[str, str]:
    """What a fish would offer, with the help beside each."""
    variables = {
        "_JBCLOG_COMPLETE": "complete_fish",
        "_TYPER_COMPLETE_ARGS": words,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    ended = CliRunner().invoke(app, env=variables, prog_name="jbclog")
    return dict(line.partition("\t")[::2] for line in ended.stdout.splitlines())


def test_stations_come_from_the_line_file(make: Make) -> None:
    bench = make(*BENCH)
    assert offered(f"jbclog read --line {bench.line} ") == ["dde-1", "ale-1", "x"]
    assert offered(f"jbclog write --line {bench.line} d") == ["dde-1"]
    assert offered("jbclog read ") == ["dde-1", "ale-1", "x"]  # line.toml is in this folder
    bench.line.rename("other.toml")
    assert offered("jbclog read ") == []
    assert offered("jbclog read --line nowhere.toml ") == []


def test_signals_are_those_of_the_station_s_family(make: Make) -> None:
    make(*BENCH)
    assert offered("jbclog read --line line.toml dde-1 ti") == ["tip_temperature", "time_to_sleep"]
    assert offered("jbclog read --line line.toml dde-1 feed") == []
    assert "feeding" in offered("jbclog read --line line.toml ale-1 feed")
    everything = {
        name
        for family in FAMILIES.values()
        for name, command in family.commands.items()
        if command.readable
    }
    # its family is not known yet
    assert set(offered("jbclog read --line line.toml x ")) == everything
    assert set(offered("jbclog read nobody ")) == everything


def test_settings_are_what_can_be_written(make: Make) -> None:
    make(*BENCH)
    dde = FAMILIES["dde"].commands.values()
    assert offered("jbclog write --line line.toml dde-1 ") == [
        command.name for command in dde if command.writable
    ]


def test_the_help_beside_a_name_has_unit_and_range(make: Make) -> None:
    make(*BENCH)
    told = with_help("jbclog write --line line.toml dde-1 ")
    assert told["adjust"] == "°C, per tool; -50 to 50 °C, in steps of 1"
    assert told["status"] == "per port; working, stand, extractor"
    assert told["restart"] == "per station; no value (dangerous)"
    assert with_help("jbclog read --line line.toml dde-1 tip")["tip_temperature"] == "°C, per port"


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("dde-1 status ", ["working", "stand", "extractor"]),
        ("ale-1 status e", ["extractor"]),
        ("ale-1 feeder_mode ", ["continuous", "discontinuous", "program", "reload"]),
        ("ale-1 clog_detection ", ["off", "on"]),
        ("dde-1 sleep_delay ", ["off"]),
        ("dde-1 selected_temperature ", []),
        ("dde-1 nonsense ", []),
    ],
)
def test_words_that_a_setting_takes_are_offered(make: Make, words: str, values: list[str]) -> None:
    make(*BENCH)
    assert offered(f"jbclog write --line line.toml {words}") == values


def test_the_name_that_is_to_be_meant_is_a_station_s(make: Make) -> None:
    make(*BENCH)
    assert offered("jbclog write --line line.toml dde-1 restart --yes-i-mean d") == ["dde-1"]


def test_the_program_itself_completes(make: Make) -> None:
    bench = make(*BENCH)
    variables = {
        "_JBCLOG_COMPLETE": "complete_bash",
        "COMP_WORDS": "jbclog read --line line.toml al",
        "COMP_CWORD": "4",
    }
    ended = subprocess.run(
        [sys.executable, "-c", AS_INSTALLED],
        env=os.environ | variables,
        cwd=bench.line.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.stdout, ended.stderr) == ("ale-1\n", "")
