"""Text from outside makes no line of its own, on any way out: terminal, CSV, JSON lines, the
guard's words, a finding, a warning or an error of the Python API.
"""

from __future__ import annotations

import ast
import csv
import errno
import io
import json
import shutil
import subprocess
import sys
import threading
import traceback
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import jbclog
from jbclog.cli import output
from jbclog.cli.app import NO_FILES as NO_FILES_TEXT
from jbclog.core.errors import (
    AnswerTimeout,
    JbclogError,
    LinkError,
    Problem,
    Problems,
    RecordError,
    UsageError,
)
from jbclog.core.text import clean, csv_text, json_line
from jbclog.record.check import check
from jbclog.record.manifest import read_manifest, write_manifest
from jbclog.record.sealed_files import portable
from jbclog.report.write import write_report
from support.invoked import invoked
from support.product import lose_commit
from support.readers.repository import parsed
from support.records.few_rows import abandoned
from support.records.small_run import make_run

ROOT = Path(__file__).parents[2]
PACKAGE = Path(jbclog.__file__).parent
ENDS = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
HOSTILE = st.text(
    st.one_of(
        st.sampled_from(ENDS + "\x1b\x9b\u202e\u2066\u200b\ufeff\ud800\t\0"), st.characters()
    ),
    max_size=60,
)


@given(HOSTILE)
def test_disarmed_text_is_one_line_that_shows_all_of_itself(text: str) -> None:
    shown = clean(text)
    assert len(f"x{shown}x".splitlines()) == 1
    shown.encode()  # it can be written
    assert len(shown) == len(text)  # nothing is taken out unseen
    assert clean(shown) == shown


@given(st.lists(HOSTILE, min_size=1, max_size=5))
def test_one_finding_is_one_line_of_the_terminal(texts: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        for name, speaks in (("stdout", output.echo), ("stderr", output.note)):
            out = io.StringIO()
            patch.setattr(f"sys.{name}", out)
            speaks(*(f"{text}: finding" for text in texts))
            assert len(out.getvalue().splitlines()) == len(texts)


@given(HOSTILE)
def test_an_object_is_one_line_of_json_and_says_the_same(text: str) -> None:
    line = json_line({"file": text, text: [text]})
    assert len(line.splitlines()) == 1
    assert clean(line) == line
    assert json.loads(line) == {"file": text, text: [text]}


@given(HOSTILE)
def test_a_cell_of_csv_is_one_line(text: str) -> None:
    written = csv_text(["a", "b"], [{"a": text, "b": 1}]).removeprefix("\ufeff")
    assert len(written.splitlines()) == 2
    assert [row[1] for row in csv.reader(io.StringIO(written, newline=""))] == ["b", "1"]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("sealed"), 3.0)


@pytest.mark.parametrize("end", ENDS, ids=ascii)
def test_a_file_s_name_makes_no_line_of_a_check(sealed: Path, tmp_path: Path, end: str) -> None:
    run = tmp_path / sealed.name
    shutil.copytree(sealed, run)
    (run / f"x{end}{run.name}: no differences (fingerprint 0000-0000-0000-0000)").touch()
    ended = invoked("check", run)
    assert len(ended.output.splitlines()) == len(check(run)) + 1
    assert [line for line in ended.output.splitlines() if line.startswith(run.name)] == []


def test_a_planted_lease_makes_no_line(capfd: pytest.CaptureFixture[str]) -> None:
    from jbclog.guard import action_log

    action_log.show("dde-1\njbclog guard: all tools are safe")
    assert capfd.readouterr().err == "jbclog guard: dde-1 jbclog guard: all tools are safe\n"


HOSTILE_NAME = "x\nUserWarning: all is well\x1b[2K\u202e\u2066\u200b"


def damaged_store(below: Path) -> None:
    below.mkdir()
    folder = abandoned(below)
    lose_commit(folder, "samples", 0)
    jbclog.open_run(folder).samples()


def test_a_warning_is_one_line(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="UserWarning: all is well") as warned:
        damaged_store(tmp_path / HOSTILE_NAME)
    texts = [str(one.message) for one in warned]
    assert texts == [clean(text) for text in texts]


@given(HOSTILE)
def test_an_error_of_the_python_api_is_one_line(text: str) -> None:
    for kind in (UsageError, RecordError, LinkError, AnswerTimeout):
        assert str(kind(f"x{text}")) == clean(f"x{text}")
    problem = Problem(text, 1, text, text)
    assert str(Problems([problem, problem])).split("\n") == [clean(str(problem))] * 2


