/* Errors over noise. */
class Chart {
  constructor(canvas, metric) {
    Object.assign(this, { canvas, metric, column: metric.name, smallest: metric.negligible, at: null });
    canvas.addEventListener("pointermove", (event) => this.hover(event));
    canvas.addEventListener("pointerdown", (event) => {
      const before = this.at;
      this.hover(event);
      /* The first tap selects a point; a second tap on it plays its trial. */
      this.ready = event.pointerType === "mouse" || isSameMark(before, this.at);
    });
    canvas.addEventListener("click", () => { if (this.at && this.ready) this.play(this.at); });
    canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") this.leave(); });
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
    /* The published definition of failure is about predictions. */
    const fails = (s, k) => s.points[this.column][k] === null
      || (this.metric.prediction && s.points.published[k] === 1);
    const failing = shown.filter((s) => s.points && s.points.x.some((_, k) => fails(s, k)));
    const box = { left: 50, right: this.width - 10, top: 12 + 11 * (scenario().curves ? failing.length : Math.min(1, failing.length)), bottom: this.height - 26 };
    this.x = (x) => box.left + 6 + (x / right) * (box.right - box.left - 12);
    /* With few levels, levels are side by side, and so are the series of a level. */
    this.sigmas = scenario().curves ? [] : [...new Set(shown.flatMap((s) => s.rolling[this.column].sigma || []))].sort((a, b) => a - b);
    const drawn = shown.filter((s) => !looks.get(s.estimator).floor), slot = (box.right - box.left) / Math.max(1, this.sigmas.length);
    const step = Math.min(14, (0.8 * slot) / Math.max(1, drawn.length));
    this.level = (s, sigma) => box.left + (this.sigmas.indexOf(sigma) + 0.5) * slot + (drawn.indexOf(s) - (drawn.length - 1) / 2) * step;
    this.place = (s, k) => (this.sigmas.length ? this.level(s, s.points.sigma[k]) : this.x(s.points.x[k]));
    this.y = (y) => box.bottom - (Math.log10(Math.max(y, low) / low) / Math.log10(high / low)) * (box.bottom - box.top);
    Object.assign(this, { shown, low, high, right, failing, box });
    this.marks = [];
    shown.forEach((s) => {
      if (!s.points) return;
      s.points.x.forEach((_, k) => {
        const y = s.points[this.column][k];
        if (typeof y === "number") this.marks.push({ s, k, px: this.place(s, k), py: this.y(y), failed: false });
        if (fails(s, k)) this.marks.push({ s, k, px: this.place(s, k), py: 8 + (this.sigmas.length ? 0 : 11 * failing.indexOf(s)), failed: true });
      });
    });
  }

  draw() {
    Object.assign(this, prepare(this.canvas));
    this.layout();
    const { context: c, box } = this;
    this.axes();
    for (const m of this.marks) if (!m.failed) this.mark(m, 0.28, 2);
    for (const m of this.marks) if (playableAt(m) >= 0) this.circle(m);
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
    this.sigmas.forEach((sigma, k) => {
      c.fillText(number(sigma), box.left + ((k + 0.5) * (box.right - box.left)) / this.sigmas.length, box.bottom + 8);
    });
    for (let k = 0; !this.sigmas.length && k * step <= this.right * 1.001; k += 1) {
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
    c.fillStyle = c.strokeStyle = seriesColour(s);
    r.sigma.forEach((sigma, k) => {
      const x = this.level(s, sigma);
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

  /* A trial that can be played. */
  circle(m) {
    const c = this.context;
    c.strokeStyle = seriesColour(m.s);
    c.globalAlpha = 0.8;
    c.lineWidth = 1.1;
    c.beginPath(); c.arc(m.px, m.py, 3.6, 0, 7); c.stroke();
    c.globalAlpha = 1;
  }

  play(m) {
    const at = playableAt(m);
    if (at >= 0) playTrial(at, m.s.sensor);
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
      playableAt(m) >= 0 ? "click, or Enter: play it" : `not in this page: report --play ${p.sigma[m.k]}:${p.seed[m.k]} adds it`,
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
    if (!isSameMark(best, this.at) && best !== this.at) this.select(best);
  }

  leave() { if (this.at) this.select(null); }

  key(event) {
    const marks = this.marks || [];
    if (event.key === "Escape") return this.leave();
    if (event.key === "Enter" && this.at) {
      event.preventDefault(); // or the button that gets the focus would be pressed
      return this.play(this.at);
    }
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

/* Index in the player of a mark's trial; -1 if the page does not contain it. */
function playableAt(m) {
  const scene = scenario().scene, p = m.s.points;
  if (!scene) return -1;
  if (!scene.places) scene.places = new Map(scene.samples.map((s, k) => [`${s.sigma} ${s.seed}`, k]));
  return scene.places.get(`${p.sigma[m.k]} ${p.seed[m.k]}`) ?? -1;
}

/* Marks are created again with every drawing. */
function isSameMark(a, b) {
  return Boolean(a && b) && a.s === b.s && a.k === b.k && a.failed === b.failed;
}
