"""What the schema alone cannot tell of a recipe: ranges and steps of the families listed, and what belongs together."""

from __future__ import annotations

from collections.abc import Iterator

from jbclog.errors import Problem
from jbclog.recipe.model import Recipe


def problems_between(recipe: Recipe) -> Iterator[Problem]:
    """Everything that is wrong with a recipe whose keys have the right types."""
    yield from ()
