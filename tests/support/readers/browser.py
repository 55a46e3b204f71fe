"""Chromium without a window, driven over the pipe of its DevTools protocol, with mouse, keys and fingers."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

PROGRAM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
ANSWER_S = 60.0
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--disable-extensions"),
    *("--disable-background-networking", "--disable-dev-shm-usage", "--force-device-scale-factor=1", "--remote-debugging-pipe"),
)
CODES = {"+": "Equal", "-": "Minus"}


class Page:
    """One page. Coordinates are CSS pixels of the window."""

    def __init__(self, chromium: Chromium, session: str) -> None:
        self._chromium, self._session = chromium, session
        self.said: list[str] = []  # errors of scripts and refusals of the page's policy, as the browser reports them

    def ask(self, method: str, **parameters: Any) -> Any:
        return self._chromium.ask(method, parameters, self)

    @property
    def session(self) -> str:
        return self._session

    def open(self, path: Path) -> None:
        self.visit(path.resolve().as_uri())

    def visit(self, address: str) -> None:
        self.ask("Page.navigate", url=address)
        self.until("document.readyState === 'complete'")

    def close(self) -> None:
        self.ask("Page.close")

    def js(self, expression: str) -> Any:
        """What an expression gives; a promise is awaited."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until it holds."""
        end = time.monotonic() + ANSWER_S
        while not self.js(expression):
            assert time.monotonic() < end, f"it never came to {expression}"
            time.sleep(0.02)

    def settle(self) -> None:
        """Until what was asked for is drawn."""
        self.js("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))")

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, scrolled into the window."""
        box = self.js(
            f"(() => {{ const one = document.querySelector({json.dumps(selector)}); one.scrollIntoView({{block: 'center'}});"
            " const r = one.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; })()"
        )
        return tuple(box)

    def mouse(self, kind: str, x: float, y: float, clicks: int = 1) -> None:
        button = "none" if kind == "mouseMoved" else "left"
        self.ask(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=clicks, buttons=int(kind != "mouseReleased")
        )

    def hover(self, x: float, y: float) -> None:
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.settle()

    def drag(self, first: tuple[float, float], last: tuple[float, float]) -> None:
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=first[0], y=first[1])
        self.mouse("mousePressed", *first)
        for part in (0.3, 0.7, 1.0):
            x, y = (a + part * (b - a) for a, b in zip(first, last, strict=True))
            self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self.mouse("mouseReleased", *last)
        self.settle()

    def click(self, selector: str) -> None:
        left, top, width, height = self.place(selector)
        self.mouse("mousePressed", left + width / 2, top + height / 2)
        self.mouse("mouseReleased", left + width / 2, top + height / 2)
        self.settle()

    def key(self, key: str) -> None:
        text = {"text": key} if len(key) == 1 else {}
        self.ask("Input.dispatchKeyEvent", type="keyDown", key=key, code=CODES.get(key, key), **text)
        self.ask("Input.dispatchKeyEvent", type="keyUp", key=key, code=CODES.get(key, key))
        self.settle()

    def touch(self, *moments: list[tuple[float, float]]) -> None:
        """Fingers put down at the first moment's places, moved through the others, and lifted."""
        for number, places in enumerate(moments):
            points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
            self.ask("Input.dispatchTouchEvent", type="touchMove" if number else "touchStart", touchPoints=points)
            self.settle()
        self.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.settle()

    def picture(self) -> bytes:
        """The window as PNG."""
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])


class Chromium:
    """A running browser."""

    def __init__(self, process: subprocess.Popen[bytes], to: int, back: int) -> None:
        self._process, self._to, self._back = process, to, back
        self._number, self._rest = 0, b""
        self._pages: dict[str, Page] = {}

    def page(self, width: int, height: int, phone: bool = False) -> Page:
        """A new page in a window of this size; a phone's has fingers."""
        target = self.ask("Target.createTarget", {"url": "about:blank"})["targetId"]
        session = self.ask("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        page = self._pages[session] = Page(self, session)
        for domain in ("Page", "Runtime", "Log"):
            page.ask(f"{domain}.enable")
        page.ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=2 if phone else 1, mobile=phone
        )
        if phone:
            page.ask("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        return page

    def ask(self, method: str, parameters: dict[str, Any], page: Page | None = None) -> Any:
        """The answer to one call."""
        self._number += 1
        call: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if page is not None:
            call["sessionId"] = page.session
        os.write(self._to, json.dumps(call).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        page = self._pages.get(event.get("sessionId", ""))
        if page is None:
            return
        if event["method"] == "Runtime.exceptionThrown":
            page.said.append(str(event["params"]["exceptionDetails"]))
        if event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] == "error":
            page.said.append(str(event["params"]["entry"]["text"]))

    def _next(self) -> dict[str, Any]:
        end = time.monotonic() + ANSWER_S
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._back], [], [], max(0.0, end - time.monotonic()))
            piece = os.read(self._back, 1 << 20) if ready else b""
            assert piece, "the browser gives no answer"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        found = json.loads(message)
        assert isinstance(found, dict)
        return found


@contextmanager
def chromium() -> Iterator[Chromium]:
    """A browser with a profile of its own, which ends with the block."""
    assert PROGRAM is not None
    calls, to = os.pipe()
    back, answers = os.pipe()

    def as_it_expects() -> None:  # it reads 3 and writes 4
        first, second = os.dup(calls), os.dup(answers)
        os.dup2(first, 3)
        os.dup2(second, 4)

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [PROGRAM, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(3, 4),
            preexec_fn=as_it_expects,
            env={**os.environ, "TZ": "America/New_York"},  # a reader far from the line: times are UTC all the same
        )
        os.close(calls)
        os.close(answers)
        try:
            yield Chromium(process, to, back)
        finally:
            with suppress(OSError):
                os.write(to, b'{"id":0,"method":"Browser.close"}\0')
            os.close(to)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            os.close(back)
