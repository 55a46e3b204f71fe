"""The interactive view in Chromium: it shows the record's readings, alarms and gaps, by mouse, keys
and fingers.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jbclog.report import zoom
from jbclog.report.write import report_files, write_report
from support.readers.browser import PROGRAM, Chromium, Page, chromium
from support.records.sealed_run import alarm, limit, lose, samples, seal, station, table

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="chromium is not installed")

ROWS, HZ, GAP, LOST_POWER, HOT = 6000, 10, slice(3000, 3030), 2950, slice(3080, 3085)
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"
LINE, ALARM, HATCH = (11, 79, 138), (200, 64, 10), (141, 153, 166)
Pixels = np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]
PIXELS = """(panel, first, last) => {
  const over = document.querySelectorAll(".zoom .u-over")[panel];
  const canvas = over.parentNode.querySelector("canvas");
  const box = canvas.getBoundingClientRect(), field = over.getBoundingClientRect();
  const x = Math.ceil(first - box.left);
  const wide = Math.floor(last - box.left) - x, top = Math.round(field.top - box.top) + 1;
  const found = canvas.getContext("2d").getImageData(x, top, wide, Math.round(field.height) - 2);
  let bytes = "";  // a number of JSON for each of a million takes seconds
  for (let at = 0; at < found.data.length; at += 8192)
    bytes += String.fromCharCode(...found.data.subarray(at, at + 8192));
  return [found.width, found.height, btoa(bytes)];
}"""
OPEN, PANELS, VALUE, WINDOW = (
    "figure[data-zoom] > .zoom-bar button",
    ".zoom-panels",
    ".zoom-value",
    ".zoom-window",
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Chromium]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten minutes with an outage of 3 s, a lost power reading, an alarm, and a status that is
    hostile text.
    """
    columns = samples(ROWS)
    lose(columns, GAP)
    columns["power_permille"][LOST_POWER] = np.nan
    columns["reasons"][LOST_POWER] = "power_permille=timeout"
    columns["temperature_c"][HOT] = 392
    columns["status"][5000:5020] = HOSTILE
    limits = [limit("high", "380"), limit("low", "300")]
    folder = seal(
        tmp_path_factory.mktemp("runs"), [station(rows=ROWS)], table(columns), [alarm(310)], limits
    )
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def rows(run: Path) -> pd.DataFrame:
    """What the Parquet holds."""
    return pd.concat(
        pd.read_parquet(part) for part in sorted((run / "samples").glob("*.parquet"))
    ).set_index("tick")


class View:
    """The open view of a page's only port."""

    def __init__(self, page: Page, run: Path) -> None:
        self.page = page
        page.open(run / "report.html")
        page.click(OPEN)
        page.place(".zoom")

    @property
    def window(self) -> tuple[float, float]:
        start, end = self.page.js("document.querySelector('.zoom').dataset.window").split()
        return float(start), float(end)

    @property
    def points(self) -> int:
        return int(self.page.js("document.querySelector('.zoom').dataset.points"))

    def text(self, selector: str = VALUE) -> str:
        return str(self.page.js(f"document.querySelector('{selector}').textContent"))

    def field(self, panel: int = 0) -> tuple[float, float, float, float]:
        """Left, top, width and height of what a panel's axes enclose."""
        box = self.page.js(
            "(() => { const r = document.querySelectorAll('.zoom"
            f" .u-over')[{panel}].getBoundingClientRect(); return [r.left, r.top, r.width,"
            " r.height]; })()"
        )
        return tuple(box)

    def x(self, second: float) -> float:
        left, _, width, _ = self.field()
        start, end = self.window
        return left + (second - start) / (end - start) * width

    def hover(self, second: float) -> str:
        _, top, _, height = self.field()
        self.page.hover(self.x(second), top + height / 2)
        return self.text()

    def select(self, start: float, end: float) -> None:
        """Drag over a stretch of time."""
        _, top, _, height = self.field()
        self.page.drag((self.x(start), top + height / 2), (self.x(end), top + height / 2))

    def colours(self, panel: int, start: float, end: float) -> Pixels:
        """The pixels of a panel's canvas between two times: rows, columns, red-green-blue."""
        width, height, pixels = self.page.js(f"({PIXELS})({panel}, {self.x(start)}, {self.x(end)})")
        found = np.frombuffer(base64.b64decode(pixels), dtype=np.uint8)
        return found.reshape(height, width, 4)[:, :, :3]


