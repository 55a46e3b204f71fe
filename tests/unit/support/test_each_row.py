"""A test over a table tries every row, and fails where one does."""

from __future__ import annotations

import inspect

import pytest

from support.campaigns.each_row import CHOSEN, each_row


def test_every_row_is_tried_and_each_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOSEN, raising=False)
    tried: list[int] = []

    @each_row((f"row {number}", (number,)) for number in range(20))
    def test_not_a_seven(number: int) -> None:
        """As it is written."""
        tried.append(number)
        assert number % 10 != 7
        if number == 9:
            with pytest.raises(ValueError, match="nothing raises it"):
                pass

    with pytest.raises(BaseExceptionGroup, match="3 of 20 rows: row 7, row 9, row 17") as failed:
        test_not_a_seven()
    assert tried == list(range(20))
    assert [one.__notes__ for one in failed.value.exceptions] == [
        ["row: row 7"],
        ["row: row 9"],
        ["row: row 17"],
    ]
    assert (test_not_a_seven.__name__, test_not_a_seven.__doc__) == (
        "test_not_a_seven",
        "As it is written.",
    )


def test_rows_can_be_chosen_by_their_name(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []
    test = each_row((f"row {number}", (number,)) for number in range(20))(tried.append)
    monkeypatch.setenv(CHOSEN, "row 1")
    test()
    assert tried == [1, *range(10, 20)]
    monkeypatch.setenv(CHOSEN, "column")
    with pytest.raises(pytest.skip.Exception, match="no row has 'column'"):
        test()


def test_what_is_behind_the_row_are_fixtures_for_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOSEN, raising=False)
    tried: list[tuple[int, str, str]] = []

    @each_row((f"row {number}", (number,)) for number in range(2))
    def test_of_two(number: int, place: str, way: str) -> None:
        tried.append((number, place, way))

    assert [*inspect.signature(test_of_two).parameters] == ["place", "way"]  # as pytest asks
    test_of_two(place="here", way="short")
    assert tried == [(0, "here", "short"), (1, "here", "short")]


def test_a_table_without_rows_is_no_test() -> None:
    with pytest.raises(AssertionError, match="proves nothing"):
        each_row(())
