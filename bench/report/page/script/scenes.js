/* Scenes: the plane of a draw, and bundles of sequences in it. */
const LOWEST = 110; // least height of a scene [pixels]
const CAR = [5, 2]; // metres, HighwayEnv's cars

class Plane {
  constructor(canvas, scene, tallest) {
    const [[left, right], [bottom, top]] = scene.limits;
    const margin = 34, pad = 8, width = canvas.clientWidth;
    const scale = Math.min((width - margin - pad) / (right - left), (tallest - margin - pad) / (top - bottom));
    /* A long road on a narrow screen is stretched; a label says so. */
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

  /* A car of HighwayEnv's size at (x, y, heading); elsewhere a dot, as other games have points. */
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
    const scene = scenario().scene, own = scene.samples[0].draw;
    this.bundle = scene.samples.filter((s) => s.sigma === scene.bundle && s.draw === own).map((sample) => {
      const found = series && sample.predictions.find((p) => p.estimator === series.estimator && p.sensor === series.sensor);
      return { sample, found, paths: series ? found && found.paths : sample.observed };
    }).filter((one) => one.sample && (!series || one.found));
    const missing = this.bundle.filter((one) => !one.paths);
    const without = missing.filter((one) => one.found.status !== "ok").length, undrawn = missing.length - without;
    this.bundle = this.bundle.filter((one) => one.paths);
    const small = document.createElement("small");
    small.textContent = ` · ${this.bundle.length} sequence${this.bundle.length === 1 ? "" : "s"}${without ? `, ${without} without a prediction` : ""}${undrawn ? `, ${undrawn} not drawn` : ""}`;
    caption.append(small);
    const title = `${scenario().name}: ${this.canvas.getAttribute("aria-label")}`;
    caption.append(saveButtons(
      () => vectorFigure(this.canvas, () => this.draw(), title, scene.draws[own].truth.map((_, i) => [playerColour(i), `player ${i + 1}`])),
      () => fileName("trajectories", scenario().name, series ? series.estimator : "observations", series ? series.sensor : "")));
  }

  draw() {
    const scene = drawOf(scenario().scene.samples[0]);
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
  holder.className = scene && isWide(drawOf(scene.samples[0])) ? "wide-scenes" : "tall";
  holder.replaceChildren(...bundles.map((b) => b.figure));
  bundles.forEach((b) => b.draw());
}
