/* Scenes: the plane of a draw. */
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

const isWide = (scene) => {
  const [[left, right], [bottom, top]] = scene.limits;
  return right - left > 2 * (top - bottom);
};
