"""Modules that are slow to import, imported at their first use: each worker collects every test,
and runs some of them.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class _Lazy:
    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        # pytest asks every name of a test's module whether it is a test, a fixture or a mock
        if attribute.startswith("_"):
            raise AttributeError(attribute)
        return getattr(import_module(self._name), attribute)


stats: Any = _Lazy("scipy.stats")
polars: Any = _Lazy("polars")
duckdb: Any = _Lazy("duckdb")
pglast: Any = _Lazy("pglast")
mdf: Any = _Lazy("jbclog.app.export.mdf")  # and asammdf
asammdf: Any = _Lazy("asammdf")
mdfreader: Any = _Lazy("mdfreader")
openpyxl: Any = _Lazy("openpyxl")
