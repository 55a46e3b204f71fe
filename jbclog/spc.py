"""The public name of `jbclog.analysis.spc`: control charts, capability and gauge studies."""

from jbclog.analysis.spc import *  # noqa: F403  # exactly what `__all__` names there
from jbclog.analysis.spc import __all__ as __all__
