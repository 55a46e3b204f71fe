"""jbclog: a production-line logger and process recorder for soldering stations.

``jbclog.open_run("runs/...")`` opens a recorded run as pandas DataFrames,
``jbclog.open_runs("runs")`` many of them. Importing this package imports no dependency: public
names are imported at first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jbclog.analysis.opening import open_run
    from jbclog.analysis.port_data import PortData
    from jbclog.analysis.run import Run
    from jbclog.analysis.runs import Runs, open_runs
    from jbclog.core.errors import JbclogError, LinkError, RecordError, UsageError

__version__ = "0.1.0"

_MODULES = {
    "JbclogError": "jbclog.core.errors",
    "LinkError": "jbclog.core.errors",
    "PortData": "jbclog.analysis.port_data",
    "RecordError": "jbclog.core.errors",
    "Run": "jbclog.analysis.run",
    "Runs": "jbclog.analysis.runs",
    "UsageError": "jbclog.core.errors",
    "open_run": "jbclog.analysis.opening",
    "open_runs": "jbclog.analysis.runs",
}
"""Public name -> module that defines it."""

__all__ = [
    "JbclogError",
    "LinkError",
    "PortData",
    "RecordError",
    "Run",
    "Runs",
    "UsageError",
    "__version__",
    "open_run",
    "open_runs",
]


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"jbclog has no {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
