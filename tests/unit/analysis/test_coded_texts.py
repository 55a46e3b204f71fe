"""Texts are the same as codes, however they were read."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from jbclog.analysis.coded_texts import coded, is_one_of
from jbclog.analysis.run import open_run
from jbclog.record.schema import SCHEMAS
from support.records.small_run import make_run

WORDS = ["on", None, "off", "on", "sleep", None, "off"]
COLUMNS = {
    "plain": pa.chunked_array([WORDS[:3], WORDS[3:]], pa.string()),
    "codes": pa.chunked_array(
        [pa.array(some, pa.string()).dictionary_encode() for some in (WORDS[:3], WORDS[3:])]
    ),
    "array": pa.array(WORDS, pa.string()).dictionary_encode(),
    "none": pa.chunked_array([pa.nulls(7, pa.string())]),
}


@pytest.mark.parametrize("how", [*COLUMNS])
def test_texts_have_one_dictionary(how: str) -> None:
    column = coded(COLUMNS[how])
    assert column.to_pylist() == COLUMNS[how].to_pylist()
    assert len(set(column.dictionary.to_pylist())) == len(column.dictionary)


@pytest.mark.parametrize("how", ["plain", "codes", "array"])
@pytest.mark.parametrize("words", [("on", "working"), ("off", "sleep"), (), ("never",)])
def test_which_texts_are_one_of_some_words(how: str, words: tuple[str, ...]) -> None:
    assert is_one_of(COLUMNS[how], words).tolist() == [word in words for word in WORDS]
    assert not is_one_of(COLUMNS["none"], words).any()


def test_rows_with_codes_are_the_rows_of_the_run(tmp_path: Path) -> None:
    run = open_run(make_run(tmp_path, 5.0))
    names = SCHEMAS["samples"].names
    plain, codes = ([*run.groups("samples", names, coded=coded)] for coded in (False, True))
    assert [group.to_pylist() for group in codes] == [group.to_pylist() for group in plain]
    texts = [field.name for field in SCHEMAS["samples"] if field.type == pa.string()]
    assert all(pa.types.is_dictionary(group[name].type) for group in codes for name in texts)
    assert all(group.schema.equals(SCHEMAS["samples"]) for group in plain)
