"""The template engine of the report's two pages: a run's and an audit's."""

from __future__ import annotations

from collections.abc import Callable

from jinja2 import Environment, PackageLoader, StrictUndefined

from jbclog.core.text import number, stamp, together


def environment(package: str, finalize: Callable[[object], object] | None = None) -> Environment:
    """Return the engine of the templates in `package`: it escapes all text, and a name that is not
    known is an error. `finalize` is applied to every value before it is written.
    """
    made = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=finalize,
    )
    made.filters.update(number=number, stamp=stamp, together=together)
    return made
