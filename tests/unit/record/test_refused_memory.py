"""Memory that is refused to the live store where it words a failure: it is remembered, told later,
and has its cause in words.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.core import errors
from jbclog.core.errors import RecordError
from jbclog.record import run_journal
from support.records import few_rows


def test_a_failure_that_cannot_even_be_worded_is_remembered_and_told_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[RecordError] = []
    store = few_rows.begun(tmp_path, on_failure=told.append)

    def refuse(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(run_journal, "RecordError", refuse)
        patch.setattr(run_journal, "EventRow", refuse)
        with pytest.raises(MemoryError):
            store._fail("whatever")
    assert str(store.failure).endswith("the record is not whole: memory was refused")
    assert told == []
    store.commit_now()
    assert told == [store.failure]
    store.close()
    store.release()


def test_an_error_without_a_text_has_its_cause_in_words() -> None:
    assert errors.unexpected_error_text(MemoryError()) == "MemoryError: memory was refused"
    assert errors.unexpected_error_text(AssertionError()) == "AssertionError: it gives no reason"
    assert errors.unexpected_error_text(ValueError("too long")) == "ValueError: too long"
    assert errors.cause(KeyError("x")) == "'x'"
