"use strict";
// Shows the messages of /events (jbclog/app/watch/feed.py). All text is set as text, never as HTML.
(() => {
  const SEVERITIES = ["info", "warning", "error", "critical"];
  const SILENT_MS = 5000; // without a message for so long nothing on the page is known any more
  const TRACE_S = 60, SPAN_C = 5, DRAW_MS = 400, HOUR_MS = 5000, RETRY_MS = 2000;
  const NONE = { seconds: [], temperature: [], power: [] };
  const find = (id) => document.getElementById(id);
  const tiles = new Map(); // by key: elements, trace, last message
  let last = null, heard = performance.now(), open = null, plot = null, drawn = 0, hour = null, asked = 0;

  const make = (name, parent, className) => {
    const one = document.createElement(name);
    if (className) one.className = className;
    parent.append(one);
    return one;
  };
  const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };

  function tileOf(key) {
    if (tiles.has(key)) return tiles.get(key);
    const box = make("article", find("ports"));
    const tile = { box, name: make("h2", box), condition: make("p", box, "condition"), now: make("p", box, "now") };
    tile.canvas = make("canvas", box, "line");
    tile.canvas.setAttribute("aria-hidden", "true");
    tile.facts = make("p", box, "facts");
    tile.row = make("p", box, "facts quiet");
    tile.wrong = make("p", box, "wrong");
    tile.button = make("button", box);
    tile.button.type = "button";
    tile.button.textContent = "Details";
    tile.button.addEventListener("click", () => show(key));
    tile.trace = { seconds: [], temperature: [], power: [] };
    tiles.set(key, tile);
    return tile;
  }

  function addPoints(trace, points) {
    if (points.whole) trace.seconds.length = trace.temperature.length = trace.power.length = 0;
    points.seconds.forEach((seconds, place) => {
      if (trace.seconds.length && seconds <= trace.seconds[trace.seconds.length - 1]) return; // it has this one
      trace.seconds.push(seconds);
      trace.temperature.push(points.temperature[place]);
      trace.power.push(points.power[place]);
    });
    const from = trace.seconds[trace.seconds.length - 1] - TRACE_S;
    const old = trace.seconds.findIndex((seconds) => seconds >= from);
    if (old > 0) for (const values of Object.values(trace)) values.splice(0, old);
  }

  function drawLine(tile) {
    const { canvas, trace } = tile, ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const pen = canvas.getContext("2d");
    pen.clearRect(0, 0, width, height);
    const known = trace.temperature.filter((value) => value !== null);
    if (!known.length) return;
    const low = Math.min(...known), high = Math.max(...known), middle = (low + high) / 2, span = Math.max(high - low, SPAN_C) * 1.1;
    const end = trace.seconds[trace.seconds.length - 1];
    pen.strokeStyle = getComputedStyle(canvas).getPropertyValue("--trace");
    pen.lineWidth = 1.5 * ratio;
    pen.beginPath();
    let isDown = false;
    trace.seconds.forEach((seconds, place) => {
      const value = trace.temperature[place];
      if (value === null) { isDown = false; return; }
      const x = (1 + (seconds - end) / TRACE_S) * width, y = height / 2 - (value - middle) / span * height;
      if (isDown) pen.lineTo(x, y); else pen.moveTo(x, y);
      isDown = true;
    });
    pen.stroke();
  }

  const facts = (port) => `set ${port.setpoint} · power ${port.power} · ${port.status}`;

  function showPort(port) {
    const tile = tileOf(port.key);
    tile.port = port;
    tile.box.dataset.condition = port.condition;
    put(tile.name, port.name);
    put(tile.condition, port.condition);
    put(tile.now, port.now);
    tile.now.classList.toggle("unknown", !port.known);
    put(tile.facts, facts(port));
    put(tile.row, `${port.row} · ${port.counts} · ${port.coverage}`);
    put(tile.wrong, port.wrong.join(" · "));
    tile.button.setAttribute("aria-label", `Details of ${port.name}`);
    addPoints(tile.trace, port.trace);
  }

  function showEvents() {
    const least = SEVERITIES.indexOf(find("severity").value), list = find("events");
    const shown = last.events.filter((event) => SEVERITIES.indexOf(event.severity) >= least);
    const isAtEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 30;
    const state = `${last.run} ${least} ${shown.length ? shown[shown.length - 1].seq : ""} ${shown.length}`;
    if (list.dataset.state === state) return;
    list.dataset.state = state;
    list.replaceChildren();
    for (const event of shown) make("li", list, event.severity).textContent = event.text;
    if (isAtEnd) list.scrollTop = list.scrollHeight;
  }

  function showQueue(queues) {
    const part = find("queue"), state = JSON.stringify(queues);
    if (part.dataset.state === state) return;
    part.dataset.state = state;
    part.hidden = !queues.length;
    part.replaceChildren();
    for (const queue of queues) {
      make("h2", part).textContent = queue.text;
      const body = make("tbody", make("table", part));
      for (const [name, condition, text] of queue.jobs) {
        const row = make("tr", body), head = make("th", row);
        head.scope = "row";
        head.textContent = name;
        make("td", row).textContent = condition;
        make("td", row).textContent = text;
      }
    }
  }

  function take(message) {
    heard = performance.now();
    document.body.classList.remove("lost");
    if (message.trouble) { nothingKnown(message.trouble, "NOT READABLE", "not readable"); return; }
    if (message.whole) delete find("events").dataset.state;
    if (message.whole) for (const tile of tiles.values()) tile.trace.seconds.length = tile.trace.temperature.length = tile.trace.power.length = 0;
    if (last && last.run !== message.run) { hour = null; if (open) plot.whole(); find("span").value = "minute"; }
    last = message;
    put(find("run"), message.heading);
    put(find("status"), message.status || "");
    put(find("zone"), message.zone ? `times in ${message.zone}` : "");
    document.body.dataset.worst = message.worst || "stale";
    document.title = `${message.title} – jbclog watch`;
    const keys = new Set(message.ports.map((port) => port.key));
    for (const [key, tile] of tiles) if (!keys.has(key)) { tile.box.remove(); tiles.delete(key); }
    message.ports.forEach(showPort);
    if (performance.now() - drawn > DRAW_MS) { drawn = performance.now(); tiles.forEach(drawLine); }
    if (message.events) showEvents();
    showQueue(message.queue || []);
    if (open) refresh();
  }

  function nothingKnown(text, title, why) {
    document.body.classList.add("lost");
    document.body.dataset.worst = "stale";
    put(find("status"), text);
    put(find("detail-state"), text); // it may cover the line at the top
    document.title = `${title} – jbclog watch`;
    for (const tile of tiles.values()) {
      const { port } = tile;
      tile.box.dataset.condition = "stale";
      put(tile.condition, "stale");
      tile.now.classList.add("unknown");
      if (!port) continue;
      put(tile.now, port.known ? `unknown (${why}; last ${port.now})` : port.now);
      put(tile.facts, `last: ${facts(port)}`);
      put(tile.row, `${why} · ${port.counts} · ${port.coverage}`);
    }
  }

  // -- runs of the folder ----------------------------------------------------------------------------------------------

  async function showRuns() {
    const list = find("runs");
    if (!find("runs-part").open) return;
    const answer = await fetch("runs");
    list.replaceChildren();
    if (!answer.ok) { make("li", list).textContent = await answer.text(); return; }
    for (const run of await answer.json()) {
      const item = make("li", list);
      if (run.report) {
        const link = make("a", item);
        link.href = `runs/${encodeURIComponent(run.run)}`;
        link.textContent = run.run;
      } else item.append(run.run);
      item.append(` · ${run.text}${run.report ? "" : " · no report"}`);
    }
    if (!list.children.length) make("li", list).textContent = "no run";
  }
  find("runs-part").addEventListener("toggle", showRuns);

  // -- a port in detail --------------------------------------------------------------------------------------------------

  const trace = () => (tiles.get(open) || { trace: NONE }).trace;
  const now = () => trace().seconds[trace().seconds.length - 1] || 0;
  function data() { // the hour's means end where the minute begins: none hides what is now
    const { seconds, temperature, power } = trace(), old = hour || NONE;
    const from = seconds.length ? seconds[0] : Infinity, found = old.seconds.findIndex((one) => one >= from);
    const count = found < 0 ? old.seconds.length : found;
    return [[old.seconds, seconds], [old.temperature, temperature], [old.power, power]].map(([one, more]) => one.slice(0, count).concat(more));
  }

  async function showSpan() { // the hour is asked for while somebody looks at it
    const key = open, isHour = find("span").value === "hour";
    asked = performance.now();
    let found = null;
    if (isHour) {
      const answer = await fetch(`hour?port=${encodeURIComponent(key)}`).catch(() => null);
      if (!answer || !answer.ok) return;
      found = await answer.json();
    }
    if (open !== key || (find("span").value === "hour") !== isHour) return;
    const isOther = (hour === null) !== (found === null);
    hour = found;
    if (isOther) plot.whole();
    refresh();
  }
  find("span").addEventListener("change", showSpan);

  function show(key) {
    open = key;
    hour = null;
    find("span").value = "minute";
    find("detail").showModal();
    plot = tracePlot(data, now);
    refresh();
  }

  function showTable(part, rows) {
    const state = JSON.stringify(rows);
    if (part.dataset.state === state) return;
    part.dataset.state = state;
    part.replaceChildren();
    if (!rows.length) { make("p", part).textContent = "none read"; return; }
    const table = make("table", part), head = make("tr", make("thead", table)), body = make("tbody", table);
    for (const name of rows[0]) { const cell = make("th", head); cell.scope = "col"; cell.textContent = name; }
    for (const row of rows.slice(1)) {
      const line = make("tr", body);
      row.forEach((text, place) => {
        const cell = make(place ? "td" : "th", line, text ? "" : "empty");
        if (!place) cell.scope = "row";
        if (rows[0][place] === "port") cell.dataset.head = "port ";
        cell.textContent = text;
      });
    }
  }

  function refresh() {
    const tile = tiles.get(open);
    if (!tile || !tile.port) { find("detail").close(); return; }
    const { port } = tile, station = last.stations.find((one) => one.name === port.station) || { settings: [], counters: [] };
    put(find("detail-name"), port.name);
    put(find("detail-state"), [port.condition.toUpperCase(), port.now, `set ${port.setpoint}`, `power ${port.power}`, port.joints_why || port.joints, ...port.wrong].join(" · "));
    showTable(find("settings"), station.settings);
    showTable(find("counters"), station.counters);
    if (hour !== null && performance.now() - asked > HOUR_MS) showSpan();
    plot.refresh();
  }

  find("detail").addEventListener("close", () => {
    if (plot) plot.destroy();
    const tile = tiles.get(open);
    plot = open = hour = null;
    if (tile) tile.button.focus();
  });
  find("close").addEventListener("click", () => find("detail").close());
  find("severity").addEventListener("change", () => { if (last) showEvents(); });
  window.addEventListener("resize", () => {
    tiles.forEach(drawLine);
    if (plot) plot.resize();
  });

  function connect() {
    const source = new EventSource("events");
    source.onmessage = (event) => take(JSON.parse(event.data));
    source.onerror = () => { // after an answer that is no stream, such as a proxy's 502, the browser itself does not try again
      if (source.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    };
  }
  connect();
  setInterval(() => { if (performance.now() - heard > SILENT_MS) nothingKnown("NO CONNECTION to jbclog watch: what is shown is old.", "NO CONNECTION", "no connection"); }, 1000);
})();