def near(
    pixels: Pixels, colour: tuple[int, int, int]
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    return np.abs(pixels.astype(int) - colour).max(axis=2) <= 40


@pytest.fixture
def desk(browser: Chromium, run: Path) -> Iterator[View]:
    page = browser.page(1200, 900)
    yield View(page, run)
    assert page.said == []  # no script failed, the policy refused nothing
    page.close()


@pytest.fixture
def phone(browser: Chromium, run: Path) -> Iterator[View]:
    page = browser.page(390, 844, phone=True)
    yield View(page, run)
    assert page.said == []
    page.close()


def test_a_selected_window_shows_each_reading(desk: View, rows: pd.DataFrame) -> None:
    assert "min–max of each" in desk.text(WINDOW)
    assert desk.points == 0
    desk.select(285, 325)
    start, end = desk.window
    assert (abs(start - 285) < 1, abs(end - 325) < 1) == (True, True)
    assert "every reading" in desk.text(WINDOW)
    assert desk.points == sum(start <= tick / HZ <= end for tick in rows.index)
    for tick in (2903, 2931, 3049, 3082, 3111, 3200):
        text, row = desk.hover(tick / HZ), rows.loc[tick]
        assert f"temperature {row['temperature_c']} °C · power {row['power_permille']} ‰" in text
        assert text.startswith(
            f"{row['time'].floor('100ms'):%H:%M:%S}.{row['time'].microsecond // 100_000} UTC: "
        )
        # after the outage it is not known until it is read again
        assert ("set 350 °C" in text) == (tick != 3049)
        assert "working" in text


def test_what_was_not_read_says_why_and_no_line_crosses_it(desk: View) -> None:
    desk.select(290, 312)
    assert (
        desk.hover(301.5)
        .split(": ", 1)[1]
        .startswith("temperature not read: disconnected · power not read: disconnected")
    )
    assert "no data: disconnected, 3.1 s" in desk.text()
    assert "power not read: timeout" in desk.hover(LOST_POWER / HZ)
    assert "temperature 3" in desk.text()
    gap, before = desk.colours(0, 300.1, 302.8), desk.colours(0, 297, 299.8)
    assert not near(gap, LINE).any()
    assert near(gap, HATCH).any(axis=0).all()
    assert near(before, LINE).any(axis=0).all()
    assert not near(desk.colours(1, 300.1, 302.8), (122, 77, 0)).any()


def test_a_gap_shows_in_the_whole_run_too(desk: View) -> None:
    assert not near(desk.colours(0, 300.2, 302.9), LINE).any()
    assert near(desk.colours(0, 295, 300), (156, 195, 230)).any()  # the band
    assert near(desk.colours(2, 300, 303), HATCH).any()


def test_alarms_limits_and_joints_are_drawn(desk: View) -> None:
    desk.select(303, 317)
    assert "alarm high" in desk.hover(309)
    lane = near(desk.colours(2, 308.2, 309.8), ALARM)
    assert lane.all(axis=1).any()  # a row of the lane is full
    assert not near(desk.colours(2, 311, 316), ALARM).any()
    tint = near(desk.colours(0, 308.2, 309.8), (246, 222, 211))
    assert tint.mean() > 0.5
    dotted = near(desk.colours(0, 311, 316), ALARM)
    assert dotted.sum(axis=1).max() > 20  # the limit
    foot = near(desk.colours(0, 313.9, 314.5), LINE)[-3]
    assert foot.all()  # the joint's bar
    assert "joint" in desk.hover(314.2)


def test_a_wide_window_tells_the_records_extremes(desk: View, rows: pd.DataFrame) -> None:
    zero = rows["time"].iloc[0].floor("s")
    for second in (41.0, 222.0, 308.1, 555.0):
        text = desk.hover(second)
        found = re.match(
            r"([\d:.]+) to ([\d:.]+) UTC: temperature (\d+)(?: to (\d+))? °C · power (\d+)(?: to"
            r" (\d+))? ‰",
            text,
        )
        assert found, text
        ends = [
            round((pd.Timestamp(f"{zero:%Y-%m-%d} {one}", tz="UTC") - zero).total_seconds() * HZ)
            for one in found.group(1, 2)
        ]
        mine = rows.loc[ends[0] : ends[1] - 1]
        for name, low, high in (
            ("temperature_c", *found.group(3, 4)),
            ("power_permille", *found.group(5, 6)),
        ):
            assert (int(low), int(high or low)) == (mine[name].min(), mine[name].max()), text


def test_the_keyboard_does_all_of_it(desk: View, rows: pd.DataFrame) -> None:
    desk.page.js(f"document.querySelector('{PANELS}').focus()")
    whole = desk.window
    desk.page.key("n")  # the outage
    assert "no data: disconnected" in desk.text()
    assert "every reading" in desk.text(WINDOW)
    desk.page.key("n")
    assert "alarm high" in desk.text()
    assert f"temperature {rows.loc[3080, 'temperature_c']} °C" in desk.text()
    desk.page.key("ArrowRight")
    assert f"power {rows.loc[3081, 'power_permille']} ‰" in desk.text()
    desk.page.key("ArrowLeft")
    assert f"power {rows.loc[3080, 'power_permille']} ‰" in desk.text()
    start, end = desk.window
    desk.page.key("+")
    assert np.isclose(np.diff(desk.window)[0], (end - start) / 2)
    desk.page.key("-")
    assert np.isclose(np.diff(desk.window)[0], end - start)
    desk.page.key("PageDown")
    assert np.isclose(desk.window[0], start + (end - start) / 2)
    desk.page.key("Home")
    assert desk.window == whole == (0.0, ROWS / HZ)


def test_text_from_outside_is_only_text(desk: View) -> None:
    desk.select(490, 510)
    assert HOSTILE in desk.hover(501.0)
    assert desk.page.js("document.querySelectorAll('.zoom img').length") == 0
    assert "owned" not in desk.page.js("document.title")


def test_a_phone_moves_pinches_and_taps(phone: View, rows: pd.DataFrame) -> None:
    assert phone.page.js("document.scrollingElement.scrollWidth") <= 390
    small = (
        "Array.from(document.querySelectorAll('.zoom-bar button')).filter((one) =>"
        " one.getBoundingClientRect().height < 44)"
    )
    assert phone.page.js(f"{small}.length") == 0
    left, top, width, height = phone.field()
    y = top + height / 2
    apart = [
        [(left + width * (0.5 - half), y), (left + width * (0.5 + half), y)]
        for half in (0.05, 0.1, 0.2, 0.4)
    ]
    for _ in range(2):
        phone.page.touch(*apart)
    start, end = phone.window
    assert end - start < 30
    assert "every reading" in phone.text(WINDOW)
    phone.page.touch(
        [(left + 0.8 * width, y)], [(left + 0.6 * width, y)], [(left + 0.3 * width, y)]
    )
    assert np.isclose(phone.window[0] - start, 0.5 * (end - start), rtol=0.1)
    assert np.isclose(np.diff(phone.window)[0], end - start)
    tick = round(phone.window[0] * HZ) + 60
    phone.page.tap_until(
        phone.x(tick / HZ), y, f"document.querySelector('{VALUE}').textContent.includes('°C')"
    )
    assert f"temperature {rows.loc[tick, 'temperature_c']} °C" in phone.text()
    # a line in every panel
    phone.page.until("document.querySelectorAll('.zoom .u-cursor-x:not(.u-off)').length === 3")


def test_beyond_the_share_of_a_port_readings_stand_around_the_alarm_and_extremes_elsewhere(
    browser: Chromium,
    run: Path,
    rows: pd.DataFrame,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(zoom, "MOST_READINGS", 3000)
    (tmp_path / "report.html").write_bytes(report_files(run)["report.html"])
    page = browser.page(1200, 900)
    view = View(page, tmp_path)
    view.select(290, 330)
    assert "every reading" in view.text(WINDOW)
    assert f"temperature {rows.loc[3083, 'temperature_c']} °C" in view.hover(308.3)
    page.js(f"document.querySelector('{PANELS}').focus()")
    page.key("Home")
    view.select(260, 300)  # the single readings begin 30 s before the alarm
    assert "every reading where they are in the page" in view.text(WINDOW)
    _, end = view.window
    assert view.points == sum(278 <= tick / HZ <= end for tick in rows.index)
    assert " to " in view.hover(270.0).split(" UTC")[0]
    assert f"temperature {rows.loc[2903, 'temperature_c']} °C" in view.hover(290.3)
    page.key("Home")
    view.select(30, 70)
    assert view.points == 0
    assert "every reading" not in view.text(WINDOW)
    assert "the record holds all" in view.text(WINDOW)
    found = re.search(
        r"^([\d:.]+) to ([\d:.]+) UTC: temperature (\d+)(?: to (\d+))? °C", view.hover(50.0)
    )
    assert found
    ends = [pd.Timestamp(f"2026-09-21 {one}", tz="UTC") for one in found.group(1, 2)]
    grid = pd.Timestamp("2026-09-21 14:13:20", tz="UTC") + pd.to_timedelta(
        rows.index / HZ, unit="s"
    )
    mine = rows[(grid >= ends[0]) & (grid < ends[1])]["temperature_c"]
    assert len(mine) in range(10, 40)
    assert (int(found[3]), int(found[4] or found[3])) == (mine.min(), mine.max())
    span = [(one - pd.Timestamp("2026-09-21 14:13:20", tz="UTC")).total_seconds() for one in ends]
    band = near(view.colours(0, span[0] + 0.1, span[1] - 0.1), (156, 195, 230))
    assert np.ptp(band.sum(axis=0)) <= 3  # as high over its whole width: no slope to the next
    assert page.said == []
    page.close()


def test_without_scripts_the_static_figures_stand(browser: Chromium, run: Path) -> None:
    page = browser.page(1200, 900, scripts=False)
    page.open(run / "report.html")
    assert page.js("document.querySelectorAll('.zoom-bar').length") == 0
    there = (
        "Array.from(document.querySelectorAll('figure img.wide')).filter((one) => one.complete &&"
        " one.clientHeight > 100)"
    )
    assert page.js(f"{there}.length") == page.js("document.querySelectorAll('figure').length") > 0
