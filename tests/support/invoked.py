"""The command `jbclog`, run in the process of the test."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

from typer.testing import CliRunner, Result

from support.product import command_line


def invoked(*words: object, **options: Any) -> Result:
    """How a call with these words ended; `options` are those of `CliRunner.invoke`.

    A command that lowers its priority would lower that of all tests after it.
    """
    with patch("os.nice"):
        return CliRunner().invoke(command_line, list(map(str, words)), **options)
