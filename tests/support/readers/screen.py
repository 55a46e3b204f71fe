"""The live view in a terminal that does not exist, as text.

``python tests/support readers.screen`` writes the pictures that the tests compare with, into
tests/data/watch.
"""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

from jbclog.app.watch.terminal import WatchApp
from support.records import live_states

PICTURES = Path(__file__).parents[2] / "data" / "watch"
SIZES = {"narrow": (60, 48), "wide": (200, 40), "station": (100, 44)}


def text_of(app: WatchApp) -> str:
    """What the terminal shows, a line a row, without colours."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip).rstrip() for strip in strips) + "\n"


async def picture(name: str) -> str:
    """The made-up run: as an overview, or the first station in detail."""
    app = WatchApp(lambda: None, None)
    async with app.run_test(size=SIZES[name]) as pilot:
        app.show(live_states.run())
        await pilot.pause()
        await pilot.pause()
        if name == "station":
            await pilot.press("enter")
            await pilot.pause()
        return text_of(app)


def in_utc() -> None:
    os.environ["TZ"] = "UTC"
    time.tzset()


if __name__ == "__main__":
    in_utc()
    PICTURES.mkdir(exist_ok=True)
    for each in SIZES:
        (PICTURES / f"{each}.txt").write_text(asyncio.run(picture(each)), encoding="utf-8")
