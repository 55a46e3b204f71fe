"""The public names of the package."""

from __future__ import annotations

import pytest

import jbclog


def test_every_public_name_is_there_and_lives_where_it_says() -> None:
    assert dir(jbclog) == sorted(jbclog.__all__)
    for name in jbclog.__all__:
        assert getattr(jbclog, name) is not None
    assert jbclog.open_run.__module__ == "jbclog.analysis.opening"
    assert issubclass(jbclog.RecordError, jbclog.JbclogError)


def test_an_unknown_name_is_an_error_with_the_known_ones() -> None:
    with pytest.raises(AttributeError, match="open_run"):
        jbclog.open_rune  # noqa: B018  # the mistake meant
