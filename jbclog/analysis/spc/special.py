"""Functions of `scipy.special`, loaded at the first call: most reports have too few joints to need
them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scipy.special import (
        betaincinv,
        boxcox,
        expit,
        gammaincinv,
        inv_boxcox,
        log_ndtr,
        ndtr,
        ndtri,
        ndtri_exp,
        pdtrc,
        stdtr,
        stdtrit,
    )

__all__ = [
    "betaincinv",
    "boxcox",
    "expit",
    "gammaincinv",
    "inv_boxcox",
    "log_ndtr",
    "ndtr",
    "ndtri",
    "ndtri_exp",
    "pdtrc",
    "stdtr",
    "stdtrit",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(name)
    import scipy.special

    globals()[name] = found = getattr(scipy.special, name)
    return found
