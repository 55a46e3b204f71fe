"""Files made to hang, crash or deceive: refused within 200 ms, in little memory, with a sentence.

docs/reference/faults.md, F-33 and F-34.
"""

from __future__ import annotations

import os
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.config.line import load_line, parse_line
from jbclog.config.load_recipe import load_recipe, parse_recipe
from jbclog.core.errors import Problems
from jbclog.core.toml import MAX_BYTES, MAX_ENTRIES, MAX_PROBLEMS

SECONDS = 0.2
BYTES = 64 * 1024 * 1024
DOTTED = "a" + ".b" * 20_000
ENTRIES = MAX_ENTRIES - 10

HOSTILE = {
    "dotted key": DOTTED + " = 1",
    "dotted key behind a comment with a quote": f'# "\n{DOTTED} = 1',
    "dotted key behind a comment with three quotes": f'# """\n{DOTTED} = 1',
    "dotted key behind a long string": f'x = """ # """\n{DOTTED} = 1',
    "dotted key behind a string with an escaped quote": f'x = "\\"" # "\n{DOTTED} = 1',
    "dotted key behind a literal string": f"x = '\\'\n{DOTTED} = 1 # '",
    "dotted key behind an escape": f'"\\u0061".{DOTTED} = 1',
    "dotted key with blanks": "a" + " . b" * 15_000 + " = 1",
    "dotted key, quoted": '"a"' + '."b"' * 16_000 + " = 1",
    "dotted key in a table": f"x = {{ {DOTTED} = 1 }}",
    "dotted header": f"[{DOTTED}]",
    "dotted header of a list": f"[[{DOTTED}]]",
    "many dotted keys": "".join(f"a.b.c.d.e.f.g.k{place} = 1\n" for place in range(2_600)),
    "many deep headers": "".join(f"[a.b.c.d.e.f.g.k{place}]\n" for place in range(3_000)),
    "nested lists": "a = " + "[" * 5_000 + "]" * 5_000,
    "nested lists without end": "a = " + "[" * 60_000,
    "nested tables": "a = " + "{a = " * 5_000 + "1" + "}" * 5_000,
    "a list of lists": "a = [" + "[]," * (ENTRIES - 1) + "]",
    "many keys": "".join(f"k{place} = 0\n" for place in range(ENTRIES)),
    "many keys in one table": "a = {" + ",".join(f"k{place} = 0" for place in range(ENTRIES)) + "}",
    "many stations": "[[station]]\n" * ENTRIES,
    "many wrong stations": '[[station]]\nname = ""\n' * 1_900,
    "many ports": "".join(f"[port.{place}.sleep]\nx = 1\n" for place in range(1_900)),
    "many families": "[recipe]\nfamilies = [" + '"x",' * ENTRIES + "]",
    "many tags": (
        "[metadata]\nrequired = [" + "".join(f'"tag.{place}",' for place in range(ENTRIES)) + "]"
    ),
    "many faults": "[[station]]\n" + '[[station.sim.fault]]\nkind = "none"\n' * 1_600,
    "many headers": "".join(f"[k{place}]\n" for place in range(ENTRIES)),
    "one key many times": "a = 1\n" * ENTRIES,
    "one table many times": "[a]\n" * ENTRIES,
    "a long name": "k" * 60_000 + " = 1",
    "a long quoted name": '"' + "k" * 60_000 + '" = 1',
    "a long number": "a = " + "9" * 60_000,
    "a long hexadecimal number": "a = 0x" + "f" * 60_000,
    "a large number": "[recipe]\nrevision = " + "9" * 63,
    "a long fraction": "a = 1." + "1" * 60_000,
    "a large exponent": "[feeder]\nlength_mm = 1e400",
    "a long string": 'a = "' + "x" * 60_000 + '"',
    "a string of escapes": 'a = "' + "\\n" * 30_000 + '"',
    "a string without end": 'a = """' + '""x' * 20_000,
    "quotes": '"' * 60_000,
    "single quotes": "'" * 60_000,
    "backslashes": 'a = "' + "\\" * 60_000,
    "line ends": "\n" * 60_000,
    "windows line ends": "\r\n" * 30_000,
    "returns": "\r" * 60_000,
    "line ends in a list": "a = [" + "\n" * 60_000 + "]",
    "equal signs": "=" * 60_000,
    "dots": "." * 60_000,
    "NULs": "\0" * 60_000,
    "marks of byte order": "\ufeff" * 20_000,
    "hidden characters": "#\u202e\n" * 12_000,
    "hidden characters in names": "".join(f'"k{place}\u2066" = 0\n' for place in range(3_900)),
    "nothing": "",
}
READERS: dict[str, Callable[[str, Path], object]] = {"recipe": parse_recipe, "line": parse_line}


def refused(read: Callable[[str, Path], object], text: str) -> Problems:
    with pytest.raises(Problems) as found:
        read(text, Path("hostile.toml"))
    return found.value


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_quickly(name: str, reader: str) -> None:
    text = HOSTILE[name]
    assert len(text.encode()) <= MAX_BYTES, "the case would only test the limit on size"
    durations = []
    for _ in range(3):  # minimum of three, to exclude other load
        began = time.process_time()
        problems = refused(READERS[reader], text).problems
        durations.append(time.process_time() - began)
        if durations[-1] < SECONDS:
            break
    assert min(durations) < SECONDS
    assert 1 <= len(problems) <= MAX_PROBLEMS + 1


@pytest.mark.parametrize(
    ("reader", "name"),
    [
        *(("recipe", "many ports"), ("recipe", "many deep headers"), ("line", "many stations")),
        # the same for both
        *(("line", name) for name in ("nested lists", "a string of escapes", "dotted key")),
    ],
)
def test_a_hostile_file_takes_little_memory(name: str, reader: str) -> None:
    tracemalloc.start()
    try:
        refused(READERS[reader], HOSTILE[name])
        assert tracemalloc.get_traced_memory()[1] < BYTES
    finally:
        tracemalloc.stop()


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
        (b"# caf\xe9\n", "is not UTF-8 (byte 5)"),
        ("a = 1".encode("utf-16"), "is not UTF-8 (byte 0)"),
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
