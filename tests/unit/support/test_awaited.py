"""Each sentence that a campaign awaits is written by the program."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import jbclog
from support.campaigns import awaited

SENTENCES = {name: text for name, text in vars(awaited).items() if isinstance(text, str)}
ON_THE_NEXT_LINE = re.compile(r'"\n\s*f?"')


@pytest.fixture(scope="module")
def written() -> str:
    """The program, its long texts without the ends of lines in them."""
    files = sorted(Path(jbclog.__file__).parent.rglob("*.py"))
    return "".join(ON_THE_NEXT_LINE.sub("", path.read_text("utf-8")) for path in files)


@pytest.mark.parametrize("name", [name for name in SENTENCES if name.isupper()])
def test_the_program_writes_it(name: str, written: str) -> None:
    assert SENTENCES[name] in written
