"""The pages beside the command tables are those that the tables make."""

from __future__ import annotations

from pathlib import Path

import pytest
from pages import PAGES

MAKE = "python tests/support/pages.py"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_is_what_the_tables_make(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path](), f"the tables have changed: {MAKE} writes the pages anew"
    assert MAKE in path.read_text(encoding="utf-8")
