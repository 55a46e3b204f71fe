"""The system's Chromium without a window, by playwright's client, with mouse, keys and fingers."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:  # imported where a browser is started, by a few of the workers
    from playwright.sync_api import Browser, BrowserContext
    from playwright.sync_api import Page as Tab

PROGRAM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
ANSWER_S = 60.0
# fewer processes: a page takes a fifth less of CPU
FEW = ("--in-process-gpu", "--renderer-process-limit=1", "--disable-site-isolation-trials")
OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", *FEW)


class Page:
    """One page. Coordinates are CSS pixels of the window."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        # errors of scripts and refusals of the page's policy, as the browser reports them
        self.said: list[str] = []
        self.requests: list[str] = []
        self._devtools = tab.context.new_cdp_session(tab)
        tab.set_default_timeout(ANSWER_S * 1000)
        tab.on("pageerror", lambda error: self.said.append(str(error)))
        tab.on(
            "console",
            lambda message: self.said.append(message.text) if message.type == "error" else None,
        )
        tab.on("request", lambda request: self.requests.append(request.url))

    def ask(self, method: str, **parameters: Any) -> Any:
        """The answer to one call of the DevTools protocol, for what playwright has no words for."""
        return self._devtools.send(method, parameters)

    def open(self, path: Path) -> None:
        self.visit(path.resolve().as_uri())

    def visit(self, address: str) -> None:
        self.tab.goto(address)

    def close(self) -> None:
        self.tab.close()

    def js(self, expression: str) -> Any:
        """What an expression gives; a promise is awaited."""
        return self.tab.evaluate(expression)

    def until(self, expression: str, most_s: float = ANSWER_S) -> None:
        """Wait until it holds. Not by playwright's own means, which need a policy that allows
        `eval`. A look takes time of three processes, so that the longer it lasts, the rarer they
        are.
        """
        end, pause_ms = time.monotonic() + most_s, 20.0
        while not self.js(expression):
            assert time.monotonic() < end, f"it never came to {expression}"
            self.tab.wait_for_timeout(pause_ms)
            pause_ms = min(1.5 * pause_ms, 200.0)

    def settle(self) -> None:
        """Until what was asked for is drawn."""
        self.js(
            "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() =>"
            " setTimeout(done, 0))))"
        )

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, scrolled into the window."""
        box = self.js(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)});"
            " one.scrollIntoView({block: 'center'}); const r = one.getBoundingClientRect();"
            " return [r.left, r.top, r.width, r.height]; })()"
        )
        return tuple(box)

    def hover(self, x: float, y: float) -> None:
        self.tab.mouse.move(x, y)
        self.settle()

    def drag(self, first: tuple[float, float], last: tuple[float, float]) -> None:
        self.tab.mouse.move(*first)
        self.tab.mouse.down()
        self.tab.mouse.move(*last, steps=3)
        self.tab.mouse.up()
        self.settle()

    def click(self, selector: str) -> None:
        left, top, width, height = self.place(selector)
        self.tab.mouse.click(left + width / 2, top + height / 2)
        self.settle()

    def key(self, key: str) -> None:
        self.tab.keyboard.press(key)
        self.settle()

    def tap(self, x: float, y: float, times: int = 1) -> None:
        """A finger put down and lifted at once: after half a second it would be a long press, and
        sooner after a movement the browser takes it for the end of that.
        """
        self.tab.wait_for_timeout(500)
        for _ in range(times):
            self.tab.touchscreen.tap(x, y)
        self.settle()

    def tap_until(self, x: float, y: float, expression: str, times: int = 1) -> None:
        """Tap until it holds, at most five times: where the machine was busy between down and up,
        the browser took the tap for a long press.
        """
        for _ in range(5):
            self.tap(x, y, times)
            end = time.monotonic() + ANSWER_S / 10
            while time.monotonic() < end:
                if self.js(expression):
                    return
                self.tab.wait_for_timeout(50)
        raise AssertionError(f"it never came to {expression}")

    def touch(self, *moments: list[tuple[float, float]]) -> None:
        """Fingers put down at the first moment's places, moved through the others, and lifted."""
        for number, places in enumerate(moments):
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            self.ask(
                "Input.dispatchTouchEvent",
                type="touchMove" if number else "touchStart",
                touchPoints=points,
            )
            self.settle()
        self.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()


class Chromium:
    """A running browser. A page is a tab: a window of its own costs twice the time of the page."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._windows: dict[tuple[bool, bool], BrowserContext] = {}

    def page(
        self,
        width: int,
        height: int,
        phone: bool = False,
        scheme: Literal["light", "dark"] = "light",
        scripts: bool = True,
    ) -> Page:
        """A new page of this size; a phone's has fingers."""
        tab = self._window(phone, scripts).new_page()
        tab.set_viewport_size({"width": width, "height": height})
        tab.emulate_media(color_scheme=scheme)
        return Page(tab)

    def _window(self, phone: bool, scripts: bool) -> BrowserContext:
        """A window that stays open."""
        if (phone, scripts) not in self._windows:
            window = self._browser.new_context(
                device_scale_factor=2 if phone else 1,
                is_mobile=phone,
                has_touch=phone,
                java_script_enabled=scripts,
                # a reader far from the line: times are UTC all the same
                timezone_id="America/New_York",
            )
            window.new_page()
            self._windows[phone, scripts] = window
        return self._windows[phone, scripts]


@contextmanager
def chromium() -> Iterator[Chromium]:
    """A browser with a profile of its own, which ends with the block."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as client:
        browser = client.chromium.launch(executable_path=PROGRAM, args=OPTIONS, env={**os.environ})
        try:
            yield Chromium(browser)
        finally:
            browser.close()
