"""Texts of others on paper: none is obeyed, and none keeps a report from being made."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pikepdf
import pytest

from jbclog.core.text import clean
from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata, read_manifest, write_manifest
from jbclog.report.write import write_report
from support.readers.pdf_read import faults, page_texts
from support.records.sealed_run import alarm, limit, samples, seal, station, table
from support.records.small_run import make_run

MARK = "\u0301"  # combines with the letter before it
MARKUP = {
    "import": '#import "@preview/x:0.1.0": *',
    "read": '#read("/etc/passwd")',
    "evaluated": '#eval("1 + 1") #panic()',
    "mathematics": "$ x^2 $ $",
    "reference": "@ref <label> @@",
    "brackets": "]]] [[[ ((( }}} {{{",
    "raw": "``` ` ```raw",
    "comment": "/* // */ http://x.invalid",
    "escape": "\\ \\u{41} ~ -- --- ...",
    "heading": "= one\n== two\n/ term: x\n+ y\n- z",
    "right to left": "\u0627\u0644\u0639\u0631\u0628\u064a\u0629 12 \u05d0\u05d1\u05d2 (3)",
    "marks": "\u202e\u2066\u200f\u200b\u2028",
    "NUL and others": "a\0b\x01\x1b[31m\x7f",
    "surrogates": "\ud800 \udfff",
    "combining": "a" + MARK * 4000,
    "no blank": "W" * 100_000,
    "none of text": "\ufffc\ufffe\uffff\ue000\U0010ffff",
    "selectors": "1\ufe0f\u20e3 \u2764\ufe0e",
    "svg": '</text><image href="/etc/passwd"/><text d="1.2345">',
}
"""What a language for paper could obey or choke on."""


@pytest.mark.parametrize("text", MARKUP.values(), ids=MARKUP)
def test_no_text_of_a_record_is_obeyed_on_paper_or_keeps_it_from_being_made(
    tmp_path: Path, text: str
) -> None:
    """In each place that a manifest and the tables have for texts of others."""
    plain = text.encode(errors="replace").decode()  # no file in UTF-8 has half a surrogate
    columns = samples(300)
    columns["status"][100:200] = plain[:8]
    rows = [
        limit("high", "380"),
        limit("low", "300")._replace(setting=plain, requested=plain, readback=plain),
    ]
    events = [alarm(12), alarm(13)._replace(text=plain, kind=plain, raw=plain)]
    said = Metadata(text, text, text, (text,), {text: text}, (text,), (text,), (f"dde-1={text}",))
    facts = station(rows=300)
    facts.model = facts.software = text
    run = seal(tmp_path, [facts], table(columns), events, rows, metadata=said)
    append(run, who=f"a{plain[:50]}", what=f"a{plain[:50]}", why=f"a{plain[:50]}")
    began = time.process_time()
    write_report(run)
    assert time.process_time() - began < 15
    data = (run / "report.pdf").read_bytes()
    assert faults(data) == []
    whole = "".join(page_texts(data))
    assert "root:" not in whole
    with pikepdf.open(run / "report.pdf") as pdf, pdf.open_outline() as outline:
        assert not {"one", "two"} & {one.title for one in outline.root}


def test_long_texts_of_others_are_set_in_seconds_and_whole_in_the_page(tmp_path: Path) -> None:
    folder = make_run(tmp_path, 4.0)
    manifest = read_manifest(folder)
    tags = {f"t{at}": "word " * 200 for at in range(1000)}
    write_manifest(
        folder,
        replace(
            manifest,
            verdict="x" * 30_000,  # in the title: more than 65 535 bytes of it end in a panic
            metadata=Metadata(operator="x" * 1_000_000, tags=tags),
        ),
    )
    began = time.process_time()
    write_report(folder)
    assert time.process_time() - began < 15  # 50 s and more for the first text alone
    text = " ".join(page_texts(folder / "report.pdf"))
    assert "characters are left out" in clean(text)
    assert "x" * 1_000_000 in (folder / "report.html").read_text(encoding="utf-8")
