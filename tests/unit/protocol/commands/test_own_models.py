"""A model name proves one family: a station is never driven by another one's commands."""

from __future__ import annotations

from itertools import permutations

import pytest

from support.product import FAMILIES

PAIRS = [pair for pair in permutations(FAMILIES, 2) if FAMILIES[pair[0]].models]


@pytest.mark.parametrize(("name", "other"), PAIRS)
def test_no_model_of_another_family_is_proven(name: str, other: str) -> None:
    models = FAMILIES[other].models
    assert [model for model in models if FAMILIES[name].proves(model)] == []
