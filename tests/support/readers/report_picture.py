"""The pictures of the documentation: the upper part of a run's page, from its verdict to its
strips.

``jbclog demo`` records ``docs/pictures/alarmed.png``; ``docs/tutorials/first-run.md`` has the
commands for ``calm.png``. ``python tests/support readers.report_picture RUN PICTURE`` makes one of
a run with a report. It needs ``chromium`` on the path.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 1000, 2000
COLOURS = 64


def upper_part(html: str) -> str:
    """The page from its top to the end of what is below its first heading of the second rank."""
    before, first, rest = html.partition("<h2>")
    strips, _, _ = rest.partition("<h2>")
    return f"{before}{first}{strips}</main></body></html>"


def picture(run: Path, out: Path) -> None:
    """Write the picture, cut at its lower end and with few colours."""
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "page.html", Path(folder) / "shot.png"
        page.write_text(upper_part((run / "report.html").read_text("utf-8")), encoding="utf-8")
        asked = [
            "--headless",
            "--disable-gpu",
            "--no-sandbox",
            "--hide-scrollbars",
            f"--window-size={WIDTH},{HEIGHT}",
        ]
        subprocess.run(
            ["chromium", *asked, f"--screenshot={shot}", f"file://{page}"],
            check=True,
            capture_output=True,
        )
        seen = Image.open(shot).convert("RGB")
    last = int(np.flatnonzero(np.asarray(seen).min(axis=(1, 2)) < 250)[-1])
    seen.crop((0, 0, WIDTH, min(last + 14, HEIGHT))).quantize(COLOURS).save(out, optimize=True)


if __name__ == "__main__":
    picture(Path(sys.argv[1]), Path(sys.argv[2]))
