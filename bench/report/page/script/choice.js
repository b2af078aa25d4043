/* What is shown: scenario, sensors, estimators. */
const state = { scenario: 0, sensors: new Set(), estimators: new Set(), sample: 0, sensor: "", time: 0 };
const scenario = () => data.scenarios[state.scenario];
/* A scene with one of its draws: the shared parts, and the draw's truth, limits and lanes. */
const inDraw = (scene, key) => ({ ...scene, ...scene.draws[key] });
const drawOf = (sample) => inDraw(scenario().scene, sample.draw);
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

/* Choose all names but some, and update the buttons in a holder. */
function press(holder, chosen, names, without) {
  all("button", holder).forEach((button, k) => {
    const on = !without.has(names[k]);
    if (on) chosen.add(names[k]); else chosen.delete(names[k]);
    button.setAttribute("aria-pressed", String(on));
  });
}

function filterTables() {
  for (const row of all("table.filtered tbody tr[data-scenario]")) {
    const { scenario: place, sensor, error } = row.dataset; // an empty place: all scenarios
    row.hidden = (place && place !== scenario().name) || (sensor !== undefined && !state.sensors.has(sensor))
      || (error !== undefined && error !== byId("pair-error").value);
  }
  for (const cell of all("[data-estimator]")) cell.hidden = !state.estimators.has(cell.dataset.estimator);
}
