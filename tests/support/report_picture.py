"""The README's picture of a report: cuttings from the page of a demo, one above the other.

``jbclog demo --out DIR`` records one; ``python tests/support/report_picture.py RUN PICTURE [PORT...]`` cuts out the verdict, its
alarms and these ports (``dde-2-1``) as Chromium shows them. It needs ``chromium`` on the path.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 1100, 4000
BAR = '<div style="height:26px;margin:16px -1.25rem;background:#d6dde4"></div>'
COLOURS = 96


def cut(html: str, ports: list[str]) -> str:
    """The page with nothing but the cuttings."""
    head, body = html.split("<main", 1)
    verdict = _part(body, r'<p class="kind">.*?</section>')
    alarms = _part(body, r"<h2>Alarms.*?</table></div>").replace("<h2>", '<h2 style="margin:0;border:0;padding:0">', 1)
    panes = [_part(body, rf'<div class="port[^"]*" id="{port}">.*?</figure>') + "</div>" for port in ports]
    panes = [re.sub(r"<h3>", '<h3 style="margin:0">', pane, count=1) for pane in panes]
    return f'{head}<main style="padding-bottom:0">{BAR.join([verdict, *panes, alarms])}</main></body></html>'


def _part(body: str, pattern: str) -> str:
    found = re.search(pattern, body, re.DOTALL)
    if found is None:
        raise SystemExit(f"the report has nothing like {pattern}")
    return found[0]


def picture(run: Path, out: Path, ports: list[str]) -> None:
    """Write the picture, cut at its lower end and with few colours."""
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "page.html", Path(folder) / "shot.png"
        page.write_text(cut((run / "report.html").read_text("utf-8"), ports), encoding="utf-8")
        asked = ["--headless", "--disable-gpu", "--no-sandbox", "--hide-scrollbars", f"--window-size={WIDTH},{HEIGHT}"]
        subprocess.run(["chromium", *asked, f"--screenshot={shot}", f"file://{page}"], check=True, capture_output=True)
        seen = Image.open(shot).convert("RGB")
    last = int(np.flatnonzero(np.asarray(seen).min(axis=(1, 2)) < 250)[-1])
    seen.crop((0, 0, WIDTH, min(last + 14, HEIGHT))).quantize(COLOURS).save(out, optimize=True)


if __name__ == "__main__":
    picture(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:] or ["dde-2-1", "ucr-1-1"])