def test_a_traceback_shows_a_hostile_name_as_text(tmp_path: Path) -> None:
    with pytest.raises(JbclogError, match="UserWarning: all is well") as missing:
        jbclog.open_run(tmp_path / HOSTILE_NAME)
    (line,) = traceback.format_exception_only(missing.value)
    assert line.removesuffix("\n") == clean(line.removesuffix("\n"))


def test_a_text_without_its_folder_has_none_whatever_its_name(tmp_path: Path) -> None:
    path = tmp_path / HOSTILE_NAME / "part-0000.parquet"
    assert portable(RecordError(f"{path} is damaged"), path) == "part-0000.parquet is damaged"


def test_every_warning_is_cleaned() -> None:
    warning = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(parsed(path))
        if (isinstance(node, ast.ImportFrom) and node.module == "warnings")
        or (
            isinstance(node, ast.Attribute)
            and node.attr.startswith("warn")
            and ast.unparse(node.value) == "warnings"
        )
    }
    assert warning == {"core/text.py"}


WRONG = ("runs --x{}", "{}", "runs --since={} --state {}", "trend --port={}", "--{}")


@pytest.mark.parametrize("words", WRONG)
def test_what_the_parser_repeats_is_cleaned_and_short(words: str) -> None:
    hostile = "\u202e\u2028\x1b[31m" + "x" * 5000
    said = invoked(*(word.format(hostile) for word in words.split()))
    assert said.exit_code == 2
    assert not set(said.output) & set("\u202e\u2028\x1b")
    assert max(map(len, said.output.splitlines())) < 11_000
    assert len(said.output.splitlines()) <= 4


def test_no_line_is_no_empty_line(capsys: pytest.CaptureFixture[str]) -> None:
    output.echo()
    output.note()
    assert capsys.readouterr() == ("", "")


def test_a_line_and_a_cell_have_a_most_length(capsys: pytest.CaptureFixture[str]) -> None:
    output.echo("x" * 100_000)
    output.note("y" * 100_000)
    output.echo_table(["a"], [["z" * 100_000]])
    seen = capsys.readouterr()
    assert max(map(len, (seen.out + seen.err).splitlines())) < output.MOST_SHOWN + 50
    assert seen.out.count("characters are left out") == 2


def test_a_manifest_of_long_texts_is_a_line_of_some_hundred_characters(tmp_path: Path) -> None:
    long, made = "x" * 100_000, make_run(tmp_path, 2.0)
    manifest = read_manifest(made)
    write_manifest(
        made, replace(manifest, metadata=replace(manifest.metadata, operator=long, units=[long]))
    )
    bad = tmp_path / made.name.replace("bench", "bench-2")
    bad.mkdir()
    (bad / "manifest.json").write_text(json.dumps({"run": "x", "state": "open", "start": long}))
    said = invoked("runs", tmp_path)
    assert said.exit_code == 0
    assert max(map(len, said.output.splitlines())) < 2500
    assert "characters are left out" in said.output


def test_an_error_that_ends_a_thread_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(threading, "excepthook", output.note_thread_error)
    thread = threading.Thread(target=fail, name="jbclog-writer")
    thread.start()
    thread.join()
    seen = capsys.readouterr().err
    assert len(seen.splitlines()) == 1
    assert "error: the thread jbclog-writer ended: OSError" in seen
    assert "ulimit -n" in seen


def test_the_last_line_of_check_does_not_contradict_the_list_above_it(tmp_path: Path) -> None:
    made = make_run(tmp_path, 2.0)
    assert "no differences (" in invoked("check", made).output
    write_report(made)
    facts = json.loads((made / "report.json").read_bytes())
    del facts["vouched_in"], facts["written"]
    (made / "report.json").write_text(json.dumps(facts))
    (made / "annotations.jsonl").unlink()
    said = invoked("check", made)
    *above, last = said.output.splitlines()
    count = sum(line.startswith("not covered: ") for line in above)
    assert count > 3
    assert f"no differences in what is covered; {count} files not covered" in last
    assert said.exit_code == 0


NO_FILES = """
import resource, sys
from jbclog.cli.app import main
number, *words = sys.argv[1:]
sys.argv = ["jbclog", *words]
resource.setrlimit(resource.RLIMIT_NOFILE, (int(number), int(number)))
main()
"""


@pytest.mark.parametrize(
    ("number", "words"), [(0, ["runs", "."]), (5, ["sim", "profiles/lines/bench.toml"])]
)
def test_no_more_open_files_is_one_line(number: int, words: list[str]) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", NO_FILES, str(number), *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        cwd=ROOT,
    )
    assert (ended.returncode, ended.stderr) == (4, NO_FILES_TEXT.decode())
