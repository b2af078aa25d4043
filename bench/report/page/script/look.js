/* The page's data, colours, numbers, canvases. */
const packed = Uint8Array.from(atob(document.getElementById("data").textContent), (c) => c.charCodeAt(0));
const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const data = await new Response(unpacked).json();
const byId = (id) => document.getElementById(id);
const all = (selector, root = document) => [...root.querySelectorAll(selector)];

const systemDark = matchMedia("(prefers-color-scheme: dark)");
const themes = ["auto", "light", "dark"];
let theme = "auto", printing = false;

function applyTheme() {
  const dark = !printing && (theme === "dark" || (theme === "auto" && systemDark.matches));
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  byId("theme").textContent = `Theme: ${theme}`;
}

/* Let the theme follow its button, the system and the printer, which is given paper's colours. */
function setUpTheme(redraw) {
  const changed = () => { applyTheme(); redraw(); };
  byId("theme").addEventListener("click", () => {
    theme = themes[(themes.indexOf(theme) + 1) % themes.length];
    changed();
  });
  systemDark.addEventListener("change", changed);
  addEventListener("beforeprint", () => { printing = true; changed(); });
  addEventListener("afterprint", () => { printing = false; changed(); });
  applyTheme();
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
