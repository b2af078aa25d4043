/* A drawing context that writes SVG: the part of a canvas's context that this page draws with. */
class VectorContext {
  constructor(width, height) {
    Object.assign(this, {
      width, height, parts: [], path: [], dash: [], clips: 0,
      fillStyle: "#000", strokeStyle: "#000", lineWidth: 1, globalAlpha: 1, lineCap: "round", lineJoin: "round",
      font: "12px sans-serif", textAlign: "left", textBaseline: "alphabetic",
    });
  }

  setTransform() {}
  setLineDash(dash) { this.dash = dash; }
  beginPath() { this.path = []; }
  moveTo(x, y) { this.path.push(`M${VectorContext.round(x)} ${VectorContext.round(y)}`); }
  lineTo(x, y) { this.path.push(`${this.path.length ? "L" : "M"}${VectorContext.round(x)} ${VectorContext.round(y)}`); }
  closePath() { this.path.push("Z"); }
  rect(x, y, w, h) { this.moveTo(x, y); this.lineTo(x + w, y); this.lineTo(x + w, y + h); this.lineTo(x, y + h); this.closePath(); }
  /* A whole circle: this page draws no other arc. */
  arc(x, y, r) {
    const [a, b, c] = [x - r, y, r].map(VectorContext.round);
    this.path.push(`M${a} ${b}a${c} ${c} 0 1 0 ${2 * c} 0a${c} ${c} 0 1 0 ${-2 * c} 0`);
  }

  clip() {
    this.clips += 1;
    this.parts.push(`<clipPath id="clip${this.clips}"><path d="${this.path.join("")}"/></clipPath><g clip-path="url(#clip${this.clips})">`);
  }
  fill() { this.parts.push(`<path d="${this.path.join("")}" fill="${this.fillStyle}" fill-opacity="${this.globalAlpha}"/>`); }
  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(" ")}"` : "";
    this.parts.push(`<path d="${this.path.join("")}" fill="none" stroke="${this.strokeStyle}" stroke-opacity="${this.globalAlpha}" stroke-width="${this.lineWidth}" stroke-linecap="${this.lineCap}" stroke-linejoin="${this.lineJoin}"${dash}/>`);
  }
  fillText(text, x, y) {
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    const baseline = { top: "text-before-edge", middle: "central", bottom: "text-after-edge", alphabetic: "alphabetic" }[this.textBaseline];
    const [, weight, size] = /^(?:(\d+) )?(\d+)px/.exec(this.font);
    this.parts.push(`<text x="${VectorContext.round(x)}" y="${VectorContext.round(y)}" fill="${this.fillStyle}" font-size="${size}" font-weight="${weight || 400}" text-anchor="${anchor}" dominant-baseline="${baseline}">${VectorContext.escape(text)}</text>`);
  }

  /* All that was drawn, as elements. */
  elements() { return this.parts.join("") + "</g>".repeat(this.clips); }

  static round(value) { return Math.round(value * 100) / 100; }
  static escape(text) { return String(text).replace(/[<>&"]/g, (c) => ({ "<": "&lt;", ">": "&gt;", "&": "&amp;", '"': "&quot;" })[c]); }
}
