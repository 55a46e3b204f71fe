"use strict";
// Looking closer at a figure: drag over a stretch of time, or use the buttons. Nothing is loaded and nothing is sent.
(function () {
  var NOTHING = -32768, INK = "#1c2733", QUIET = "#5d6b7a", GRID = "#e3e8ee";
  function decoded(text) {
    var raw = atob(text), view = new DataView(new ArrayBuffer(raw.length)), i;
    for (i = 0; i < raw.length; i++) view.setUint8(i, raw.charCodeAt(i));
    var all = new Int16Array(raw.length / 2), n = all.length / 4;
    for (i = 0; i < all.length; i++) all[i] = view.getInt16(2 * i, true);
    return [0, 1, 2, 3].map(function (k) { return all.subarray(k * n, (k + 1) * n); });
  }
  function nice(span, most) {
    var power = Math.pow(10, Math.floor(Math.log10(span / most))), steps = [1, 2, 5, 10], i;
    for (i = 0; i < 4; i++) if (span / (steps[i] * power) <= most) return Math.max(1, steps[i] * power);
    return 10 * power;
  }
  var STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800];
  function clock(seconds, step) {
    var text = new Date(seconds * 1000).toISOString();
    return step >= 86400 ? text.slice(5, 10) : step >= 60 ? text.slice(11, 16) : text.slice(11, 19);
  }
  function element(name, text, parent) {
    var made = document.createElement(name);
    if (text) made.textContent = text;
    parent.appendChild(made);
    return made;
  }
  function install(figure) {
    var set = figure.dataset, first = +set.start, last = +set.end, series = null, from = first, to = last, drag = null;
    var lines = set.lines ? set.lines.split(",").map(function (one) { return one.split(" "); }) : [];
    var joints = (set.joints || "").split(",").filter(Boolean).map(function (one) {
      var parts = one.replace("!", "").split("."), begin = first + parseInt(parts[0], 16) / 10;
      return [begin, begin + parseInt(parts[1], 16) / 10, one.indexOf("!") > 0];
    });
    var bar = element("div", "", figure), canvas = null, told = null;
    bar.className = "closer";
    var open = element("button", "Look closer", bar);
    open.type = "button";
    open.addEventListener("click", function () { return canvas ? shut() : start(); });
    function shut() {
      figure.classList.remove("open");
      open.textContent = "Look closer";
      while (bar.childNodes.length > 1) bar.removeChild(bar.lastChild);
      figure.removeChild(canvas);
      canvas = null;
    }
    function start() {
      series = series || decoded(set.zoom);
      figure.classList.add("open");
      open.textContent = "Close";
      [["+", "Closer", 0.5, 0], ["\u2212", "Wider", 2, 0], ["\u25c2", "Earlier", 1, -0.5], ["\u25b8", "Later", 1, 0.5]].forEach(function (one) {
        var button = element("button", one[0], bar);
        button.type = "button";
        button.setAttribute("aria-label", one[1]);
        button.addEventListener("click", function () { move(one[2], one[3]); });
      });
      var whole = element("button", "Whole run", bar);
      whole.type = "button";
      whole.addEventListener("click", function () { show(first, last); });
      told = element("output", "Drag over a stretch of time to see it closer.", bar);
      canvas = document.createElement("canvas");
      figure.insertBefore(canvas, bar);
      canvas.addEventListener("pointerdown", function (event) { drag = [at(event), at(event)]; canvas.setPointerCapture(event.pointerId); });
      canvas.addEventListener("pointermove", function (event) { if (drag) drag[1] = at(event); tell(at(event)); draw(); });
      canvas.addEventListener("pointerup", function () {
        var ends = drag && drag.slice().sort(function (a, b) { return a - b; });
        drag = null;
        if (ends && ends[1] - ends[0] > (to - from) / 80) show(ends[0], ends[1]); else draw();
      });
      canvas.addEventListener("pointercancel", function () { drag = null; draw(); });
      canvas.addEventListener("dblclick", function () { show(first, last); });
      show(first, last);
    }
    function move(factor, by) {
      var half = (to - from) / 2 * factor, middle = (from + to) / 2 + by * (to - from);
      middle = Math.min(Math.max(middle, first + half), last - half);
      show(middle - half, middle + half);
    }
    function show(a, b) {
      var least = Math.max(2, 8 * (last - first) / series[0].length), middle = (a + b) / 2;
      if (b - a < least) { a = middle - least / 2; b = middle + least / 2; }
      from = Math.max(first, a);
      to = Math.min(last, b);
      draw();
    }
    function place() { var box = canvas.getBoundingClientRect(); return { left: 40, right: box.width - 62, width: box.width, height: box.height, x: box.left }; }
    function at(event) {
      var p = place(), share = (event.clientX - p.x - p.left) / (p.right - p.left);
      return from + Math.min(Math.max(share, 0), 1) * (to - from);
    }
    function index(second) { return (second - first) / (last - first) * series[0].length; }
    function ends(k, a, b) {
      var low = Infinity, high = -Infinity, i, n = series[0].length, stop = Math.min(n, Math.max(Math.ceil(b), Math.floor(a) + 1));
      for (i = Math.max(0, Math.floor(a)); i < stop; i++) {
        if (series[k][i] !== NOTHING) { low = Math.min(low, series[k][i]); high = Math.max(high, series[k + 1][i]); }
      }
      return low <= high ? [low, high] : null;
    }
    function tell(second) {
      var i = index(second), t = ends(0, i, i), p = ends(2, i, i);
      function said(pair, unit) { return pair ? (pair[0] === pair[1] ? pair[0] : pair[0] + " to " + pair[1]) + " " + unit : "not read"; }
      told.textContent = new Date(second * 1000).toISOString().slice(11, 21) + " UTC: " + said(t, "\u00b0C") + ", " + said(p, "\u2030");
    }
    function draw() {
      var p = place(), ratio = window.devicePixelRatio || 1, c = canvas.getContext("2d");
      canvas.width = Math.round(p.width * ratio);
      canvas.height = Math.round(p.height * ratio);
      c.scale(ratio, ratio);
      c.font = "12px system-ui, sans-serif";
      c.fillStyle = "#fff";
      c.fillRect(0, 0, p.width, p.height);
      times(c, p);
      var seen = ends(0, index(from), index(to)) || [0, 400], wanted = +((lines[0] || [])[1] || seen[0]);
      var low = Math.min(seen[0], wanted), high = Math.max(seen[1], wanted), air = Math.max(4, 0.08 * (high - low));
      touched(c, p, 22, 0.64 * p.height);
      panel(c, p, 0, 22, 0.64 * p.height, low - air, high + air, "#0b4f8a", "#9cc3e6", "Tip temperature in \u00b0C".replace("Tip", set.what), lines);
      panel(c, p, 2, 0.64 * p.height + 24, p.height - 24, 0, Math.max(100, (ends(2, index(from), index(to)) || [0, 1000])[1] * 1.08), "#7a4d00", "#efc98a", "Power in \u2030", []);
      if (drag) {
        var a = p.left + (drag[0] - from) / (to - from) * (p.right - p.left), b = p.left + (drag[1] - from) / (to - from) * (p.right - p.left);
        c.fillStyle = "rgba(28, 39, 51, .14)";
        c.fillRect(Math.min(a, b), 8, Math.abs(b - a), p.height - 30);
      }
    }
    function touched(c, p, top, bottom) {
      function x(second) { return p.left + (Math.min(Math.max(second, from), to) - from) / (to - from) * (p.right - p.left); }
      joints.forEach(function (one) {
        if (one[1] < from || one[0] > to) return;
        var a = x(one[0]), wide = Math.max(x(one[1]) - a, 1), high = one[2] ? 9 : 5;
        c.fillStyle = "rgba(11, 79, 138, .09)";
        if (wide > 4) c.fillRect(a, top, wide, bottom - top);
        c.fillStyle = one[2] ? "#c8400a" : "#0b4f8a";
        c.fillRect(a, bottom - high, wide, high);
      });
    }
    function times(c, p) {
      var most = Math.max(2, (p.right - p.left) / 90), i = 0, second, x;
      while (i < STEPS.length - 1 && (to - from) / STEPS[i] > most) i++;
      c.textAlign = "center";
      for (second = Math.ceil(from / STEPS[i]) * STEPS[i]; second <= to; second += STEPS[i]) {
        x = p.left + (second - from) / (to - from) * (p.right - p.left);
        c.fillStyle = GRID;
        c.fillRect(x, 22, 1, p.height - 46);
        c.fillStyle = QUIET;
        c.fillText(clock(second, STEPS[i]), x, p.height - 6);
      }
    }
    function panel(c, p, k, top, bottom, low, high, colour, band, title, marks) {
      function y(value) { return bottom - (value - low) / (high - low) * (bottom - top); }
      var step = nice(high - low, (bottom - top) / 34), value, x, previous = null, pair;
      c.fillStyle = QUIET;
      c.textAlign = "left";
      c.fillText(title, p.left, top - 6);
      c.textAlign = "right";
      for (value = Math.ceil(low / step) * step; value <= high; value += step) {
        c.fillStyle = GRID;
        c.fillRect(p.left, y(value), p.right - p.left, 1);
        c.fillStyle = QUIET;
        c.fillText(String(value), p.left - 5, y(value) + 4);
      }
      c.textAlign = "left";
      marks.forEach(function (one) {
        if (+one[1] < low || +one[1] > high) return;
        c.strokeStyle = c.fillStyle = one[0] === "set" ? INK : "#c8400a";
        c.setLineDash(one[0] === "set" ? [6, 3] : one[0] === "high" ? [2, 2] : [6, 2, 2, 2]);
        c.beginPath(); c.moveTo(p.left, y(+one[1])); c.lineTo(p.right, y(+one[1])); c.stroke();
        c.fillText(one.join(" "), p.right + 5, y(+one[1]) + 4);
      });
      c.setLineDash([]);
      var missing = [], columns = Math.min(Math.floor(p.right - p.left), Math.ceil(index(to) - index(from))), wide = (p.right - p.left) / columns;
      var pairs = [];
      for (x = 0; x < columns; x++) {
        pair = ends(k, index(from + (to - from) * x / columns), index(from + (to - from) * (x + 1) / columns));
        pairs.push(pair);
        if (!pair) missing.push(x);
      }
      c.fillStyle = band;
      pairs.forEach(function (pair, x) { if (pair) c.fillRect(p.left + x * wide, y(pair[1]), wide + 0.4, y(pair[0]) - y(pair[1])); });
      c.strokeStyle = colour;
      [0, 1].forEach(function (side) {
        c.beginPath();
        previous = null;
        pairs.forEach(function (pair, x) {
          if (pair && previous === null) c.moveTo(p.left + x * wide, y(pair[side]));
          if (pair) c.lineTo(p.left + (x + 0.5) * wide, y(pair[side]));
          previous = pair;
        });
        c.lineWidth = 1.3;
        c.stroke();
      });
      c.lineWidth = 1;
      c.fillStyle = "rgba(141, 153, 166, .35)";
      missing.forEach(function (x) { c.fillRect(p.left + x * wide, top, wide + 0.5, bottom - top); });
    }
    window.addEventListener("resize", function () { if (canvas) draw(); });
  }
  Array.prototype.forEach.call(document.querySelectorAll("figure[data-zoom]"), install);
})();
