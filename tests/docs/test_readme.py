"""What README.md says is true: its commands run, its tables are the code's, its links lead
somewhere, and it stays short.
"""

from __future__ import annotations

import re
import tomllib

import pytest

from support.command import jbclog
from support.product import package
from support.readers.command_line import VERBS, calls, wrong
from support.readers.texts import (
    DOCS,
    PROSE,
    README,
    ROOT,
    Demo,
    blocks,
    commands,
    links,
    rows,
    section,
)

INSTALL = "python3 -m venv --without-pip .venv && python3 -m pip --python .venv install "
MOST_WORDS = 1300


def test_it_is_short() -> None:
    assert len(README.split()) <= MOST_WORDS


# -- the two commands ------------------------------------------------------------------------------


def test_the_two_commands_are_whole() -> None:
    """`.ci/run` and `.ci/again` take them from this section by their first word."""
    demo, tests = blocks("sh", section("Try it"))
    assert demo == INSTALL + ". && .venv/bin/jbclog demo\n"
    assert tests == INSTALL + "-e '.[test]' && .venv/bin/pytest\n"
    between = README.partition("## Try it")[2].partition("## What")[0]
    assert [line for line in between.splitlines() if line.startswith("python3 ")] == [
        demo.strip(),
        tests.strip(),
    ]


def test_what_they_install_exists() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    texts = [README, *(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))]
    named = {
        extra
        for text in texts
        for extras in re.findall(r"\.\[([\w,]+)\]", text)
        for extra in extras.split(",")
    }
    assert named <= set(project["optional-dependencies"])
    assert project["scripts"] == {"jbclog": "jbclog.cli:main"}


def test_the_demo_says_what_happened_and_where_everything_is(demo: Demo) -> None:
    said = demo.said
    assert "yes  dde-2 lost its cable for 3 s and was recorded again after that" in said
    assert "yes  ucr-1 got too hot and raised its alarm" in said
    assert "would exit with code 1: ucr-1: 1 alarm; the verdict is REJECT." in said
    named = [
        line.split()[1]
        for line in said.splitlines()
        if re.match(r"(report|samples|events|manifest|run) ", line)
    ]
    assert len(named) == 5
    assert all((demo.place / path).exists() for path in named)


# -- tables ----------------------------------------------------------------------------------------


def test_every_verb_has_its_row() -> None:
    assert [cells[0] for cells in rows(section("Commands"))] == [
        f"`jbclog {verb}`" for verb in VERBS
    ]


def test_verbs_and_options_exist() -> None:
    assert [fault for text in commands() for words in calls(text) if (fault := wrong(words))] == []


# -- links -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("link", [link for link in links() if "://" not in link])
def test_a_link_leads_somewhere(link: str) -> None:
    assert (ROOT / link).exists()


def test_paths_in_the_prose_exist() -> None:
    named = re.findall(r"`((?:tests|profiles|jbclog|notebooks|docs|\.ci)/[\w./-]+)`", PROSE)
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_pictures_are_small() -> None:
    pictures = [link for link in links() if link.endswith(".png")]
    assert len(pictures) == 3
    assert sum((ROOT / picture).stat().st_size for picture in pictures) < 150_000


def test_the_version_has_its_place_in_the_changelog() -> None:
    assert f"\n## [{package.__version__}] - 20" in (ROOT / "CHANGELOG.md").read_text()
    assert jbclog("--version").stdout == f"jbclog {package.__version__}\n"
