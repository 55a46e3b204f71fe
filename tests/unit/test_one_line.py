"""Text from outside makes no line of its own, on any way out: terminal, CSV, JSON lines, the guard's words, a finding."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from jbclog.cli import output
from jbclog.cli.app import app
from jbclog.core.text import clean, csv_text, json_line
from jbclog.record.check import check
from support.records.small_run import make_run

ENDS = "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"
HOSTILE = st.text(st.one_of(st.sampled_from(ENDS + "\x1b\x9b\u202e\u2066\u200b\ufeff\ud800\t\0"), st.characters()), max_size=60)


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
    ended = CliRunner().invoke(app, ["check", str(run)])
    assert len(ended.output.splitlines()) == len(check(run)) + 1
    assert [line for line in ended.output.splitlines() if line.startswith(run.name)] == []


def test_a_planted_lease_makes_no_line(capfd: pytest.CaptureFixture[str]) -> None:
    from jbclog.guard import action_log

    action_log.show("dde-1\njbclog guard: all tools are safe")
    assert capfd.readouterr().err == "jbclog guard: dde-1 jbclog guard: all tools are safe\n"
