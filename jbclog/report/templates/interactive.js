"use strict";
// The interactive view of a port's figure: temperature, power and lanes on one time axis, drawn by uPlot from the data in the page.
// Nothing is loaded and nothing is sent. Text reaches the page through textContent and the canvas only.
(() => {
  const INK = "#1c2733", QUIET = "#5d6b7a", GRID = "#e3e8ee", WHITE = "#ffffff", ALARM = "#c8400a", NO_DATA = "#8d99a6";
  const SIGNALS = {
    temperature_c: { name: "temperature", unit: "°C", line: "#0b4f8a", band: "#9cc3e6", panel: 0 },
    external_c: { name: "temperature of the work", unit: "°C", line: "#00785a", band: "#9fd6c6", panel: 0 },
    power_permille: { name: "power", unit: "‰", line: "#7a4d00", band: "#efc98a", panel: 1 },
  };
  const MARKS = { alarm: ALARM, doubtful: "#b37700", error: "#8a3a77" };
  const TINTS = { alarm: "#f6ded3", doubtful: "#f3e8d3", error: "#ece0e9" };
  const SHADES = {
    working: "#3d5166", on: "#3d5166", suction: "#3d5166", preparing: "#3d5166", "out of range": "#3d5166", stand: "#94a5b5",
    sleep: "#c3ced8", cooling: "#c3ced8", ready: "#c3ced8", "in range": "#c3ced8", ok: "#c3ced8", hibernation: "#e1e7ec", off: "#f1f4f6",
  };
  const JOINTS = { back: ["#0b4f8a", 4], "cut off": [NO_DATA, 4], late: [ALARM, 7] };
  const JOINT_WORDS = { back: "joint", "cut off": "joint, recovery not seen to its end", late: "joint, tip not back before the next" };
  const STEPS = [
    0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400,
    172800, 604800,
  ];
  const LONG_GAP_S = 1, EVENT_S = 30, LEFT = 62, RIGHT = 70, FONT = "12px system-ui, sans-serif";

  // ---- The data: a JSON header, then zigzag varints; jbclog/report/zoom.py writes them.

  function decoded(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    const length = new DataView(bytes.buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    let at = 4 + length;
    const next = () => {
      let value = 0, weight = 1, byte;
      do {
        byte = bytes[at++];
        value += (byte & 127) * weight;
        weight *= 128;
      } while (byte > 127);
      return value % 2 ? -(value + 1) / 2 : value / 2;
    };
    const runs = (count) => {
      const values = new Float64Array(count);
      for (let run = next(), i = 0; run > 0; run--) {
        const value = next();
        for (let many = next(); many > 0; many--) values[i++] = value;
      }
      return values;
    };
    const known = (count) => {
      const values = runs(count);
      for (let i = 0, last = 0; i < count; i++) values[i] = values[i] ? (last += next()) : NaN;
      return values;
    };
    const port = Object.assign(head, { t: runs(head.rows), values: {}, bands: {}, spans: {}, counts: {} });
    for (let i = 0, place = 0; i < port.rows; i++) {
      place += port.t[i];
      port.t[i] = place * port.step;
    }
    for (const name of port.columns) port.values[name] = known(port.rows);
    port.why = runs(port.rows);
    for (const name of port.stretches ? port.columns : []) {
      const low = known(port.stretches), high = low.map((value) => (isNaN(value) ? NaN : value + next()));
      port.bands[name] = { low, high };
    }
    const spans = (count, third) => {
      const found = [];
      for (let start = 0; found.length < count;) {
        start += next();
        const length = next();
        found.push([start / 1000, (start + length) / 1000, third(next())]);
      }
      return found;
    };
    for (const [name, count] of port.lanes) port.spans[name] = spans(count, (code) => port.words[code]);
    port.held = spans(port.settings, (celsius) => celsius);
    if (!port.stretches) port.parts = [[0, port.seconds]];
    return port;
  }

  // ---- What a window shows: every reading where they are few enough, else the least and greatest of each stretch.

  function firstFrom(values, wanted) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < wanted) low = middle + 1; else high = middle;
    }
    return low;
  }

  function viewOf(port, from, to, columns) {
    const view = { x: [], row: [], span: [], each: 0, single: true, outside: false, data: {} };
    for (const name of port.columns) view.data[name] = { high: [], low: [], value: [] };
    const push = (x, row, span, cell) => {
      view.x.push(x);
      view.row.push(row);
      view.span.push(span);
      for (const name of port.columns) {
        const [high, low, value] = cell ? cell(name) : [null, null, null], one = view.data[name];
        one.high.push(high);
        one.low.push(low);
        one.value.push(value);
      }
    };
    const inside = (a, b) => [Math.max(0, firstFrom(port.t, a) - 1), Math.min(port.rows, firstFrom(port.t, b) + 1)];
    const [begin, end] = inside(from, to);
    view.single = (port.stretches ? (to - from) / port.period : end - begin) <= 2 * columns;
    const bucket = (to - from) / columns;

    function rows(a, b) {
      for (let i = a; i < b; i++) {
        if (i > a && port.t[i] - port.t[i - 1] > port.joined) push(port.t[i - 1] + port.period, -1, null);
        push(port.t[i], i, null, (name) => [null, null, isNaN(port.values[name][i]) ? null : port.values[name][i]]);
      }
    }
    function buckets(a, b) {
      for (let i = a, last = -1; i < b;) {
        const number = Math.floor((port.t[i] - from) / bucket), start = i;
        while (i < b && Math.floor((port.t[i] - from) / bucket) === number) i++;
        if (last >= 0 && port.t[start] - port.t[last] > Math.max(port.joined, bucket)) push((port.t[start] + port.t[last]) / 2, -1, null);
        last = i - 1;
        push((port.t[start] + port.t[last]) / 2, -1, [port.t[start], port.t[last] + port.period], (name) => extremes(port.values[name], port.values[name], start, i));
      }
      view.each = Math.max(view.each, bucket);
    }
    function extremes(lows, highs, a, b) {
      let low = Infinity, high = -Infinity;
      for (let i = a; i < b; i++) {
        if (lows[i] < low) low = lows[i];
        if (highs[i] > high) high = highs[i];
      }
      return low <= high ? [high, low, null] : [null, null, null];
    }
    function band(a, b) {
      const width = port.seconds / port.stretches, many = Math.max(1, Math.ceil(bucket / width));
      const first = Math.max(0, Math.floor(a / width + 1e-9)), last = Math.min(port.stretches, Math.ceil(b / width - 1e-9));
      for (let i = first - first % many; i < last; i += many) {
        const start = Math.max(i, first), stop = Math.min(i + many, last), span = [Math.max(start * width, a), Math.min(stop * width, b)];
        const cell = (name) => extremes(port.bands[name].low, port.bands[name].high, start, stop), size = span[1] - span[0];
        if (size > 3 * bucket) { // wide enough to be seen: over its full width, not joined to its neighbours by slopes
          push(span[0] + 1e-3 * size, -1, span, cell);
          push(span[1] - 1e-3 * size, -1, span, cell);
        } else if (size > 0) push((span[0] + span[1]) / 2, -1, span, cell);
      }
      view.each = Math.max(view.each, many * width);
      view.outside = true;
    }

    let at = from;
    for (const [a, b] of port.parts) {
      if (b <= from || a >= to) continue;
      if (port.stretches && a > at) band(at, a);
      const [first, stop] = inside(Math.max(a, from), Math.min(b, to));
      const start = port.t[first] < a - 1e-6 ? first + 1 : first, limit = stop > 0 && port.t[stop - 1] > b - 1e-6 ? stop - 1 : stop;
      if (view.single) rows(start, limit); else buckets(start, limit);
      at = Math.max(at, b);
    }
    if (port.stretches && at < to) band(at, to);
    return view;
  }

  // ---- Words.

  function clock(seconds, step) {
    const text = new Date(Math.round(seconds * 1000)).toISOString();
    return step >= 86400 ? text.slice(5, 10) : step >= 60 ? text.slice(11, 16) : step >= 1 ? text.slice(11, 19) : text.slice(11, step < 0.1 ? 22 : 21);
  }
  function duration(seconds) {
    if (seconds < 1) return `${Math.round(1000 * seconds)} ms`;
    if (seconds < 120) return `${Math.round(10 * seconds) / 10} s`;
    return seconds < 7200 ? `${Math.round(seconds / 6) / 10} min` : `${Math.round(seconds / 360) / 10} h`;
  }
  const plain = (word) => word.replace(/_/g, " ");
  function reason(port, name, row) {
    const text = port.words[port.why[row]] || "";
    const own = text.split(";").map((one) => one.split("=")).find((one) => one[0] === name);
    return own ? plain(own[1] || "") : "not due";
  }
  const during = (spans, second) => (spans || []).filter(([a, b]) => a <= second && second < Math.max(b, a + 1e-3));

  function describe(port, view, nearest, second) {
    const holds = (i) => view.span[i] && view.span[i][0] - 1e-6 <= second && second <= view.span[i][1] + 1e-6;
    const index = view.row[nearest] >= 0 ? nearest : [nearest, nearest - 1, nearest + 1].find(holds) ?? nearest;
    const row = view.row[index], span = view.span[index], missing = during(port.spans["no data"], second)[0], words = [];
    const isRow = row >= 0 && Math.abs(port.t[row] - second) <= port.joined;
    const isSpan = holds(index);
    const when = isRow ? port.t[row] : second;
    for (const name of port.columns) {
      const { name: what, unit } = SIGNALS[name], one = view.data[name];
      let text = `not read: ${missing ? plain(missing[2]) : "no row"}`;
      if (isRow) text = one.value[index] === null ? `not read: ${reason(port, name, row)}` : `${one.value[index]} ${unit}`;
      else if (isSpan && one.low[index] !== null) {
        text = one.low[index] === one.high[index] ? `${one.low[index]} ${unit}` : `${one.low[index]} to ${one.high[index]} ${unit}`;
      }
      words.push(`${what} ${text}`);
    }
    const about = [];
    const set = during(port.held, when)[0];
    if (set) about.push(`set ${set[2]} °C`);
    for (const [name] of port.lanes) {
      for (const [a, b, word] of during(port.spans[name], when).slice(0, 3)) {
        if (name === "joints") about.push(`${JOINT_WORDS[word] || "joint"}, ${duration(b - a)}`);
        else if (name === "no data") about.push(`no data: ${plain(word)}, ${duration(b - a)}`);
        else about.push(name === "status" || name === word ? word : `${name} ${word}`.trim());
      }
    }
    const time = isSpan && !isRow ? `${clock(port.start + span[0], 0.1)} to ${clock(port.start + span[1], 0.1)}` : clock(port.start + when, Math.min(port.step, 0.1));
    return `${time} UTC: ${[...words, ...about].join(" · ")}`;
  }

  // ---- Drawing what uPlot does not know: shades, steps, lanes and labels.

  function hatching(ctx, ratio) {
    const tile = document.createElement("canvas"), size = Math.round(7 * ratio);
    tile.width = tile.height = size;
    const c = tile.getContext("2d");
    c.fillStyle = "#f4f6f8";
    c.fillRect(0, 0, size, size);
    c.strokeStyle = NO_DATA;
    c.lineWidth = ratio * 0.8;
    c.beginPath();
    for (const shift of [-size, 0, size]) {
      c.moveTo(shift, size);
      c.lineTo(shift + size, 0);
    }
    c.stroke();
    return ctx.createPattern(tile, "repeat");
  }

  function within(u, draw) {
    const { left, top, width, height } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, height);
    u.ctx.clip();
    draw(u.ctx, u.bbox, uPlot.pxRatio);
    u.ctx.restore();
  }

  function place(u, a, b, least) {
    const x = u.valToPos(a, "x", true), wide = u.valToPos(b, "x", true) - x, lacking = Math.max(0, least - wide);
    return [x - lacking / 2, wide + lacking];
  }
  const seen = (u, [a, b]) => b >= u.scales.x.min && a <= u.scales.x.max;

  function ground(port, u, joints) {
    within(u, (c, box, ratio) => {
      for (const one of joints ? port.spans.joints || [] : []) {
        const [x, wide] = place(u, one[0], one[1], 0);
        if (!seen(u, one) || wide < 4 * ratio) continue;
        c.fillStyle = "#eaf1f8";
        c.fillRect(x, box.top, wide, box.height);
      }
      for (const name of Object.keys(TINTS)) {
        c.fillStyle = TINTS[name];
        for (const one of (port.spans[name] || []).filter((span) => seen(u, span))) {
          const [x, wide] = place(u, one[0], one[1], 2 * ratio);
          c.fillRect(x, box.top, wide, box.height);
        }
      }
    });
  }

  // Over the curve: a band of wide stretches would else hide a gap within one of them.
  function gaps(port, u) {
    within(u, (c, box, ratio) => {
      c.fillStyle = hatching(c, ratio);
      for (const one of (port.spans["no data"] || []).filter((span) => seen(u, span))) {
        const [x, wide] = place(u, one[0], one[1], 0);
        if (wide >= ratio || one[1] - one[0] >= LONG_GAP_S) c.fillRect(x, box.top, Math.max(wide, ratio), box.height);
      }
    });
  }

  function bars(port, u) {
    within(u, (c, box, ratio) => {
      for (const word of Object.keys(JOINTS)) {
        const [colour, high] = JOINTS[word];
        c.fillStyle = colour;
        for (const one of (port.spans.joints || []).filter((span) => span[2] === word && seen(u, span))) {
          const [x, wide] = place(u, one[0], one[1], 1.5 * ratio);
          c.fillRect(x, box.top + box.height - high * ratio, wide, high * ratio);
        }
      }
    });
  }

  function alone(u, view, names) {
    within(u, (c, box, ratio) => {
      const x = (i) => u.valToPos(view.x[i], "x", true), y = (value) => u.valToPos(value, "y", true);
      for (const name of names) {
        const { high, low, value } = view.data[name];
        c.fillStyle = SIGNALS[name].line;
        const single = (values, i) => values[i] !== null && (values[i - 1] ?? null) === null && (values[i + 1] ?? null) === null;
        for (let i = 0; i < view.x.length; i++) {
          if (single(value, i)) {
            c.beginPath();
            c.arc(x(i), y(value[i]), 2 * ratio, 0, 2 * Math.PI);
            c.fill();
          } else if (single(low, i)) {
            c.fillRect(x(i) - ratio / 2, y(high[i]) - ratio / 2, ratio, y(low[i]) - y(high[i]) + ratio);
          }
        }
      }
    });
  }

  function steps(port, u, from, to) {
    const labels = [];
    within(u, (c, box, ratio) => {
      const x = (second) => u.valToPos(second, "x", true), y = (celsius) => u.valToPos(celsius, "y", true);
      const line = (a, b, celsius, colour, dash, wide) => {
        c.strokeStyle = colour;
        c.lineWidth = wide * ratio;
        c.setLineDash(dash.map((one) => one * ratio));
        c.beginPath();
        c.moveTo(x(a), y(celsius));
        c.lineTo(x(b), y(celsius));
        c.stroke();
      };
      for (const [a, b, celsius] of port.held.filter((span) => seen(u, span))) {
        line(a, b, celsius, INK, [5, 2.5], 1);
        c.fillStyle = INK;
        for (const end of [a, b]) c.fillRect(x(end) - ratio, y(celsius) - ratio, 2 * ratio, 2 * ratio);
      }
      for (const [side, list] of port.limits) {
        list.forEach(([second, celsius], i) => {
          const until = i + 1 < list.length ? list[i + 1][0] : port.seconds;
          if (celsius !== null) line(second, until, celsius, ALARM, side === "high" ? [2, 2] : [6, 2.5, 1.5, 2.5], 1.5);
        });
      }
    });
    const set = port.held.filter(([a]) => a <= to).pop();
    if (set) labels.push([set[2], `set ${set[2]}`, INK]);
    for (const [side, list] of port.limits) {
      const last = list.filter(([second]) => second <= to).pop();
      if (last && last[1] !== null) labels.push([last[1], `${side} ${last[1]}`, ALARM]);
    }
    return labels;
  }

  function labelled(u, labels) {
    const c = u.ctx, ratio = uPlot.pxRatio, { left, top, width, height } = u.bbox, { min, max } = u.scales.y;
    const placed = labels.map(([value, text, colour]) => {
      const arrow = value > max ? " ↑" : value < min ? " ↓" : "";
      return [u.valToPos(Math.min(Math.max(value, min), max), "y", true), text + arrow, colour];
    }).sort((one, other) => one[0] - other[0]);
    c.save();
    c.font = `${12 * ratio}px system-ui, sans-serif`;
    c.textAlign = "left";
    c.textBaseline = "middle";
    let last = top - 7 * ratio;
    for (const [y, text, colour] of placed) {
      last = Math.max(Math.min(y, top + height - 6 * ratio), last + 13 * ratio);
      c.fillStyle = colour;
      c.fillText(text, left + width + 5 * ratio, last);
    }
    c.restore();
  }

  function headed(u, text) {
    const c = u.ctx, ratio = uPlot.pxRatio, { left, top, width, height } = u.bbox;
    c.save();
    c.font = `600 ${12 * ratio}px system-ui, sans-serif`;
    c.textAlign = "left";
    c.textBaseline = "alphabetic";
    c.fillStyle = INK;
    c.fillText(text, left, top - 5 * ratio);
    c.strokeStyle = NO_DATA;
    c.lineWidth = ratio;
    c.strokeRect(left, top, width, height);
    c.restore();
  }

  function lanes(port, u, names) {
    within(u, (c, box, ratio) => {
      const high = box.height / names.length;
      c.font = `${11 * ratio}px system-ui, sans-serif`;
      c.textAlign = "center";
      c.textBaseline = "middle";
      names.forEach((name, row) => {
        const top = box.top + (row + 0.12) * high, tall = 0.76 * high, isGap = name === "no data";
        const pattern = isGap ? hatching(c, ratio) : null;
        for (const one of port.spans[name].filter((span) => seen(u, span))) {
          const [x, wide] = place(u, one[0], one[1], (name in MARKS || (isGap && one[1] - one[0] >= LONG_GAP_S) ? 2 : 0.5) * ratio), grave = /^(shortage|clogged|both)$/.test(one[2]);
          const face = MARKS[name] || (grave ? MARKS.error : SHADES[one[2]] || "#e1e7ec");
          c.fillStyle = !isGap ? face : wide > 8 * ratio ? pattern : NO_DATA;
          c.fillRect(x, top, wide, tall);
          const a = Math.max(x, box.left), b = Math.min(x + wide, box.left + box.width);
          const text = [`${plain(one[2])} ${duration(one[1] - one[0])}`, plain(one[2])].slice(isGap ? 0 : 1)
            .find((word) => word.trim() && c.measureText(word).width + 8 * ratio <= b - a);
          if (!text) continue;
          const middle = (a + b) / 2, half = c.measureText(text).width / 2 + 2 * ratio;
          c.fillStyle = WHITE;
          if (isGap) c.fillRect(middle - half, top, 2 * half, tall);
          c.fillStyle = !isGap && (name in MARKS || grave || SHADES[one[2]] === "#3d5166") ? WHITE : INK;
          c.fillText(text, middle, top + tall / 2);
        }
      });
    });
  }

  // ---- The view of one figure.

  function element(name, className, parent, text) {
    const made = document.createElement(name);
    made.className = className;
    if (text) made.textContent = text;
    parent.appendChild(made);
    return made;
  }
  function button(parent, text, label, act) {
    const made = element("button", "", parent, text);
    made.type = "button";
    if (label) made.setAttribute("aria-label", label);
    made.addEventListener("click", act);
    return made;
  }

  function opened(figure, number) {
    const port = decoded(figure.dataset.zoom), what = figure.dataset.what, end = port.seconds;
    const box = element("div", "zoom", figure), bar = element("div", "zoom-bar", box);
    const value = element("output", "zoom-value", box), host = element("div", "zoom-panels", box);
    const shown = element("p", "zoom-window", box), help = element("p", "zoom-help", box);
    const names = port.lanes.filter(([name, count]) => name !== "joints" && (count || name === "status")).map(([name]) => name);
    const gapsToSee = (port.spans["no data"] || []).filter(([a, b]) => b - a >= LONG_GAP_S)
      .map(([a, b, word]) => [Math.min(a + port.period, (a + b) / 2), b, word]);  // a gap starts at a reading
    const events = [...Object.keys(MARKS).flatMap((name) => port.spans[name] || []), ...gapsToSee]
      .sort((one, other) => one[0] - other[0]);
    const least = Math.min(end, Math.max(0.5, 8 * port.period));
    let from = 0, to = end, view = null, cursor = null, asked = 0, panels = [];

    host.tabIndex = 0;
    host.setAttribute("role", "application");
    host.setAttribute("aria-roledescription", "chart");
    host.setAttribute("aria-label", `${what} temperature, power and events over time. Arrow keys move the cursor, plus and minus zoom.`);

    function range(key) {
      const columns = port.columns.filter((name) => SIGNALS[name].panel === key);
      let low = Infinity, high = -Infinity;
      for (const name of columns) {
        for (const kind of ["low", "high", "value"]) {
          view.data[name][kind].forEach((one, i) => {
            if (one !== null && view.x[i] >= from - port.joined && view.x[i] <= to + port.joined) {
              low = Math.min(low, one);
              high = Math.max(high, one);
            }
          });
        }
      }
      if (key === 1) return [0, Math.max(100, 1.08 * (low <= high ? high : 1000))];
      for (const [a, b, celsius] of port.held) {
        if (b >= from && a <= to) {
          low = Math.min(low, celsius);
          high = Math.max(high, celsius);
        }
      }
      if (low > high) return [0, 400];
      const air = Math.max(4, 0.1 * (high - low));
      return [low - air, high + air];
    }

    function axes(key, last) {
      const base = { stroke: QUIET, font: FONT, grid: { stroke: GRID, width: 1 }, ticks: { show: false } };
      const x = {
        ...base, incrs: STEPS, space: 76, size: last ? 26 : 7,
        splits: (u, axis, min, max, step) => {
          const marks = [];
          if (!step) return marks;
          for (let n = Math.ceil((port.start + min) / step); n * step - port.start <= max; n++) marks.push(n * step - port.start);
          return marks;
        },
        values: (u, splits, axis, space, step) => splits.map((one) => (last ? clock(port.start + one, step) : "")),
      };
      const y = { ...base, size: LEFT, space: key === 1 ? 22 : 30, values: (u, splits) => splits.map(String) };
      if (!last) return [x, y];
      return [x, { ...y, grid: { show: false }, splits: () => names.map((_, i) => names.length - i - 0.5), values: () => names }];
    }

    function seriesOf(name) {
      const { line, band } = SIGNALS[name], bare = { stroke: line, width: 0.7, points: { show: false } };
      const crowded = (u, i, first, last) => u.bbox.width / Math.max(1, last - first) > 5 * uPlot.pxRatio;
      const fill = name === "power_permille" ? `${band}66` : undefined;
      return [bare, bare, { stroke: line, width: 1.3, fill, points: { show: crowded, size: 4.5, stroke: line, fill: line } }];
    }

    function panel(key) {
      const last = key === 2, columns = port.columns.filter((name) => SIGNALS[name].panel === key);
      const title = [`${what} temperature in °C${columns.length > 1 ? ", and that of the work" : ""}`, "Power in ‰", ""][key];
      const draw = (u) => {
        if (last) lanes(port, u, names);
        else {
          alone(u, view, columns);
          gaps(port, u);
          if (key === 0) bars(port, u);
          labelled(u, key === 0 ? [...steps(port, u, from, to), ...work()] : []);
        }
        headed(u, title);
      };
      const options = {
        width: host.clientWidth, height: height(key), padding: [last ? 4 : 19, RIGHT, 0, 0], legend: { show: false },
        scales: { x: { time: false, min: from, max: to }, y: { range: () => (last ? [0, names.length] : range(key)) } },
        series: [{}, ...(last ? [{}] : columns.flatMap(seriesOf))],
        bands: columns.map((name, i) => ({ series: [3 * i + 1, 3 * i + 2], fill: SIGNALS[name].band })),
        axes: axes(key, last),
        cursor: {
          y: false, points: { size: (u, i) => (i % 3 === 0 && !last ? 8 : 0) },
          drag: { x: true, y: false, setScale: false, dist: 5 },
          sync: { key: `port ${number}`, scales: ["x", null], filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
          bind: { dblclick: () => () => { show(0, end); return null; } },
        },
        hooks: {
          drawClear: [(u) => !last && ground(port, u, key === 0)],
          draw: [draw],
          setSelect: [(u) => selected(u)],
          setCursor: key === 0 ? [(u) => pointed(u)] : [],
        },
      };
      return new uPlot(options, dataOf(key), host);
    }
    function height(key) {
      const small = host.clientWidth < 560;
      return [small ? 230 : 270, small ? 120 : 130, 34 + 17 * names.length][key];
    }
    function dataOf(key) {
      const columns = port.columns.filter((name) => SIGNALS[name].panel === key);
      if (key === 2) return [view.x, view.x.map(() => null)];
      return [view.x, ...columns.flatMap((name) => [view.data[name].high, view.data[name].low, view.data[name].value])];
    }
    function work() {
      const { high, low, value } = view.data.external_c || { value: [] }, last = view.x.findLastIndex((x, i) => x <= to && (value[i] ?? low?.[i] ?? null) !== null);
      return last < 0 || !high ? [] : [[value[last] ?? (low[last] + high[last]) / 2, "work", SIGNALS.external_c.line]];
    }
    function selected(u) {
      const { left, width } = u.select;
      if (width <= 0) return;
      const a = u.posToVal(left, "x"), b = u.posToVal(left + width, "x");
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      show(a, b);
    }
    function pointed(u) {
      if (u.cursor.left === null || u.cursor.left < 0 || u.cursor.idx === null) return;
      cursor = u.posToVal(u.cursor.left, "x");
      value.textContent = describe(port, view, u.cursor.idx, cursor);
    }

    function show(a, b, at) {
      const middle = (a + b) / 2, wide = Math.min(Math.max(b - a, least), end);
      from = Math.min(Math.max(middle - wide / 2, 0), end - wide);
      to = from + wide;
      cursor = at === undefined ? null : at;
      asked = asked || requestAnimationFrame(render);
    }
    function render() {
      asked = 0;
      view = viewOf(port, from, to, Math.max(100, Math.round((host.clientWidth - LEFT - RIGHT) * uPlot.pxRatio)));
      panels = panels.length ? panels : [0, 1, 2].map(panel);
      panels.forEach((u, key) => {
        u.setData(dataOf(key), false);
        u.setScale("x", { min: from, max: to });
      });
      const single = view.single && !view.outside, points = view.row.filter((row, i) => row >= 0 && view.x[i] >= from && view.x[i] <= to).length;
      shown.textContent = `${clock(port.start + from, 1)} to ${clock(port.start + to, 1)} UTC, ${duration(to - from)}: ` + (single
        ? "every reading."
        : `min–max of each ${duration(view.each)}${points ? ", every reading where they are in the page" : ""}.` +
          (view.outside ? " The page holds single readings only around alarms, errors and gaps; the record holds all." : "")) +
        port.left.map(([name, count]) => ` ${count} spans of ${name} are too many for this page and are not drawn.`).join("");
      box.dataset.window = `${from} ${to}`;
      box.dataset.points = String(points);
      point();
    }
    function point() {
      if (cursor === null) {
        panels[0].setCursor({ left: -10, top: -10 }, false, true);
        value.textContent = "Point at the chart, tap it or use the arrow keys to read values.";
        return;
      }
      Promise.resolve().then(() => panels[0].setCursor({ left: panels[0].valToPos(cursor, "x"), top: 10 }, true, true));
    }
    function zoomed(factor, about) {
      const fixed = about === undefined ? (cursor === null ? (from + to) / 2 : cursor) : about;
      show(fixed - (fixed - from) * factor, fixed + (to - fixed) * factor, cursor === null ? undefined : cursor);
    }
    const moved = (share) => show(from + share * (to - from), to + share * (to - from));
    function event(step) {
      const here = cursor === null ? (step > 0 ? from - 1e-3 : to) : cursor;
      const found = step > 0 ? events.find(([a]) => a > here + 1e-3) : events.filter(([a]) => a < here - 1e-3).pop();
      if (!found) {
        value.textContent = events.length ? `No ${step > 0 ? "later" : "earlier"} alarm, error or gap.` : "No alarm, error or gap of 1 s or more.";
        return;
      }
      const wide = Math.min(end, Math.max(EVENT_S, Math.min(to - from, 2 * EVENT_S), Math.min(3 * (found[1] - found[0]), 3600))), start = Math.max(0, found[0]);
      show(start - wide / 3, start + 2 * wide / 3, start);
    }
    function reading(step) {
      const inside = view.x.map((x, i) => [x, i]).filter(([x, i]) => x >= from && x <= to && (view.row[i] >= 0 || (view.span[i] && view.span[i] !== view.span[i - 1])));
      if (!inside.length) return;
      const now = cursor === null ? -1 : inside.reduce((best, [x], i) => (Math.abs(x - cursor) < Math.abs(inside[best][0] - cursor) ? i : best), 0);
      const next = now < 0 ? (step > 0 ? 0 : inside.length - 1) : now + step;
      if (next < 0 || next >= inside.length) {
        const share = step > 0 ? 0.5 : -0.5, edge = inside[step > 0 ? inside.length - 1 : 0][0];
        show(from + share * (to - from), to + share * (to - from), edge);
        return;
      }
      cursor = inside[next][0];
      point();
    }

    button(bar, "+", "Zoom in", () => zoomed(0.5));
    button(bar, "−", "Zoom out", () => zoomed(2));
    button(bar, "◂", "Earlier", () => moved(-0.5));
    button(bar, "▸", "Later", () => moved(0.5));
    button(bar, "◂ Event", "Previous alarm, error or gap", () => event(-1));
    button(bar, "Event ▸", "Next alarm, error or gap", () => event(1));
    button(bar, "Whole run", "", () => show(0, end));
    help.textContent = matchMedia("(pointer: coarse)").matches
      ? "Drag to move, pinch to zoom, tap to read values."
      : "Drag to zoom, double-click for the whole run. Keys: ← → read values, + − zoom, Page Up and Page Down move, N and P next and previous event, Home whole run.";

    const keys = {
      ArrowLeft: (fast) => reading(fast ? -10 : -1), ArrowRight: (fast) => reading(fast ? 10 : 1), "+": () => zoomed(0.5), "=": () => zoomed(0.5),
      "-": () => zoomed(2), PageUp: () => moved(-0.5), PageDown: () => moved(0.5), Home: () => show(0, end), n: () => event(1), p: () => event(-1),
    };
    host.addEventListener("keydown", (pressed) => {
      const act = pressed.ctrlKey || pressed.metaKey || pressed.altKey ? null : keys[pressed.key.length === 1 ? pressed.key.toLowerCase() : pressed.key];
      if (!act) return;
      pressed.preventDefault();
      act(pressed.shiftKey);
    });
    host.addEventListener("wheel", (turned) => {
      if (!turned.ctrlKey) return;
      turned.preventDefault();
      zoomed(turned.deltaY > 0 ? 1.25 : 0.8, second(turned.clientX));
    }, { passive: false });

    const fingers = new Map();
    const second = (clientX) => {
      const place = panels[0].over.getBoundingClientRect();
      return from + Math.min(Math.max((clientX - place.left) / place.width, 0), 1) * (to - from);
    };
    host.addEventListener("pointerdown", (touch) => {
      if (touch.pointerType === "touch") fingers.set(touch.pointerId, touch.clientX);
    });
    host.addEventListener("pointermove", (touch) => {
      if (!fingers.has(touch.pointerId)) return;
      const before = [...fingers.values()], wide = panels[0].over.clientWidth;
      fingers.set(touch.pointerId, touch.clientX);
      const after = [...fingers.values()];
      if (after.length === 1) {
        const by = (before[0] - after[0]) / wide * (to - from);
        if (by) show(from + by, to + by);
      } else if (after.length === 2) {
        const ratio = Math.abs(before[0] - before[1]) / Math.max(10, Math.abs(after[0] - after[1]));
        if (ratio > 0) zoomed(ratio, second((after[0] + after[1]) / 2));
      }
    });
    for (const over of ["pointerup", "pointercancel", "pointerleave"]) host.addEventListener(over, (touch) => fingers.delete(touch.pointerId));

    host.addEventListener("click", (tap) => {
      if (tap.pointerType !== "touch") return;
      cursor = second(tap.clientX);
      setTimeout(point, 0); // after uPlot, for which a finger that is lifted leaves the chart
    });

    function resized() {
      panels.forEach((u, key) => u.setSize({ width: host.clientWidth, height: height(key) }));
      show(from, to, cursor === null ? undefined : cursor);
    }
    window.addEventListener("resize", resized);
    show(0, end);
    return () => {
      window.removeEventListener("resize", resized);
      cancelAnimationFrame(asked);
      panels.forEach((u) => u.destroy());
      figure.removeChild(box);
    };
  }

  document.querySelectorAll("figure[data-zoom]").forEach((figure, number) => {
    let close = null;
    const bar = element("div", "zoom-bar", figure);
    const toggle = button(bar, "Zoom", "", () => {
      if (close) close();
      close = close ? null : opened(figure, number);
      figure.classList.toggle("open", close !== null);
      toggle.textContent = close ? "Close zoom" : "Zoom";
      toggle.setAttribute("aria-expanded", String(close !== null));
    });
    toggle.setAttribute("aria-expanded", "false");
  });
})();
