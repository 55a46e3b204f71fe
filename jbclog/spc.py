"""Control charts and capability: the public names of `jbclog.analysis.spc`."""

from jbclog.analysis.spc import *  # noqa: F403  # exactly what `__all__` names there
from jbclog.analysis.spc import __all__ as __all__
