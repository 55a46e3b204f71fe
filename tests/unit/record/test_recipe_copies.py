"""A link in the place of a run's recipes is not followed, whoever reads them; the run is answered
all the same.
"""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import pytest

from jbclog.core.errors import Problems
from jbclog.core.files import NotReadable
from jbclog.record.folder import joints_asked, recipe_copies, recipe_copy
from jbclog.record.manifest import read_manifest
from support.invoked import invoked
from support.records.small_run import make_run


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("runs"), 4.0)


@pytest.fixture
def linked(made: Path, tmp_path: Path) -> Path:
    """A run whose recipes lie elsewhere, as they were, behind a link."""
    folder = copytree(made, tmp_path / "runs" / made.name)
    (folder / "recipes").rename(tmp_path / "elsewhere")
    (folder / "recipes").symlink_to(tmp_path / "elsewhere")
    return folder


def test_they_are_not_read_behind_a_link(linked: Path) -> None:
    facts = read_manifest(linked).stations[0]
    assert facts.recipe is not None
    for read in (lambda: recipe_copy(linked, facts.recipe or ""), lambda: recipe_copies(linked)):
        with pytest.raises(NotReadable, match="recipes/ is a link, not a folder"):
            read()
    assert joints_asked(linked, facts) == {}


def test_what_is_nested_too_deeply_in_their_place_is_no_recipe(made: Path, tmp_path: Path) -> None:
    folder = copytree(made, tmp_path / "runs" / made.name)
    facts = read_manifest(folder).stations[0]
    text = "joints = " + "[" * 30_000 + "]" * 30_000
    recipe_copy(folder, facts.recipe or "").write_text(text, encoding="utf-8")
    assert joints_asked(folder, facts) == {}
    with pytest.raises(Problems):
        recipe_copies(folder)


@pytest.mark.parametrize("verb", ["check", "report", "compare"])
def test_each_verb_answers_in_a_line(linked: Path, verb: str) -> None:
    more = {"compare": [str(linked)]}
    words = [verb, str(linked), *more.get(verb, [])]
    result = invoked(*words)
    assert "internal error" not in result.output
    assert not isinstance(result.exception, OSError)
    if verb == "check":
        assert result.exit_code != 0
        assert "recipes" in result.output
