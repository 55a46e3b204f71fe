"""The program explains itself: each verb with an example that works, quickly, and each public name with a docstring."""

from __future__ import annotations

import inspect
import subprocess
import sys
import time
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from command import jbclog
from typer.testing import CliRunner
from verbs import HELP, VERBS, calls, wrong

import jbclog as package
from jbclog.cli.app import app

HELP_S = 0.25
PACKAGE = Path(package.__file__).parent
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


@cache
def shown_here(*arguments: str) -> subprocess.CompletedProcess[str]:
    """What the program says, without a process for each question."""
    ended = CliRunner().invoke(app, arguments, terminal_width=78)  # as in a window of 80
    return subprocess.CompletedProcess(arguments, ended.exit_code, ended.stdout, ended.stderr)


@pytest.mark.parametrize("verb", VERBS)
def test_help_ends_with_an_example_that_could_be_typed(verb: str) -> None:
    shown = shown_here(verb, "--help")
    assert shown.returncode == 0
    assert shown.stderr == ""
    example = HELP[verb].partition("Example:\n")[2].strip()
    assert example in shown.stdout  # on one line, as it would be copied
    (words,) = calls(example)
    assert words[0] == verb
    assert wrong(words) is None


@pytest.mark.parametrize("verb", VERBS)
def test_the_list_of_verbs_shows_each_first_sentence_whole(verb: str) -> None:
    assert HELP[verb].splitlines()[0] in shown_here("--help").stdout


def test_a_process_of_its_own_says_the_same() -> None:
    for arguments in (("--help",), ("run", "-h")):
        shown = jbclog(*arguments)
        assert (shown.returncode, shown.stderr) == (0, "")
        assert (
            shown.stdout.partition("\n\n")[2] == shown_here(*arguments).stdout.partition("\n\n")[2]
        )  # but for the name in "Usage:"


def test_help_names_every_option_that_there_is() -> None:
    for verb, options in VERBS.items():
        shown = shown_here(verb, "-h").stdout
        assert [option for option in options if option not in shown] == []


def test_help_comes_at_once() -> None:
    def took() -> float:
        begun = time.perf_counter()
        subprocess.run(
            [sys.executable, "-c", "from jbclog.cli import main; main()", "--help"], stdout=subprocess.DEVNULL, check=True
        )
        return time.perf_counter() - begun

    assert min(took() for _ in range(5)) < HELP_S


@pytest.mark.parametrize("arguments", [("frobnicate",), ("run",), ("run", "--line"), ("demo", "--seconds", "1"), ("check",)])
def test_wrong_usage_ends_with_2_and_no_traceback(arguments: tuple[str, ...]) -> None:
    ended = jbclog(*arguments)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("module", ["jbclog", *(f"jbclog.{room}" for room in ROOMS)])
def test_public_names_are_documented(module: str) -> None:
    room = import_module(module)
    names = [name for name in getattr(room, "__all__", ()) if name != "__version__"]
    assert [name for name in names if not inspect.getdoc(getattr(room, name))] == []


def test_the_public_names_are_those_that_are_told() -> None:
    assert dir(package) == sorted(package.__all__)
    with pytest.raises(AttributeError, match="it has JbclogError"):
        package.open_the_door  # noqa: B018  # the look-up is the test
