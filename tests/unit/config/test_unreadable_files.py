"""What is no line file or recipe is refused with a sentence: other bytes, pipes, links to nothing.

docs/reference/faults.md, F-33.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.config.line import load_line, parse_line
from jbclog.config.load_recipe import load_recipe, parse_recipe
from jbclog.core.errors import Problems
from jbclog.core.toml import MAX_BYTES

READERS: dict[str, Callable[[str, Path], object]] = {"recipe": parse_recipe, "line": parse_line}


def refused(read: Callable[[str, Path], object], text: str) -> Problems:
    with pytest.raises(Problems) as found:
        read(text, Path("x.toml"))
    return found.value


@given(st.text(max_size=300))
def test_any_text_at_all_is_refused_with_sentences_that_are_safe_to_print(text: str) -> None:
    for read in READERS.values():
        sentences = str(refused(read, text))
        assert all(sign == "\n" or sign.isprintable() for sign in sentences)


# -- not files at all ------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [load_recipe, load_line])
@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"#" * (MAX_BYTES + 1), "has 65537 bytes; a line, recipe or jobs file has at most 65536"),
    ],
)
def test_a_file_of_the_wrong_kind_is_refused(
    tmp_path: Path, load: Callable[[Path], object], data: bytes, sentence: str
) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(data)
    with pytest.raises(Problems) as found:
        load(path)
    assert [problem.text for problem in found.value.problems] == [sentence]


@pytest.mark.parametrize("load", [load_recipe, load_line])
def test_what_is_no_file_is_refused_and_never_waited_for(
    tmp_path: Path, load: Callable[[Path], object]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, sentence in {
        "pipe": "is a pipe, not a file",
        ".": "is a folder, not a file",
        "missing": "No such file or directory",
        "loop": "Too many levels of symbolic links",
        "a\0b": "is not a file's name",
    }.items():
        with pytest.raises(Problems) as found:
            load(tmp_path / name)
        assert [problem.text for problem in found.value.problems] == [sentence]
    with pytest.raises(Problems):
        load(Path("/dev/zero"))


def test_a_file_of_the_greatest_size_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    head = b'[recipe]\nname = "x"\nrevision = 1\nfamilies = ["dde"]\n#'
    path.write_bytes(head + b"x" * (MAX_BYTES - len(head)))
    assert load_recipe(path).name == "x"


def test_what_is_nested_too_deeply_is_refused() -> None:
    for text in ("a = " + "[" * 5_000 + "]" * 5_000, "a = " + "{a = " * 5_000 + "1" + "}" * 5_000):
        for read in READERS.values():
            (problem,) = refused(read, text).problems
            assert problem.text == "is nested too deeply"
