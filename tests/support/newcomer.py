"""What a newcomer sees of a demo."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple


class Demo(NamedTuple):
    """A demo that was run: where it was started, what it said, and the run's folder."""

    place: Path
    said: subprocess.CompletedProcess[str]
    run: Path
