"use strict";
// The plot of a port's trace: drawn, zoomed and read off by mouse, keys and fingers while data goes on arriving.
//
// `data()` gives seconds, temperatures and powers; `now()` the seconds of the newest reading, to which ages refer. While it is zoomed, the
// points in it are held: what is looked at stays, and grows older. Crosshair, markers and text are always those of one drawn point.
const tracePlot = (() => {
  const STEPS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800], LABEL_PX = 75, LEAST_POINTS = 3, TWICE_MS = 400, PAUSE_MS = 500;
  const HEIGHT = 280, SAME_S = 1e-6;
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const inWindow = (view, place) => { const { min, max } = view.scales.x, one = view.data[0][place]; return one >= min - SAME_S && one <= max + SAME_S; };

  function ageText(seconds) {
    const tenths = Math.round(seconds * 10) / 10;
    if (tenths <= 0) return "0.0 s";
    return tenths < 120 ? `-${tenths.toFixed(1)} s` : `-${Math.floor(tenths / 60)} min ${Math.floor(tenths % 60)} s`;
  }

  return (data, now) => {
    const ids = ["plot", "cursor", "spoken", "nearer", "farther", "whole"];
    const [host, readout, spoken, nearer, farther, all] = ids.map((id) => document.getElementById(id));
    const listening = new AbortController(), on = (element, name, act) => element.addEventListener(name, act, { signal: listening.signal });
    const say = (text) => { if (readout.textContent !== text) readout.textContent = text; };
    let zoom = null; // seconds from and to
    let speech = null; // a point that was chosen is read out once it is not left again at once
    let aim = null; // of the cursor: where the mouse is, or the seconds of the point that a key or a finger chose

    function ticks(view, _, min, max) { // round distances from now
      const most = Math.max(view.bbox.width / (window.devicePixelRatio || 1) / LABEL_PX, 2), step = STEPS_S.find((one) => (max - min) / one <= most) || 3600;
      const end = now(), found = [];
      for (let count = Math.max(Math.ceil((end - max) / step - SAME_S), 0); end - count * step >= min - SAME_S; count += 1) found.unshift(end - count * step);
      return found;
    }
    function tickText(_, places) {
      const step = places.length > 1 ? places[1] - places[0] : 60, end = now();
      return places.map((place) => {
        const before = end - place;
        if (before < SAME_S) return "now";
        return step > 59 ? `-${(before / 60).toFixed(0)} min` : `-${before.toFixed(step < 0.9 ? 1 : 0)} s`;
      });
    }
    function snapped(view, left, top) { // the cursor stands on the point that is read
      if (left < 0 || !view.data[0].length) return [left, top];
      const place = view.posToIdx(left);
      return [inWindow(view, place) ? view.valToPos(view.data[0][place], "x") : left, top];
    }

    const axis = { stroke: colour("--ink"), grid: { stroke: colour("--line") }, ticks: { stroke: colour("--line") } };
    let plot = new uPlot({
      width: Math.max(host.clientWidth, 200), height: HEIGHT, legend: { show: false },
      scales: { x: { time: false }, power: { range: [0, 100] } },
      axes: [
        { ...axis, splits: ticks, values: tickText },
        { ...axis, values: (_, places) => places.map((place) => `${place} °C`), size: 70 },
        { ...axis, scale: "power", side: 1, values: (_, places) => places.map((place) => `${place} %`), grid: { show: false }, size: 60 },
      ],
      series: [{}, { stroke: colour("--trace"), width: 2 }, { stroke: colour("--power"), width: 1, scale: "power", dash: [4, 3] }],
      cursor: {
        move: snapped, drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => whole() },
        dataIdx: (view, _, place) => (inWindow(view, place) ? place : null),
      },
      hooks: { setCursor: [read], setSelect: [selected] },
    }, data(), host);

    function read(view) {
      const place = view.cursor.idx;
      if (place === null || place === undefined || !inWindow(view, place)) { say(""); return; }
      const [seconds, temperature, power] = view.data;
      const text = (value, unit) => (value === null || value === undefined ? "not read" : `${value} ${unit}`);
      say(`${ageText(now() - seconds[place])}: ${text(temperature[place], "°C")}, ${text(power[place], "%")}`);
    }

    function point() { // again where it was, on what is drawn now
      if (!plot || aim === null) return;
      const { min, max } = plot.scales.x;
      if (aim.seconds === undefined) plot.setCursor(aim);
      else if (min !== null && aim.seconds >= min - SAME_S && aim.seconds <= max + SAME_S) plot.setCursor({ left: plot.valToPos(aim.seconds, "x"), top: 10 });
      else { aim = null; plot.setCursor({ left: -10, top: -10 }); }
    }

    function speak() {
      clearTimeout(speech);
      speech = setTimeout(() => { spoken.textContent = readout.textContent; }, PAUSE_MS);
    }

    function redraw() {
      if (zoom === null) plot.setData(data(), true);
      else { plot.setScale("x", { min: zoom[0], max: zoom[1] }); plot.redraw(false, true); } // the labels: its points grow older
      all.disabled = zoom === null;
      Promise.resolve().then(() => { // after uPlot has drawn
        if (!plot) return;
        point();
        read(plot);
        const { min, max } = plot.scales.x;
        host.dataset.points = String(plot.data[0].length);
        if (min !== null) host.dataset.window = `${min} ${max}`;
      });
    }

    function whole() { zoom = null; redraw(); }

    function look(from, to) { // at these seconds, of the points that are held
      const seconds = plot.data[0], first = seconds[0], end = seconds[seconds.length - 1];
      if (seconds.length <= LEAST_POINTS) return;
      const width = Math.max(to - from, LEAST_POINTS * (end - first) / (seconds.length - 1));
      if (width >= end - first) { whole(); return; }
      const start = Math.min(Math.max(from, first), end - width);
      zoom = [start, start + width];
      redraw();
    }
    function selected(view) {
      const { left, width } = view.select;
      if (width > 4) look(view.posToVal(left, "x"), view.posToVal(left + width, "x"));
      view.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    }
    function zoomed(factor, about) {
      const { min, max } = plot.scales.x;
      if (min === null) return;
      const isAimed = aim !== null && plot.cursor.idx !== null && plot.cursor.idx !== undefined;
      const fixed = about !== undefined ? about : isAimed ? plot.data[0][plot.cursor.idx] : (min + max) / 2;
      look(fixed - (fixed - min) * factor, fixed + (max - fixed) * factor);
    }
    function step(by) {
      const { min, max } = plot.scales.x, seconds = plot.data[0];
      const first = seconds.findIndex((one) => one >= min - SAME_S), after = seconds.findIndex((one) => one > max + SAME_S);
      const end = (after < 0 ? seconds.length : after) - 1, { idx } = plot.cursor;
      if (first < 0 || end < first) return;
      aim = { seconds: seconds[Math.min(Math.max(idx === null || idx === undefined ? end : idx + by, first), end)] };
      point();
      speak();
    }

    const KEYS = {
      ArrowLeft: () => step(-1), ArrowRight: () => step(1), "+": () => zoomed(0.5), "=": () => zoomed(0.5), "-": () => zoomed(2), Home: whole,
    };
    on(host, "keydown", (event) => {
      const act = event.ctrlKey || event.metaKey || event.altKey ? null : KEYS[event.key];
      if (!plot || !act) return;
      event.preventDefault();
      act();
    });
    on(nearer, "click", () => zoomed(0.5));
    on(farther, "click", () => zoomed(2));
    on(all, "click", whole);

    const fingers = new Map();
    let tapped = -Infinity;
    const secondAt = (clientX) => {
      const box = plot.over.getBoundingClientRect();
      return plot.posToVal(Math.min(Math.max(clientX - box.left, 0), box.width), "x");
    };
    on(host, "pointerdown", (event) => { if (event.pointerType === "touch") fingers.set(event.pointerId, event.clientX); });
    on(host, "pointermove", (event) => {
      if (!plot) return;
      if (event.pointerType !== "touch") {
        const box = plot.over.getBoundingClientRect(), left = event.clientX - box.left, top = event.clientY - box.top;
        aim = left < 0 || top < 0 || left > box.width || top > box.height ? null : { left, top };
        return;
      }
      if (!fingers.has(event.pointerId)) return;
      const before = [...fingers.values()], { min, max } = plot.scales.x;
      fingers.set(event.pointerId, event.clientX);
      const after = [...fingers.values()];
      if (after.length === 1 && zoom !== null) {
        const by = (before[0] - after[0]) / plot.over.clientWidth * (max - min);
        look(min + by, max + by);
      } else if (after.length === 2) {
        const ratio = Math.abs(before[0] - before[1]) / Math.max(10, Math.abs(after[0] - after[1]));
        if (ratio > 0) zoomed(ratio, secondAt((after[0] + after[1]) / 2));
      }
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
      on(host, end, (event) => {
        fingers.delete(event.pointerId);
        if (end === "pointerleave" && event.pointerType !== "touch" && aim && aim.seconds === undefined) aim = null;
      });
    }
    on(host, "click", (event) => {
      if (!plot || event.pointerType !== "touch" || !plot.data[0].length) return;
      const isSecond = event.timeStamp - tapped < TWICE_MS;
      tapped = event.timeStamp;
      if (isSecond) { whole(); return; }
      const box = plot.over.getBoundingClientRect();
      aim = { seconds: plot.data[0][plot.posToIdx(Math.min(Math.max(event.clientX - box.left, 0), box.width))] };
      speak();
      setTimeout(point, 0); // after uPlot, for which a finger that is lifted leaves the plot
    });

    function refresh() {
      if (zoom !== null && now() < zoom[1] - SAME_S) zoom = null; // another run, or a clock that was set back
      redraw();
    }
    function resize() {
      plot.setSize({ width: Math.max(host.clientWidth, 200), height: HEIGHT });
      Promise.resolve().then(point);
    }
    function destroy() {
      listening.abort();
      clearTimeout(speech);
      spoken.textContent = "";
      plot.destroy();
      plot = null;
      say("");
    }
    return { refresh, resize, destroy, whole };
  };
})();
