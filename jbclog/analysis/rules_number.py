"""The number of the rules and methods that judge runs. A manifest names that of its verdict.

Only a verdict of the same number is computed again: rules of other numbers are not kept.
"""

from __future__ import annotations

from typing import Final

RULES: Final = 0
"""0 until version 1.0. To change a rule or a method of a released version, raise it."""
