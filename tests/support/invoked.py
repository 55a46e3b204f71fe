"""The command `jbclog`, run in the process of the test."""

from __future__ import annotations

from typing import Any

from typer.testing import CliRunner, Result

from jbclog.cli.app import app


def invoked(*words: object, **options: Any) -> Result:
    """How a call with these words ended; `options` are those of `CliRunner.invoke`."""
    return CliRunner().invoke(app, list(map(str, words)), **options)
