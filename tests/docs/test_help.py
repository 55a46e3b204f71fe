"""The program explains itself: each verb with an example that works, quickly, and each public name
with a docstring.
"""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from support.campaigns.each_row import each_row
from support.command import jbclog
from support.invoked import invoked
from support.product import LOADED_BY_HELP, PACKAGE, help_page, package
from support.readers.command_line import HELP, VERBS, calls, wrong

LOADING_HELP = """
import sys
before = set(sys.modules)
from contextlib import suppress
from jbclog.cli import main
sys.argv[1:] = ["--help"]
with suppress(SystemExit):
    main()
print(*set(sys.modules) - before, file=sys.stderr)
"""
every_verb = each_row((verb, (verb,)) for verb in VERBS)
PACKAGES = sorted(
    ".".join(path.parent.relative_to(PACKAGE).parts) for path in PACKAGE.rglob("*/__init__.py")
)


@cache
def shown_here(*arguments: str) -> subprocess.CompletedProcess[str]:
    """What the program says, without a process for each question."""
    ended = invoked(*arguments, terminal_width=78)  # as in a window of 80
    return subprocess.CompletedProcess(arguments, ended.exit_code, ended.stdout, ended.stderr)


@every_verb
def test_help_ends_with_an_example_that_could_be_typed(verb: str) -> None:
    shown = shown_here(verb, "--help")
    assert shown.returncode == 0
    assert shown.stderr == ""
    example = HELP[verb].partition("Example:\n")[2].strip()
    assert example in shown.stdout  # on one line, as it would be copied
    (words,) = calls(example)
    assert words[0] == verb
    assert wrong(words) is None


@every_verb
def test_the_list_of_verbs_shows_each_first_sentence_whole(verb: str) -> None:
    """The list is a table of its own, so that `--help` loads no command."""
    assert re.search(
        rf"^  {verb} +{re.escape(HELP[verb].splitlines()[0])}$",
        shown_here("--help").stdout,
        re.MULTILINE,
    )


def test_commands_are_listed_in_groups() -> None:
    listed = shown_here("--help").stdout.partition("-h, --help")[2]
    assert re.findall(r"^(\w+):$", listed, re.MULTILINE) == [
        "Record",
        "Stations",
        "Analyse",
        "Maintain",
    ]
    assert set(re.findall(r"^  ([a-z-]+) ", listed, re.MULTILINE)) == set(VERBS)


@every_verb
def test_help_shows_neither_types_of_python_nor_braces(verb: str) -> None:
    shown = shown_here(verb, "--help").stdout
    assert re.findall(r"<\w*[\[>]|\{[A-Z]|LAST_GOOD", shown) == []
    usage, required = (
        shown.splitlines()[0],
        re.findall(r"^  ([A-Z]+) .*\[required\]", shown, re.MULTILINE),
    )
    assert [name for name in required if f" {name}" not in usage] == []


def test_a_process_of_its_own_says_the_same() -> None:
    for arguments in (("--help",), ("run", "-h")):
        shown = jbclog(*arguments)
        assert (shown.returncode, shown.stderr) == (0, "")
        assert (
            shown.stdout.partition("\n\n")[2] == shown_here(*arguments).stdout.partition("\n\n")[2]
        )  # but for the name in "Usage:"


@pytest.mark.parametrize("columns", [20, 52, 66, 79, 80, 81, 200])
def test_the_page_is_the_one_that_the_parser_of_the_command_line_makes(columns: int) -> None:
    made = invoked("--help", prog_name="jbclog", terminal_width=max(min(columns, 80) - 2, 50))
    assert help_page("jbclog", columns) + "\n" == made.stdout


def test_help_that_nobody_reads_ends_as_other_output_does() -> None:
    with Path("/dev/full").open("w") as full:
        ended = [
            subprocess.run(
                [sys.executable, "-m", "jbclog", *words],
                stdout=full,
                stderr=subprocess.PIPE,
                check=False,
            ).returncode
            for words in (["--help"], ["--help", "--version"])
        ]
    assert ended[0] == ended[1] != 0


def test_help_names_every_option_that_there_is() -> None:
    for verb, options in VERBS.items():
        shown = shown_here(verb, "-h").stdout
        assert [option for option in options if option not in shown] == []


def test_help_loads_no_more_than_what_prints_it() -> None:
    """Which makes it quick; how quick, `tests/bench/bench_start.py` measures."""
    done = subprocess.run(
        [sys.executable, "-c", LOADING_HELP],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        check=True,
    )
    loaded = [name.split(".") for name in done.stderr.decode().split()]
    assert {package for package, *_ in loaded} - sys.stdlib_module_names == {"jbclog"}
    own = {".".join(rest) for package, *rest in loaded if package == "jbclog" and rest}
    assert own == LOADED_BY_HELP


@pytest.mark.parametrize(
    "arguments",
    [("frobnicate",), ("run",), ("run", "--line"), ("demo", "--seconds", "1"), ("check",)],
)
def test_wrong_usage_ends_with_2_and_no_traceback(arguments: tuple[str, ...]) -> None:
    ended = jbclog(*arguments)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert "Traceback" not in ended.stderr


@each_row(
    (module, (module,))
    for module in ["jbclog", "jbclog.spc", *(f"jbclog.{name}" for name in PACKAGES)]
)
def test_public_names_are_documented(module: str) -> None:
    room = import_module(module)
    names = [name for name in getattr(room, "__all__", ()) if name != "__version__"]
    assert [name for name in names if not inspect.getdoc(getattr(room, name))] == []


def test_the_public_names_are_those_that_are_told() -> None:
    assert dir(package) == sorted(package.__all__)
    with pytest.raises(AttributeError, match="it has JbclogError"):
        package.open_the_door  # noqa: B018  # the look-up is the test
