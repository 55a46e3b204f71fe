"""The live view's page in Chromium: what it shows, by mouse, keys and fingers, and what it shows
when nothing comes any more.
"""

from __future__ import annotations

import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import axe_core_python
import pytest

from jbclog.core.rows import EventRow, Severity
from jbclog.live import Condition, Coverage, Follower, NumberedEvent, PortState, RunState, Trace
from jbclog.report.write import write_report
from support import program
from support.readers.browser import ANSWER_S, PROGRAM, Chromium, Page, chromium
from support.records import live_states
from support.records.live_rows import Recording
from support.virtual.watched_page import Served, page

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="chromium is not installed")

LOADED = {"", "uplot.css", "watch.css", "uplot.js", "trace.js", "watch.js", "events", "favicon.ico"}
TILE = "document.querySelectorAll('article')[{}]"


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    with chromium() as found:
        yield found


def seen(
    browser: Chromium, served: Served, width: int = 1280, height: int = 900, *, phone: bool = False
) -> Page:
    """The page when it has its first message; it notes each request."""
    opened = browser.page(width, height, phone)
    opened.visit(served.address)
    opened.until("document.querySelectorAll('article').length > 0")
    return opened


def text(opened: Page, selector: str) -> str:
    return str(opened.js(f"document.querySelector({selector!r}).textContent"))


def tile(opened: Page, number: int, what: str) -> str:
    return str(opened.js(f"{TILE.format(number)}.querySelector({what!r}).textContent"))


