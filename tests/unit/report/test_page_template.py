"""The template engine: compiled templates are kept, and never used where they may be others."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from jinja2 import Environment

from jbclog.report import page_template

PACKAGE = "jbclog.report"
NAME = "style.css"


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of compiled templates, empty."""
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    folder = tmp_path / Path(page_template.__file__).parent.relative_to("/")
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the templates that are compiled."""
    names, compile_one = list[str](), Environment.compile

    def noted(self: Environment, source: str, name: str, filename: str) -> object:
        names.append(name)
        return compile_one(self, source, name, filename)

    monkeypatch.setattr(Environment, "compile", noted)
    return names


def text() -> str:
    return page_template.environment(PACKAGE).get_template(NAME).render()


def test_a_template_is_compiled_once(kept: Path, compiled: list[str]) -> None:
    first = text()
    assert len([*kept.iterdir()]) == 1
    assert text() == first
    assert compiled == [NAME]


def test_that_of_another_version_is_not_used(
    kept: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text()
    monkeypatch.setattr(page_template, "__version__", "9.9.9")
    text()
    assert compiled == [NAME, NAME]


@pytest.mark.parametrize("length", [0, 5, 40, 200])
def test_one_that_is_cut_off_is_not_used(length: int, kept: Path, compiled: list[str]) -> None:
    first = text()
    (file,) = kept.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:length])
    assert text() == first
    assert compiled == [NAME, NAME]
    assert file.read_bytes() == whole


def test_none_is_kept_where_python_keeps_none(
    kept: Path, compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert text()
    assert [*kept.iterdir()] == []


def test_a_folder_that_is_missing_is_no_error(kept: Path, compiled: list[str]) -> None:
    kept.rmdir()
    assert text()
    assert not kept.exists()
