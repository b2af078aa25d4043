"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const tip = byId("tip");

  /* Look ---------------------------------------------------------------------------------- */

  const systemDark = matchMedia("(prefers-color-scheme: dark)");
  const themes = ["auto", "light", "dark"];
  let theme = "auto";

  function applyTheme() {
    const dark = theme === "dark" || (theme === "auto" && systemDark.matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    byId("theme").textContent = `Theme: ${theme}`;
  }
  const isDark = () => document.documentElement.dataset.theme === "dark";
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  /* A colour as it shows up on the present background. */
  function shade(hex) {
    if (!isDark()) return hex;
    const mixed = [1, 3, 5].map((k) => Math.round(parseInt(hex.slice(k, k + 2), 16) * 0.72 + 255 * 0.28));
    return `rgb(${mixed.join(",")})`;
  }

  const superscript = (text) => String(text).replace(/[-0-9]/g, (d) => (d === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[d]));
  const number = (value) => {
    if (value === null || value === undefined) return "∞";
    if (value === 0) return "0";
    if (Math.abs(value) < 1e-9) return "≈ 0"; // a solver's rounding
    if (Math.abs(value) >= 1e-4) return String(Number(value.toPrecision(3)));
    const [mantissa, exponent] = value.toExponential(1).split("e");
    return `${mantissa}·10${superscript(exponent)}`;
  };

  function showTip(lines, x, y) {
    tip.textContent = lines.join("\n");
    tip.hidden = false;
    const box = tip.getBoundingClientRect();
    tip.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - box.width - 6))}px`;
    tip.style.top = `${y + 18 + box.height > innerHeight ? y - box.height - 12 : y + 18}px`;
  }
  const hideTip = () => { tip.hidden = true; };

  /* A canvas of the size at which it is shown, cleared. */
  function prepare(canvas, height) {
    const width = canvas.clientWidth;
    if (height) canvas.style.height = `${height}px`;
    const ratio = devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.lineJoin = context.lineCap = "round";
    context.font = "12px system-ui, sans-serif";
    return { context, width, height: canvas.clientHeight };
  }

  /* Leaderboard --------------------------------------------------------------------------- */

  function setUpBoard() {
    const table = byId("board"), body = table.tBodies[0], rows = all("tr", body);
    const heads = all("thead th", table), sorter = byId("board-sort");
    const given = new Map(rows.map((row, k) => [row, k]));
    const keyOf = (row, column) => {
      const cell = row.cells[column];
      if (cell.dataset.key === undefined) return cell.textContent.trim().toLowerCase();
      return cell.dataset.key === "" ? NaN : Number(cell.dataset.key);
    };
    const compare = (a, b) => {
      if (typeof a === "string") return a.localeCompare(b);
      return a < b ? -1 : a > b ? 1 : 0;
    };
    function sort(column, direction) {
      heads.forEach((head, k) => {
        if (k === column) head.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
        else head.removeAttribute("aria-sort");
      });
      const sorted = [...rows].sort((a, b) => {
        const [p, q] = [keyOf(a, column), keyOf(b, column)];
        const missing = Number(Number.isNaN(p)) - Number(Number.isNaN(q));
        return missing || direction * compare(p, q) || given.get(a) - given.get(b);
      });
      body.append(...sorted);
      sorter.value = `${column} ${direction}`;
      rule();
    }
    function filter() {
      const words = byId("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
      const sensor = byId("board-sensor").value;
      let shown = 0;
      for (const row of rows) {
        const text = [0, 1, 2].map((k) => row.cells[k].textContent).join(" ").toLowerCase();
        row.hidden = !(words.every((word) => text.includes(word)) && (!sensor || row.dataset.sensor === sensor));
        shown += !row.hidden;
      }
      byId("board-count").textContent = shown === rows.length ? `${shown} rows` : `${shown} of ${rows.length} rows`;
      rule();
    }
    /* A line between scenarios and sensors where neighbouring rows belong together. */
    function rule() {
      const sorted = heads.some((head) => head.hasAttribute("aria-sort"));
      const visible = all("tr", body).filter((row) => !row.hidden);
      visible.forEach((row, k) => {
        const group = (r) => `${r.cells[0].textContent}\n${r.cells[1].textContent}`;
        row.classList.toggle("group", !sorted && k > 0 && group(row) !== group(visible[k - 1]));
      });
    }
    sorter.append(new Option("scenario, sensor, rank", ""));
    heads.forEach((head, column) => {
      if ("nosort" in head.dataset) return;
      const button = document.createElement("button"), name = head.textContent.trim();
      button.type = "button";
      button.textContent = name;
      head.replaceChildren(button);
      button.addEventListener("click", () => sort(column, head.getAttribute("aria-sort") === "ascending" ? -1 : 1));
      sorter.append(new Option(`${name} ↑`, `${column} 1`), new Option(`${name} ↓`, `${column} -1`));
    });
    sorter.addEventListener("change", () => {
      if (sorter.value) return sort(...sorter.value.split(" ").map(Number));
      heads.forEach((head) => head.removeAttribute("aria-sort"));
      body.append(...rows);
      return rule();
    });
    byId("board-all").addEventListener("click", (event) => {
      event.target.setAttribute("aria-pressed", String(table.classList.toggle("all")));
    });
    byId("filter").addEventListener("input", filter);
    byId("board-sensor").addEventListener("change", filter);
    filter();
  }

  /* What is shown ------------------------------------------------------------------------- */

  const state = { scenario: 0, sensors: new Set(), estimators: new Set(), sample: 0, sensor: "", time: 0 };
  const scenario = () => data.scenarios[state.scenario];
  const allSensors = data.sensors;
  const looks = new Map(data.estimators.map((e) => [e.name, e]));
  const visible = () => scenario().series.filter(
    (s) => state.estimators.has(s.estimator) && (state.sensors.has(s.sensor) || looks.get(s.estimator).floor));
  const seriesColour = (s) => (s.light ? s.colour : shade(s.colour));
  const DASHES = [[], [7, 4], [2, 4], [8, 3, 2, 3]];
  const metricOf = new Map(data.metrics.map((m) => [m.name, m]));
  const withUnit = (metric, value) => (typeof value === "string" ? value : value === null || value === undefined || !metric.unit ? number(value) : `${number(value)} ${metric.unit}`);

  function chips(holder, names, chosen, mark) {
    for (const name of names) {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      chosen.add(name);
      if (mark) {
        const swatch = document.createElement("i");
        swatch.className = "swatch";
        swatch.style.setProperty("--a", looks.get(name).colours[0]);
        swatch.style.setProperty("--b", looks.get(name).colours[1]);
        button.append(swatch);
      }
      button.append(name);
      button.addEventListener("click", () => {
        const on = !chosen.has(name);
        if (on) chosen.add(name); else chosen.delete(name);
        button.setAttribute("aria-pressed", String(on));
        redraw();
      });
      holder.append(button);
    }
  }

  function filterTables() {
    const error = byId("pair-error").value;
    for (const row of all("table.filtered tbody tr[data-scenario]")) {
      row.hidden = row.dataset.scenario !== scenario().name || !state.sensors.has(row.dataset.sensor)
        || (row.dataset.error !== undefined && row.dataset.error !== error);
    }
    for (const cell of all("[data-estimator]")) cell.hidden = !state.estimators.has(cell.dataset.estimator);
  }

  /* Errors over noise --------------------------------------------------------------------- */

  class Chart {
    constructor(canvas, metric) {
      Object.assign(this, { canvas, metric, column: metric.name, smallest: metric.negligible, at: null });
      canvas.addEventListener("pointermove", (event) => this.hover(event));
      canvas.addEventListener("pointerdown", (event) => this.hover(event));
      canvas.addEventListener("pointerleave", () => this.leave());
      canvas.addEventListener("blur", () => this.leave());
      canvas.addEventListener("keydown", (event) => this.key(event));
    }

    layout() {
      const shown = visible();
      const finite = shown.flatMap((s) => s.points
        ? s.points[this.column].filter((y, k) => typeof y === "number" && s.points.sigma[k] > 0) : []);
      const lines = shown.flatMap((s) => s.rolling[this.column].mid.filter((y) => y !== null));
      const values = [...finite, ...lines].filter((y) => y > this.smallest);
      const right = Math.max(1e-9, ...shown.flatMap((s) => s.points ? s.points.x : s.rolling[this.column].x));
      let low = this.smallest, high = this.smallest * 10;
      for (const y of values) { high = Math.max(high, y); }
      if (values.length) low = 10 ** Math.floor(Math.log10(values.reduce((a, b) => Math.min(a, b))));
      high = Math.max(high * 1.15, low * 10);
      /* The published definition of failure speaks of predictions. */
      const fails = (s, k) => s.points[this.column][k] === null
        || (this.metric.prediction && s.points.published[k] === 1);
      const failing = shown.filter((s) => s.points && s.points.x.some((_, k) => fails(s, k)));
      const box = { left: 50, right: this.width - 10, top: 12 + 11 * failing.length, bottom: this.height - 26 };
      this.x = (x) => box.left + 6 + (x / right) * (box.right - box.left - 12);
      this.y = (y) => box.bottom - (Math.log10(Math.max(y, low) / low) / Math.log10(high / low)) * (box.bottom - box.top);
      Object.assign(this, { shown, low, high, right, failing, box });
      this.marks = [];
      shown.forEach((s) => {
        if (!s.points) return;
        s.points.x.forEach((x, k) => {
          const y = s.points[this.column][k];
          if (typeof y === "number") this.marks.push({ s, k, px: this.x(x), py: this.y(y), failed: false });
          if (fails(s, k)) this.marks.push({ s, k, px: this.x(x), py: 8 + 11 * failing.indexOf(s), failed: true });
        });
      });
    }

    draw() {
      Object.assign(this, prepare(this.canvas));
      this.layout();
      const { context: c, box } = this;
      this.axes();
      for (const m of this.marks) if (!m.failed) this.mark(m, 0.28, 2);
      for (const s of this.shown) (scenario().curves || looks.get(s.estimator).floor ? this.line(s) : this.levels(s));
      for (const m of this.marks) if (m.failed) this.mark(m, 0.75, 4);
      if (!this.shown.length) {
        c.fillStyle = css("--soft");
        c.textAlign = "center";
        c.fillText("Pick an estimator and a sensor above", (box.left + box.right) / 2, (box.top + box.bottom) / 2);
      }
      if (this.at) this.ring(this.at);
    }

    axes() {
      const { context: c, box } = this;
      c.lineWidth = 1;
      c.fillStyle = css("--soft");
      c.textBaseline = "middle";
      c.textAlign = "right";
      const decades = Math.log10(this.high / this.low), every = decades > 8 ? 2 : 1;
      for (let e = Math.round(Math.log10(this.low)), k = 0; 10 ** e <= this.high; e += 1, k += 1) {
        const y = this.y(10 ** e);
        c.strokeStyle = css("--grid");
        c.beginPath(); c.moveTo(box.left, y); c.lineTo(box.right, y); c.stroke();
        if (k % every === 0) {
          c.fillText(`${k === 0 ? "≤ " : ""}10${superscript(e)}`, box.left - 7, y);
        }
      }
      c.textAlign = "center";
      c.textBaseline = "top";
      const rough = this.right / 5, size = 10 ** Math.floor(Math.log10(rough));
      const step = size * [1, 2, 5, 10].find((m) => m * size >= rough);
      for (let k = 0; k * step <= this.right * 1.001; k += 1) {
        c.fillText(String(Number((k * step).toPrecision(3))), this.x(k * step), box.bottom + 8);
      }
      c.strokeStyle = css("--line");
      c.beginPath(); c.moveTo(box.left, box.top); c.lineTo(box.left, box.bottom); c.lineTo(box.right, box.bottom); c.stroke();
    }

    mark(m, alpha, radius) {
      const c = this.context;
      c.globalAlpha = alpha;
      c.fillStyle = seriesColour(m.s);
      c.beginPath();
      if (m.failed) {
        c.moveTo(m.px, m.py - radius); c.lineTo(m.px + radius, m.py + radius * 0.8); c.lineTo(m.px - radius, m.py + radius * 0.8);
      } else c.arc(m.px, m.py, radius, 0, 7);
      c.fill();
      c.globalAlpha = 1;
    }

    line(s) {
      const c = this.context, r = s.rolling[this.column], floor = looks.get(s.estimator).floor;
      c.fillStyle = c.strokeStyle = seriesColour(s);
      if (!floor) {
        const edge = (y) => this.y(y === null ? this.high : y), known = r.x.map((_, k) => k).filter((k) => r.low[k] !== null);
        if (known.length) {
          c.globalAlpha = 0.17;
          c.beginPath();
          known.forEach((k) => c.lineTo(this.x(r.x[k]), edge(r.low[k])));
          [...known].reverse().forEach((k) => c.lineTo(this.x(r.x[k]), edge(r.high[k])));
          c.fill();
          c.globalAlpha = 1;
        }
      }
      c.lineWidth = floor ? 1.3 : 2.4;
      c.setLineDash(floor ? [] : DASHES[s.dash]);
      c.beginPath();
      let open = false;
      r.x.forEach((x, k) => {
        if (r.mid[k] === null) { open = false; return; }
        if (open) c.lineTo(this.x(x), this.y(r.mid[k])); else c.moveTo(this.x(x), this.y(r.mid[k]));
        open = true;
      });
      c.stroke();
      c.setLineDash([]);
    }

    /* Median and quartiles of each noise level, series side by side. */
    levels(s) {
      const c = this.context, r = s.rolling[this.column];
      const drawn = this.shown.filter((one) => !looks.get(one.estimator).floor);
      const shift = (drawn.indexOf(s) - (drawn.length - 1) / 2) * 6;
      c.fillStyle = c.strokeStyle = seriesColour(s);
      r.x.forEach((place, k) => {
        const x = this.x(place) + shift;
        if (r.low[k] !== null) {
          c.globalAlpha = 0.4; c.lineWidth = 4; c.lineCap = "butt";
          c.beginPath(); c.moveTo(x, this.y(r.low[k]));
          c.lineTo(x, r.high[k] === null ? this.box.top : this.y(r.high[k])); c.stroke();
          c.globalAlpha = 1; c.lineCap = "round";
        }
        if (r.mid[k] === null) return;
        c.beginPath(); c.arc(x, this.y(r.mid[k]), 3.4, 0, 7); c.fill();
        c.lineWidth = 1; c.strokeStyle = css("--card"); c.stroke(); c.strokeStyle = c.fillStyle;
      });
    }

    ring(m) {
      const c = this.context;
      this.mark(m, 1, m.failed ? 5 : 4);
      c.strokeStyle = css("--ink");
      c.lineWidth = 1.5;
      c.beginPath(); c.arc(m.px, m.py, 7, 0, 7); c.stroke();
    }

    select(m) {
      this.at = m;
      this.draw();
      if (!m) return hideTip();
      const p = m.s.points, box = this.canvas.getBoundingClientRect();
      return showTip([
        `${m.s.estimator}, ${m.s.sensor}`,
        `σ = ${number(p.sigma[m.k])}, seed ${p.seed[m.k]}`,
        ...data.metrics.map((metric) => `${metric.label} ${withUnit(metric, p[metric.name][m.k])}`),
        p.status[m.k] === "ok" ? (p.published[m.k] ? "the published step finds no root" : "ok") : p.status[m.k],
      ], box.left + m.px, box.top + m.py);
    }

    hover(event) {
      const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
      let best = null, least = 28 ** 2;
      for (const m of this.marks || []) {
        const d = (m.px - x) ** 2 + (m.py - y) ** 2;
        if (d < least) { least = d; best = m; }
      }
      if (best !== this.at) this.select(best);
    }

    leave() { if (this.at) this.select(null); }

    key(event) {
      const marks = this.marks || [];
      if (event.key === "Escape") return this.leave();
      if (!["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].includes(event.key) || !marks.length) return undefined;
      event.preventDefault();
      if (!this.at) return this.select(marks[0]);
      if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
        const own = marks.filter((m) => m.s === this.at.s).sort((a, b) => a.px - b.px || a.py - b.py);
        const next = own.findIndex((m) => m.k === this.at.k && m.failed === this.at.failed) + (event.key === "ArrowRight" ? 1 : -1);
        return this.select(own[Math.max(0, Math.min(own.length - 1, next))]);
      }
      const kinds = [...new Set(marks.map((m) => m.s))];
      const turn = event.key === "ArrowDown" ? 1 : kinds.length - 1;
      const other = kinds[(kinds.indexOf(this.at.s) + turn) % kinds.length];
      const from = this.at.px;
      return this.select(marks.filter((m) => m.s === other).reduce((a, b) => (Math.abs(b.px - from) < Math.abs(a.px - from) ? b : a)));
    }
  }

  /* Scenes -------------------------------------------------------------------------------- */

  const LOWEST = 110; // pixels that a scene is high at least
  const CAR = [5, 2]; // metres, HighwayEnv's cars

  class Plane {
    constructor(canvas, scene, tallest) {
      const [[left, right], [bottom, top]] = scene.limits;
      const margin = 34, pad = 8, width = canvas.clientWidth;
      const scale = Math.min((width - margin - pad) / (right - left), (tallest - margin - pad) / (top - bottom));
      /* A long road on a narrow screen is stretched, and says so. */
      const stretch = Math.min(4, Math.max(1, Math.round((2 * LOWEST) / ((top - bottom) * scale)) / 2));
      const height = (top - bottom) * scale * stretch + margin + pad;
      Object.assign(this, prepare(canvas, Math.round(height)), { scale, stretch, scene });
      const free = this.width - margin - pad - (right - left) * scale;
      this.x = (x) => margin + free / 2 + (x - left) * scale;
      /* On HighwayEnv's roads y points down, as HighwayEnv draws it. */
      this.y = (y) => pad + (scene.down ? y - bottom : top - y) * scale * stretch;
      this.foot = pad + (top - bottom) * scale * stretch;
      this.grid();
      const c = this.context;
      c.beginPath();
      c.rect(this.x(left) - 8, pad - 8, (right - left) * scale + 16, this.foot - pad + 12);
      c.clip();
      this.road();
    }

    road() {
      const c = this.context, trace = (points) => points.forEach((p) => c.lineTo(this.x(p[0]), this.y(p[1])));
      c.fillStyle = css("--road");
      for (const lane of this.scene.lanes) {
        c.beginPath(); trace(lane.edges[0]); trace([...lane.edges[1]].reverse()); c.fill();
      }
      c.strokeStyle = css("--mark"); c.lineWidth = 1.3;
      for (const lane of this.scene.lanes) lane.edges.forEach((edge, k) => {
        if (lane.marks[k] === "none") return;
        c.setLineDash(lane.marks[k] === "dashed" ? [6, 6] : []);
        c.beginPath(); trace(edge); c.stroke();
      });
      c.setLineDash([]);
    }

    /* A car of HighwayEnv's size at (x, y, heading); elsewhere a dot, as games know points. */
    car(point, colour, { filled = true, radius = 5 } = {}) {
      if (!this.scene.down) { this.dot(point, colour, radius); return; }
      const c = this.context, [x, y, heading] = point, cos = Math.cos(heading), sin = Math.sin(heading);
      c.beginPath();
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        const along = a * CAR[0] / 2, beside = b * CAR[1] / 2;
        c.lineTo(this.x(x + along * cos - beside * sin), this.y(y + along * sin + beside * cos));
      }
      c.closePath();
      c.fillStyle = c.strokeStyle = colour; c.lineWidth = 1.5;
      if (filled) c.fill();
      c.stroke();
    }

    grid() {
      const { context: c, scene } = this, [[left, right], [bottom, top]] = scene.limits;
      const step = (from, to, most) => {
        const rough = (to - from) / most, size = 10 ** Math.floor(Math.log10(rough));
        return size * [1, 2, 5, 10].find((m) => m * size >= rough);
      };
      const s = step(left, right, Math.max(2, this.width / 90)), r = Math.min(s, step(bottom, top, 4));
      c.fillStyle = css("--soft");
      c.strokeStyle = css("--grid");
      c.lineWidth = 1;
      const line = (a, b, d, e) => { c.beginPath(); c.moveTo(a, b); c.lineTo(d, e); c.stroke(); };
      const text = (v) => String(Number(v.toPrecision(6)));
      c.textAlign = "center"; c.textBaseline = "top";
      for (let k = Math.ceil(left / s); k * s <= right; k += 1) {
        line(this.x(k * s), 8, this.x(k * s), this.foot);
        c.fillText(text(k * s), this.x(k * s), this.foot + 5);
      }
      c.textAlign = "right"; c.textBaseline = "middle";
      for (let k = Math.ceil(bottom / r); k * r <= top; k += 1) {
        line(this.x(left), this.y(k * r), this.x(right), this.y(k * r));
        c.fillText(text(k * r), this.x(left) - 5, this.y(k * r));
      }
      c.textAlign = "right"; c.textBaseline = "bottom";
      c.fillText(`${scene.axes[0]} → · ${scene.axes[1]} ${scene.down ? "↓" : "↑"} [m]${this.stretch > 1 ? `, stretched × ${this.stretch}` : ""}`, this.x(right), this.height - 1);
    }

    path(points, colour, { width = 1, alpha = 1, dash = [], upto = points.length } = {}) {
      const c = this.context;
      c.strokeStyle = colour; c.globalAlpha = alpha; c.lineWidth = width; c.setLineDash(dash);
      c.beginPath();
      for (let k = 0; k < upto; k += 1) c.lineTo(this.x(points[k][0]), this.y(points[k][1]));
      c.stroke();
      c.setLineDash([]); c.globalAlpha = 1;
    }

    dot(point, colour, radius, alpha = 1) {
      const c = this.context;
      c.fillStyle = colour; c.globalAlpha = alpha;
      c.beginPath(); c.arc(this.x(point[0]), this.y(point[1]), radius, 0, 7); c.fill();
      c.globalAlpha = 1;
    }
  }

  const playerColour = (i) => shade(data.players[i % data.players.length]);
  const isWide = (scene) => {
    const [[left, right], [bottom, top]] = scene.limits;
    return right - left > 2 * (top - bottom);
  };

  class Bundle {
    constructor(series) {
      this.series = series;
      this.at = -1;
      this.figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      caption.textContent = series ? `${series.estimator}, ${series.sensor}` : "Truth and observations";
      this.canvas = document.createElement("canvas");
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "application");
      this.canvas.setAttribute("aria-roledescription", "chart");
      this.canvas.setAttribute("aria-label", `Trajectories: ${caption.textContent}`);
      this.figure.append(caption, this.canvas);
      this.canvas.addEventListener("pointermove", (event) => this.hover(event));
      this.canvas.addEventListener("pointerdown", (event) => this.hover(event));
      this.canvas.addEventListener("pointerleave", () => this.select(-1));
      this.canvas.addEventListener("blur", () => this.select(-1));
      this.canvas.addEventListener("keydown", (event) => {
        const turn = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (event.key === "Escape") this.select(-1);
        if (!turn || !this.bundle.length) return;
        event.preventDefault();
        this.select((Math.max(this.at, turn > 0 ? -1 : 0) + turn + this.bundle.length) % this.bundle.length);
      });
      const scene = scenario().scene;
      this.bundle = scene.samples.filter((s) => s.sigma === scene.bundle).map((sample) => {
        const found = series && sample.predictions.find((p) => p.estimator === series.estimator && p.sensor === series.sensor);
        return { sample, found, paths: series ? found && found.paths : sample.observed };
      }).filter((one) => one.sample && (!series || one.found));
      const missing = this.bundle.filter((one) => !one.paths);
      const without = missing.filter((one) => one.found.status !== "ok").length, undrawn = missing.length - without;
      this.bundle = this.bundle.filter((one) => one.paths);
      const small = document.createElement("small");
      small.textContent = ` · ${this.bundle.length} sequence${this.bundle.length === 1 ? "" : "s"}${without ? `, ${without} without a prediction` : ""}${undrawn ? `, ${undrawn} not drawn` : ""}`;
      caption.append(small);
    }

    draw() {
      const scene = scenario().scene;
      const plane = this.plane = new Plane(this.canvas, scene, isWide(scene) ? 300 : 330);
      const faint = this.at < 0 ? 1 : 0.35;
      const [alpha, width] = this.bundle.length > 6 ? [0.5, 1.1] : [0.8, this.series ? 2.6 : 1.6];
      this.bundle.forEach((one, k) => { if (k !== this.at) this.one(one, alpha * faint, width); });
      scene.truth.forEach((path) => {
        plane.path(path, css("--ink"), { width: 1.4, dash: [5, 4] });
        plane.car(path[0], css("--ink"), { radius: 3.5 });
      });
      if (this.at >= 0) this.one(this.bundle[this.at], 1, 2.6);
    }

    one(one, alpha, width) {
      one.paths.forEach((path, i) => {
        if (this.series) {
          this.plane.path(path, playerColour(i), { alpha, width });
          if (this.plane.scene.down) this.plane.car(path[path.length - 1], playerColour(i), { filled: false });
        }
        else path.forEach((point) => this.plane.dot(point, playerColour(i), width, alpha));
      });
    }

    select(k, x, y) {
      if (k === this.at) return;
      this.at = k;
      this.draw();
      if (k < 0) { hideTip(); return; }
      const { sample, found } = this.bundle[k], box = this.canvas.getBoundingClientRect();
      const lines = [`σ = ${number(sample.sigma)}, seed ${sample.seed}`];
      if (found) lines.push(...data.metrics.map((metric) => `${metric.label} ${withUnit(metric, found.errors[metric.name] ?? "–")}`));
      showTip(lines, x ?? box.left + box.width / 2, y ?? box.top + 10);
    }

    hover(event) {
      const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
      let best = -1, least = 20 ** 2;
      this.bundle.forEach((one, k) => one.paths.forEach((path) => path.forEach((point) => {
        const d = (this.plane.x(point[0]) - x) ** 2 + (this.plane.y(point[1]) - y) ** 2;
        if (d < least) { least = d; best = k; }
      })));
      this.select(best, event.clientX, event.clientY);
    }
  }

  let bundles = [];
  function buildBundles() {
    const scene = scenario().scene, holder = byId("bundles");
    byId("bundle-title").textContent = scene ? `Bundles at σ = ${number(scene.bundle)}` : "Bundles";
    bundles = scene ? [new Bundle(null), ...visible().filter((s) => !looks.get(s.estimator).floor).map((s) => new Bundle(s))] : [];
    holder.className = scene && isWide(scene) ? "wide-scenes" : "tall";
    holder.replaceChildren(...bundles.map((b) => b.figure));
    bundles.forEach((b) => b.draw());
  }

  /* Player -------------------------------------------------------------------------------- */

  let playing = 0, clock = 0;

  function setUpTrials() {
    const scene = scenario().scene, select = byId("trial");
    for (const part of all(".stage, #bundles, #bundle-title")) part.hidden = !scene;
    document.querySelector(".missing").hidden = Boolean(scene);
    if (!scene) return;
    select.replaceChildren(...scene.samples.map((s, k) => new Option(`σ = ${number(s.sigma)}, seed ${s.seed}`, k)));
    state.sample = Math.min(state.sample, scene.samples.length - 1);
    select.value = state.sample;
    const sensors = [...new Set(scene.samples.flatMap((s) => s.predictions.map((p) => p.sensor)))]
      .sort((a, b) => allSensors.indexOf(a) - allSensors.indexOf(b));
    byId("trial-sensor").replaceChildren(...sensors.map((v) => new Option(v, v)));
    if (!sensors.includes(state.sensor)) state.sensor = sensors[0];
    byId("trial-sensor").value = state.sensor;
    const last = scene.truth[0].length - 1;
    byId("time").max = last;
    setTime(last);
  }

  function setTime(step) {
    state.time = step;
    byId("time").value = step;
    drawPlayer();
  }

  function drawPlayer() {
    const scene = scenario().scene;
    if (!scene) return;
    const sample = scene.samples[state.sample], t = state.time, upto = t + 1, ink = css("--ink");
    const plane = new Plane(byId("player"), scene, isWide(scene) ? 380 : 440);
    const shown = sample.predictions.filter((p) => p.sensor === state.sensor && state.estimators.has(p.estimator));
    scene.truth.forEach((path, i) => {
      plane.path(path, ink, { width: 1, alpha: 0.22 });
      sample.observed[i].slice(0, upto).forEach((point) => plane.dot(point, css("--soft"), 2.3, 0.75));
      plane.path(path, ink, { width: 1.6, dash: [5, 4], upto });
    });
    for (const p of shown) {
      const colour = shade(looks.get(p.estimator).colours[0]);
      for (const path of p.paths || []) {
        plane.path(path, colour, { width: 2.4, alpha: 0.9, upto });
        plane.car(path[t], colour, { filled: false });
      }
    }
    const c = plane.context;
    c.textAlign = "center"; c.textBaseline = "middle"; c.font = "700 10px system-ui, sans-serif";
    scene.truth.forEach((path, i) => {
      plane.car(path[t], ink, { radius: 7.5 });
      c.fillStyle = css("--card");
      c.fillText(i + 1, plane.x(path[t][0]), plane.y(path[t][1]) + 0.5);
    });
    const time = number(t * scene.dt), end = number((scene.truth[0].length - 1) * scene.dt);
    byId("clock").textContent = `${time} / ${end} s`;
    byId("time").setAttribute("aria-valuetext", `${time} seconds of ${end}`);
    fillValues(scene, shown, t);
  }

  function fillValues(scene, shown, t) {
    byId("values").tBodies[0].replaceChildren(...shown.map((p) => {
      const row = document.createElement("tr"), name = document.createElement("th"), swatch = document.createElement("i");
      swatch.className = "swatch";
      swatch.style.setProperty("--a", looks.get(p.estimator).colours[0]);
      swatch.style.setProperty("--b", looks.get(p.estimator).colours[0]);
      name.scope = "row";
      name.append(swatch, p.estimator);
      if (p.status !== "ok") {
        const status = document.createElement("small");
        status.textContent = ` ${p.status}`;
        name.append(status);
      }
      row.append(name);
      const off = p.paths && p.paths.reduce((sum, path, i) =>
        sum + Math.hypot(path[t][0] - scene.truth[i][t][0], path[t][1] - scene.truth[i][t][1]), 0) / p.paths.length;
      const cells = [p.paths ? off.toFixed(3) : "–", ...data.metrics.map((m) => (p.errors[m.name] === null ? (m.prediction && p.status !== "ok" ? "∞" : "–") : number(p.errors[m.name])))];
      cells.forEach((text) => {
        const cell = row.insertCell();
        cell.textContent = text;
        cell.className = "n";
      });
      return row;
    }));
  }

  function play(on) {
    cancelAnimationFrame(playing);
    playing = 0;
    byId("play").textContent = on ? "❚❚" : "▶";
    byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return;
    const last = scenario().scene.truth[0].length - 1, milliseconds = Math.max(60, Math.min(250, 6000 / last));
    if (state.time >= last) setTime(0);
    clock = performance.now();
    const tick = (now) => {
      if (now - clock >= milliseconds) {
        clock = now;
        setTime(state.time + 1);
        if (state.time >= last) { play(false); return; }
      }
      playing = requestAnimationFrame(tick);
    };
    playing = requestAnimationFrame(tick);
  }

  /* All together -------------------------------------------------------------------------- */

  const charts = all("canvas[data-metric]").map((canvas) => new Chart(canvas, metricOf.get(canvas.dataset.metric)));

  /* What lines and signs of the charts mean; colours are told by the buttons. */
  function legend() {
    const shown = visible(), entries = [];
    const curves = scenario().curves;
    for (const sensor of curves ? allSensors : []) {
      const one = shown.find((s) => s.sensor === sensor && !looks.get(s.estimator).floor);
      if (one) entries.push([`l-dash-${one.dash}`, `${sensor}, rolling median`]);
    }
    if (!curves) entries.push(["l-mid", "median of a noise level"]);
    const lines = shown.flatMap((s) => Object.values(s.rolling));
    if (lines.some((r) => r.low.some((low) => low !== null))) entries.push([curves ? "l-band" : "l-bar", "quartiles"]);
    if (charts.some((chart) => chart.failing.length)) entries.push(["l-failed", "failed"]);
    const floor = shown.find((s) => looks.get(s.estimator).floor);
    if (floor) entries.push(["l-floor", `${floor.estimator}, the floor`]);
    byId("chart-legend").replaceChildren(...entries.map(([kind, text]) => {
      const entry = document.createElement("span");
      entry.className = kind;
      entry.textContent = text;
      return entry;
    }));
  }

  function redraw() {
    hideTip();
    charts.forEach((chart) => { chart.at = null; chart.draw(); });
    legend();
    buildBundles();
    drawPlayer();
    filterTables();
  }

  function setUp() {
    applyTheme();
    setUpBoard();
    chips(byId("sensors"), allSensors, state.sensors, false);
    chips(byId("estimators"), data.estimators.map((e) => e.name), state.estimators, true);
    byId("scenario").addEventListener("change", (event) => {
      play(false);
      state.scenario = Number(event.target.value);
      state.sample = 0;
      setUpTrials();
      redraw();
    });
    byId("trial").addEventListener("change", (event) => { state.sample = Number(event.target.value); drawPlayer(); });
    byId("trial-sensor").addEventListener("change", (event) => { state.sensor = event.target.value; drawPlayer(); });
    byId("time").addEventListener("input", (event) => { play(false); setTime(Number(event.target.value)); });
    byId("play").addEventListener("click", () => play(!playing));
    byId("pair-error").addEventListener("change", filterTables);
    byId("theme").addEventListener("click", () => {
      theme = themes[(themes.indexOf(theme) + 1) % themes.length];
      applyTheme();
      redraw();
    });
    systemDark.addEventListener("change", () => { applyTheme(); redraw(); });
    let width = innerWidth;
    addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; redraw(); } });
    setUpTrials();
    redraw();
  }
  setUp();
})();