def test_tiles_show_the_run(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        assert (
            text(opened, "#run")
            == "20261123T060000Z-bench-3-k7qd · RECORDING · order 88123 · unit SN-0012"
        )
        assert (
            text(opened, "#status")
            == "1 alarm, 1 stale, 1 not known, 1 attention, 1 normal, 1 ended"
        )
        assert [tile(opened, number, ".condition") for number in range(6)] == [
            *("normal", "alarm", "not known", "stale", "attention", "ended")
        ]
        assert tile(opened, 0, ".now") == "349 °C"
        assert tile(opened, 2, ".now") == "unknown (timeout; last 351 °C, 12 s ago)"
        assert "T 392 °C is above the limit of 380 °C." in tile(opened, 1, ".wrong")
        assert opened.js("document.title") == "ALARM – jbclog watch"
        assert {one.removeprefix(served.address) for one in opened.requests} <= LOADED
        canvas = f"{TILE.format(0)}.querySelector('canvas')"
        pixels = (
            f"Array.from({canvas}.getContext('2d').getImageData(0, 0, 200, 40).data).some(one =>"
            " one)"
        )
        opened.until(pixels)
        assert opened.said == []
        opened.close()


def test_tiles_beside_each_other_have_the_same_lines(browser: Chromium) -> None:
    """Whoever looks for one value reads along a line."""
    run = live_states.run()
    first, *others = run.ports
    long = replace(first, tool_name="T245/T470/TR245/TR470/T210/T115")
    stations = (replace(run.stations[0], ports=(long, *others)),)
    with page(replace(run, stations=stations)) as served:
        opened = seen(browser, served)
        for what in (".condition", ".now", ".line", ".facts", "button"):
            tops = opened.js(
                f"[0, 1].map(one => document.querySelectorAll('article')[one]"
                f".querySelector('{what}').getBoundingClientRect().top)"
            )
            # the borders of an alarm are thicker
            assert tops[0] == pytest.approx(tops[1], abs=3)
        heights = opened.js(
            "[0, 1].map(one => document.querySelectorAll('article h2')[one].firstChild)"
            ".map(one => { const range = document.createRange(); range.selectNodeContents(one);"
            " return range.getBoundingClientRect().height; })"
        )
        assert heights[0] > 1.5 * heights[1]
        opened.close()


def test_foreign_text_stays_text(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        assert "<img src=x onerror=alert(1)>" in tile(opened, 4, ".wrong")
        assert "<img src=x onerror=alert(1)>" in text(opened, "#events")
        assert opened.js("document.images.length") == 0
        assert opened.said == []
        opened.close()


def test_events_by_severity(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        assert opened.js("document.querySelectorAll('#events li').length") == 4
        for severity, count in (("warning", 3), ("critical", 1), ("info", 4)):
            opened.js(
                "(() => { const one = document.getElementById('severity'); one.value ="
                f" '{severity}'; one.dispatchEvent(new Event('change')); }})()"
            )
            assert opened.js("document.querySelectorAll('#events li').length") == count
        more = replace(
            live_states.run(),
            events=(NumberedEvent(9, EventRow(1, "x", Severity.ERROR, "a new one")),),
        )
        served.answer = more
        opened.until("document.getElementById('events').textContent.includes('a new one')")
        opened.close()


def test_a_port_in_detail(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        opened.click("article button")
        opened.until(
            "document.getElementById('detail').open &&"
            " document.querySelector('#plot').dataset.points === '601'"
        )
        assert "temperature_select_c" in text(opened, "#settings")
        assert "123.5" in text(opened, "#counters")
        left, top, width, height = opened.place("#plot .u-over")
        opened.hover(left + width - 1, top + height / 2)
        # the last pixel may lie nearer to the last but one of 601 points
        assert text(opened, "#cursor").startswith(("0.0 s: ", "-0.1 s: "))
        assert text(opened, "#cursor").endswith(", 10 %")
        opened.until("document.querySelector('#plot').dataset.window !== undefined")
        opened.drag((left + width * 0.25, top + height / 2), (left + width * 0.5, top + height / 2))
        opened.until(
            "(() => { const [a, b] = document.querySelector('#plot').dataset.window.split(' ');"
            " return b - a < 20; })()"
        )
        opened.js("document.getElementById('plot').focus()")
        opened.key("ArrowLeft")
        opened.key("ArrowLeft")
        assert text(opened, "#cursor")
        opened.key("Escape")
        opened.until("!document.getElementById('detail').open")
        assert opened.js("document.activeElement.textContent") == "Details"
        assert opened.said == []
        opened.close()


def test_the_last_hour_of_a_port(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        opened.click("article button")
        choose = (
            "(() => {{ const one = document.getElementById('span'); one.value = '{}';"
            " one.dispatchEvent(new Event('change')); }})()"
        )
        opened.js(choose.format("hour"))
        # 708 means, then the minute as it was read
        opened.until("document.querySelector('#plot').dataset.points === '1309'")
        opened.js("document.getElementById('plot').focus()")
        opened.key("ArrowLeft")
        opened.key("ArrowLeft")
        assert text(opened, "#cursor").startswith("-0.1 s: 336.6")
        opened.until("document.getElementById('spoken').textContent.startsWith('-0.1 s: 336.6')")
        left, top, width, height = opened.place("#plot .u-over")
        opened.hover(left + width * 0.25, top + height / 2)
        assert re.fullmatch(r"-4[45] min \d+ s: 300 °C, 10 %", text(opened, "#cursor"))
        assert text(opened, "#spoken").startswith("-0.1 s")  # a mouse that moves is not read out
        opened.js(choose.format("minute"))
        opened.until("document.querySelector('#plot').dataset.points === '601'")
        opened.js("document.getElementById('close').click()")
        assert opened.js("fetch('hour?port=none').then(answer => answer.status)") == 404
        assert [one for one in opened.said if "404" not in one] == []
        opened.close()


def going_on(began: float, lasted_s: float = 60.0) -> Callable[[], RunState]:
    """A run whose first port gains ten rows a second; each temperature is its row's own number of
    tenths of a second.
    """
    run = live_states.run()

    def now() -> RunState:
        rows = round((time.monotonic() - began) * 10) + round(lasted_s * 10)
        first = max(rows - 600, 0)
        numbers = range(first, rows + 1)
        seconds = tuple(number / 10 for number in numbers)
        hour = Trace(
            *[tuple(2.5 + 5 * one for one in range(max(rows // 50 - 1, 0)))] * 2,
            (10.0,) * max(rows // 50 - 1, 0),
        )
        one = replace(run.ports[0], trace=Trace(seconds, seconds, (100,) * len(numbers)), hour=hour)
        return replace(run, stations=(replace(run.stations[0], ports=(one,)),))

    return now


WHERE = """(() => {
  const x = (one) => new DOMMatrix(getComputedStyle(one).transform).e;
  const over = document.querySelector('#plot .u-over');
  return [x(over.querySelector('.u-cursor-x')), x(over.querySelector('.u-cursor-pt')),
    over.clientWidth,
    ...document.getElementById('plot').dataset.window.split(' ').map(Number),
    document.getElementById('cursor').textContent];
})()"""


def drawn_second(opened: Page) -> float:
    """The second at which the cursor stands; marker, readout and what is drawn there are of the
    same second.
    """
    line, marker, width, least, most, said = opened.js(WHERE)
    assert 0 <= line <= width
    assert marker == pytest.approx(line, abs=1)
    second = least + line / width * (most - least)
    # a pixel
    assert float(said.split(": ")[1].split(" ")[0]) == pytest.approx(
        second, abs=2 * (most - least) / width
    )
    return second


def grow_older(opened: Page) -> None:
    """Wait until what the cursor stands on is older by a second at least."""
    opened.js("window.said = document.getElementById('cursor').textContent")
    opened.until(
        "parseFloat(document.getElementById('cursor').textContent) <= parseFloat(window.said) - 1"
    )


def test_cursor_marker_and_text_are_of_one_drawn_point(browser: Chromium) -> None:
    with page(going_on(time.monotonic())) as served:
        opened = seen(browser, served)
        opened.click("article button")
        left, top, width, height = opened.place("#plot .u-over")
        opened.hover(left + width / 2, top + height / 2)
        drawn_second(opened)
        # half a minute before this leaves the plot, however slow the machine is meanwhile
        begin = left + width * 0.6
        opened.drag((begin, top + 50), (begin + 200, top + 60))
        opened.hover(left + 310, top + 50)
        first = drawn_second(opened)
        aged = text(opened, "#cursor")
        grow_older(opened)
        assert drawn_second(opened) == pytest.approx(first, abs=0.001)
        assert text(opened, "#cursor").split(":")[1] == aged.split(":")[1]
        opened.hover(left + 600, top + 50)
        assert drawn_second(opened) > first
        opened.js("document.getElementById('plot').focus()")
        for key, by in (("ArrowLeft", -0.1), ("ArrowLeft", -0.1), ("ArrowRight", 0.1)):
            before = drawn_second(opened)
            opened.key(key)
            # a pixel at each end
            assert drawn_second(opened) - before == pytest.approx(by, abs=0.03)
        opened.key("Home")
        chosen = drawn_second(opened)
        grow_older(opened)
        assert drawn_second(opened) == pytest.approx(chosen, abs=0.2)  # it goes with the trace
        for _ in range(4):
            opened.key("+")
            drawn_second(opened)
        assert opened.said == []
        opened.close()


def test_a_zoomed_trace_stays_when_its_minute_is_over(browser: Chromium) -> None:
    went_on_s = 0.0
    began = time.monotonic()
    with page(lambda: going_on(began - went_on_s)()) as served:
        opened = seen(browser, served)
        opened.click("article button")
        left, top, width, _ = opened.place("#plot .u-over")
        opened.drag((left + width * 0.1, top + 50), (left + width * 0.3, top + 60))
        opened.hover(left + width / 2, top + 50)
        before = drawn_second(opened)
        went_on_s = 100.0
        # three on a machine that is busy meanwhile
        opened.until("/^-[23] min/.test(document.getElementById('cursor').textContent)")
        assert drawn_second(opened) == pytest.approx(before, abs=0.001)
        opened.click("#whole")
        opened.until("document.getElementById('plot').dataset.points === '601'")
        opened.until("document.getElementById('whole').disabled")
        opened.close()


def test_a_trace_by_fingers(browser: Chromium) -> None:
    with page(going_on(time.monotonic())) as served:
        opened = seen(browser, served, 390, 844, phone=True)
        opened.js("document.querySelector('article button').click()")
        opened.settle()
        assert "Pinch to zoom" in opened.js("document.getElementById('detail').innerText")
        assert "Drag to zoom" not in opened.js("document.getElementById('detail').innerText")
        left, top, width, height = opened.place("#plot .u-over")
        x, y = left + width / 2, top + height / 2
        opened.touch(
            [(x - 10, y), (x + 10, y)], [(x - 30, y), (x + 30, y)], [(x - 60, y), (x + 60, y)]
        )
        least, most = window(opened)
        assert 5 < most - least < 20
        opened.touch([(x, y)], [(x + 20, y)], [(x + 40, y)])
        moved, _ = window(opened)
        assert moved < least - 1
        opened.tap_until(x, y, "document.getElementById('cursor').textContent")
        chosen = drawn_second(opened)
        grow_older(opened)
        assert drawn_second(opened) == pytest.approx(chosen, abs=0.001)
        opened.tap_until(x, y, "document.getElementById('whole').disabled", 2)
        # again: the point of before may leave the plot meanwhile
        opened.tap_until(x, y, "document.getElementById('cursor').textContent")
        opened.js("document.getElementById('nearer').click()")
        opened.settle()
        least, most = window(opened)
        assert most - least == pytest.approx(30, abs=1)
        drawn_second(opened)
        assert opened.said == []
        opened.close()


def window(opened: Page) -> tuple[float, float]:
    least, most = opened.js("document.getElementById('plot').dataset.window.split(' ').map(Number)")
    return least, most


LABELS = """(() => { const made = []; const real = CanvasRenderingContext2D.prototype.fillText;
  CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {
    made.push(text); return real.call(this, text, ...more); };
  window.labels = made; })()"""


@pytest.mark.parametrize(
    ("lasted_s", "expected"),
    [(20, r"-\d+ s|now"), (90, r"-\d+ s|now"), (160, r"-\d+ (s|min)|now"), (3000, r"-\d+ min|now")],
)
def test_labels_of_an_hour_are_distinct_and_it_ends_now(
    browser: Chromium, lasted_s: float, expected: str
) -> None:
    with page(going_on(time.monotonic(), lasted_s)) as served:
        opened = seen(browser, served)
        opened.click("article button")
        opened.js(LABELS)
        opened.tab.select_option("#span", "hour")
        opened.until("labels.includes('now')")
        opened.js("labels.length = 0")
        opened.until("labels.includes('now')")
        made = [
            one
            for one in opened.js("labels.slice(0, labels.indexOf('now') + 1)")
            if not one.endswith(("°C", "%"))
        ]
        assert len(made) == len(set(made)) >= 3
        assert all(re.fullmatch(expected, one) for one in made), made
        newest = max(going_on(time.monotonic(), lasted_s)().ports[0].trace.seconds)
        assert window(opened)[1] >= newest - 2  # and not at the end of the last mean
        opened.close()


@pytest.mark.parametrize("width", [320, 390])
def test_settings_can_be_read_on_a_phone(browser: Chromium, width: int) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served, width, 844, phone=True)
        opened.js("document.querySelector('article button').click()")
        cells = (
            "[...document.querySelectorAll('#settings tbody th, #settings tbody td')].filter(one =>"
            " one.offsetHeight)"
        )
        right = opened.js(f"Math.max(...{cells}.map(one => one.getBoundingClientRect().right))")
        assert right <= opened.js("document.getElementById('detail').getBoundingClientRect().right")
        assert opened.js(
            "document.getElementById('detail').scrollWidth <="
            " document.getElementById('detail').clientWidth"
        )
        opened.close()


def test_the_queue_of_a_batch(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        assert opened.js("document.getElementById('queue').hidden")
        served.queues = (live_states.QUEUE,)
        opened.until("document.querySelectorAll('#queue tr').length === 3")
        assert text(opened, "#queue h2") == "batch night: 1 of 3 jobs have ended"
        assert opened.js("document.querySelectorAll('#queue tr')[1].innerText.split('\\t')") == [
            *("smd-2", "running", "recording, 42 s of 90 s")
        ]
        assert opened.js("document.images.length") == 0
        assert opened.js("document.documentElement.scrollWidth") <= 1280
        served.queues = ()
        opened.until("document.getElementById('queue').hidden")
        assert opened.said == []
        opened.close()


def test_runs_of_the_folder_lead_to_their_reports(browser: Chromium, tmp_path: Path) -> None:
    ended = Recording(tmp_path)
    ended.finalize()
    write_report(ended.folder)
    with page(live_states.run(), path=tmp_path) as served:
        opened = seen(browser, served)
        opened.click("summary")
        opened.until("document.querySelectorAll('#runs a').length === 1")
        assert text(opened, "#runs li") == f"{ended.folder.name} · ended · ACCEPT"
        assert opened.said == []
        with opened.tab.expect_navigation():
            opened.tab.click("#runs a")
        assert "ACCEPT" in text(opened, ".verdict h1")
        assert opened.js("self.origin") == "null"
        assert [one for one in opened.said if "sandbox" not in one] == []
        opened.close()


def test_a_trace_grows_and_old_points_leave(browser: Chromium) -> None:
    run = live_states.run()

    def at(last_s: float) -> RunState:
        one = replace(run.ports[0], trace=live_states.trace(last_s=last_s))
        return replace(run, stations=(replace(run.stations[0], ports=(one,)),))

    with page(at(100.0)) as served:
        opened = seen(browser, served)
        opened.click("article button")
        for last_s in (101.0, 130.0, 400.0, 20.0):
            served.answer = at(last_s)
            opened.until(
                "Number((document.querySelector('#plot').dataset.window || '').split('"
                f" ')[1]).toFixed(0) === '{last_s:.0f}'"
            )
            assert opened.js("document.querySelector('#plot').dataset.points") == "601"
        opened.close()


def test_without_messages_nothing_is_known(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
    opened.until("document.title === 'NO CONNECTION – jbclog watch'")
    assert {opened.js(f"{TILE.format(number)}.dataset.condition") for number in range(6)} == {
        "stale"
    }
    assert tile(opened, 0, ".now") == "unknown (no connection; last 349 °C)"
    opened.close()


class ProxyWithoutServer(BaseHTTPRequestHandler):
    """Answers as a reverse proxy does while `jbclog watch` starts again."""

    timeout = 1.0  # a browser may open a connection ahead and ask nothing on it
    refused = 0

    def do_GET(self) -> None:
        self.send_error(502)
        type(self).refused += 1

    def log_message(self, *_: object) -> None: ...


def test_a_screen_that_nobody_touches_comes_back(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
    with HTTPServer(("127.0.0.1", served.port), ProxyWithoutServer) as proxy:
        proxy.timeout = 10.0
        before, end = ProxyWithoutServer.refused, time.monotonic() + ANSWER_S
        while ProxyWithoutServer.refused == before:
            assert time.monotonic() < end
            proxy.handle_request()
    with page(replace(live_states.run(), order="after the break"), port=served.port):
        opened.until("document.getElementById('run').textContent.includes('after the break')")
    opened.close()


def test_trouble_with_the_record_is_shown(browser: Chromium) -> None:
    from jbclog.core.errors import RecordError

    with page(live_states.run()) as served:
        opened = seen(browser, served)
        served.answer = RecordError("the disk is away")
        opened.until("document.getElementById('status').textContent === 'the disk is away'")
        assert opened.js("document.title") == "NOT READABLE – jbclog watch"
        assert {opened.js(f"{TILE.format(number)}.dataset.condition") for number in range(6)} == {
            "stale"
        }
        assert tile(opened, 0, ".now") == "unknown (not readable; last 349 °C)"
        assert tile(opened, 0, ".facts") == "last: set 350 °C · power 12 % · working"
        served.answer = live_states.run()
        opened.until(f"{TILE.format(0)}.dataset.condition === 'normal'")
        assert tile(opened, 0, ".now") == "349 °C"
        opened.close()


@pytest.mark.parametrize("width", [320, 390, 768])
def test_a_phone_shows_everything_without_scrolling_sideways(browser: Chromium, width: int) -> None:
    with page(live_states.run()) as served:
        served.queues = (live_states.QUEUE,)
        opened = seen(browser, served, width, 844, phone=True)
        assert opened.js("document.documentElement.scrollWidth") <= width
        size = float(
            opened.js(
                f"getComputedStyle({TILE.format(0)}.querySelector('.now')).fontSize"
            ).removesuffix("px")
        )
        assert size >= 32  # read at arm's length
        assert (
            opened.js(
                "Math.min(...[...document.querySelectorAll('button, select')].filter(one =>"
                " one.offsetHeight).map(one => one.offsetHeight))"
            )
            >= 44
        )
        opened.close()


def test_words_for_those_who_hear_the_page(browser: Chromium) -> None:
    with page(live_states.run()) as served:
        opened = seen(browser, served)
        tree = opened.ask("Accessibility.getFullAXTree")["nodes"]
        names = {
            (one["role"]["value"], one.get("name", {}).get("value"))
            for one in tree
            if not one["ignored"]
        }
        assert {
            ("button", "Details of dde-1 port 1 T210"),
            ("region", "Ports"),
            ("heading", "dde-1 port 1 T210"),
        } <= names
        assert {
            role for role, name in names if role in ("button", "combobox") and not name
        } == set()
        assert any(role == "status" for role, _ in names)
        opened.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault(browser: Chromium, scheme: str) -> None:
    axe = Path(axe_core_python.__file__).with_name("axe.min.js").read_text(encoding="utf-8")
    with page(live_states.run()) as served:
        served.queues = (live_states.QUEUE,)
        opened = browser.page(1280, 900, scheme=scheme)
        opened.visit(served.address)
        opened.until("document.querySelectorAll('article').length > 0")
        opened.js(f"{axe};0")
        for prepare in ("0", "document.querySelector('article button').click()"):
            opened.js(prepare)
            opened.settle()
            found = (
                "axe.run().then(found => found.violations.map(one => `${one.impact}: ${one.help}:"
                " ${one.nodes[0].html}`))"
            )
            assert opened.js(found) == []
        opened.close()


CONTRAST = """(() => {
  const numbers = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = (text) => { const [r, g, b] = numbers(text)
      .map(one => one / 255)
      .map(one => one <= .04045 ? one / 12.92 : ((one + .055) / 1.055) ** 2.4);
    return .2126 * r + .7152 * g + .0722 * b; };
  const ground = (one) => { for (; one; one = one.parentElement) {
    const back = getComputedStyle(one).backgroundColor;
    if (!/, 0\\)|transparent/.test(back)) return back; } return 'rgb(255, 255, 255)'; };
  const found = [];
  for (const one of document.querySelectorAll('h1, h2, p, span, li, button, select')) {
    if (!one.textContent.trim() || !one.offsetHeight) continue;
    const [a, b] = [light(getComputedStyle(one).color), light(ground(one))].sort((x, y) => y - x);
    if ((a + .05) / (b + .05) < 4.5) found.push(one.className + ' ' + one.textContent);
  }
  return found;
})()"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_can_be_read(browser: Chromium, scheme: str) -> None:
    """WCAG 2.2, 1.4.3: a contrast of 4.5 to 1."""
    with page(live_states.run()) as served:
        opened = browser.page(1280, 900, scheme=scheme)
        opened.visit(served.address)
        opened.until("document.querySelectorAll('article').length > 0")
        assert opened.js(CONTRAST) == []
        opened.close()


def many(tick: int, ports: int = 16) -> RunState:
    """Ports that were recorded at 10 Hz, 5 rows later at each step."""
    made = tuple(
        PortState(
            "line",
            number,
            "T210",
            Condition.NORMAL,
            "ok",
            0.2,
            {"temperature_c": live_states.known(350 + tick % 9)},
            (),
            (),
            Coverage(tick, tick, is_whole=True),
            live_states.trace(last_s=tick / 2),
        )
        for number in range(1, ports + 1)
    )
    return replace(live_states.run(), stations=(live_states.station("line", *made),))


def sizes(opened: Page) -> tuple[int, int]:
    """Nodes of the document, and bytes of its scripts."""
    opened.ask("HeapProfiler.collectGarbage")
    return (
        opened.ask("Memory.getDOMCounters")["nodes"],
        opened.ask("Runtime.getHeapUsage")["usedSize"],
    )


DRAWS = """(() => { window.draws = 0; const real = CanvasRenderingContext2D.prototype.clearRect;
  CanvasRenderingContext2D.prototype.clearRect = function (...more) {
    window.draws += 1; return real.apply(this, more); }; })()"""


@pytest.mark.parametrize(
    ("ports", "seconds"),
    [(4, 30), pytest.param(64, 300, marks=[pytest.mark.campaign, pytest.mark.timeout(900)])],
)
def test_many_ports_for_long_without_growth(browser: Chromium, ports: int, seconds: int) -> None:
    ticks = iter(range(200, 1_000_000))
    with page(lambda: many(next(ticks), ports)) as served:
        opened = seen(browser, served)
        opened.js("new Promise(done => setTimeout(done, 3000))")
        opened.js(DRAWS)
        began, measured = time.monotonic(), [(0.0, *sizes(opened), 0)]
        for end_s in range(30, seconds + 1, 30):
            while time.monotonic() < began + end_s:
                opened.js("new Promise(done => setTimeout(done, 500))")
            measured.append((time.monotonic() - began, *sizes(opened), opened.js("draws") // ports))
        for passed_s, nodes, heap, draws in measured:
            print(
                f"{ports} ports, {passed_s:.0f} s: {nodes} nodes, heap {heap / 1e6:.2f} MB,"
                f" {draws / max(passed_s, 1):.2f} draws a second"
            )
        (_, nodes, heap, _), (passed_s, later_nodes, later_heap, draws) = measured[0], measured[-1]
        # two messages come a second; a node that stays of each, or of each port, would be more
        assert later_nodes <= nodes + 50
        assert later_heap <= heap * 1.3 + 1_000_000
        assert 0 < draws <= 2 * passed_s + 2
        assert opened.said == []
        assert {one.removeprefix(served.address) for one in opened.requests} <= LOADED
        opened.close()


# -- of a run that is recorded ---------------------------------------------------------------------


# 2 s: on an idle machine
@pytest.mark.parametrize("most_s", [60.0, pytest.param(2.0, marks=pytest.mark.campaign)])
def test_an_alarm_is_visible_soon_after_its_commit(
    browser: Chromium, tmp_path: Path, most_s: float
) -> None:
    recording = Recording(tmp_path)
    recording.rows(20)
    recording.commit()
    with Follower(tmp_path) as follower, page(follower.poll) as served:
        opened = seen(browser, served)
        recording.rows(1, temperature_c=392)
        recording.event("alarm.high", "above 380 °C", 1)
        recording.commit()
        opened.until(f"{TILE.format(0)}.dataset.condition === 'alarm'", most_s)
        assert tile(opened, 0, ".wrong") == "above 380 °C"
        # again and again: two seconds after its row a port is stale, seen or not
        end = time.monotonic() + ANSWER_S
        while not opened.js(f"{TILE.format(1)}.dataset.condition === 'not known'"):
            assert time.monotonic() < end
            recording.rows(1)
            recording.rows(
                1,
                temperature_c=None,
                power_permille=None,
                quality="disconnected",
                reasons="temperature_c=disconnected",
            )
            recording.commit()
            opened.tab.wait_for_timeout(1000)
        opened.close()
    recording.abandon()


def test_a_killed_recorder_is_seen_as_such(browser: Chromium, tmp_path: Path) -> None:
    process = subprocess.Popen(
        program("records.live_rows", tmp_path), stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    with Follower(tmp_path) as follower, page(follower.poll) as served:
        opened = seen(browser, served)
        opened.until("document.getElementById('run').textContent.includes('RECORDING')")
        process.send_signal(signal.SIGKILL)
        process.communicate()
        opened.until("document.getElementById('run').textContent.includes('CRASHED')")
        assert opened.js(f"{TILE.format(0)}.dataset.condition") == "stale"
        assert "without finalizing" in text(opened, "#status")
        assert opened.js("document.title") == "CRASHED – jbclog watch"
        opened.close()
