/* Starts the page; the last file. */
const charts = all("canvas[data-metric]").map((canvas) => new Chart(canvas, metricOf.get(canvas.dataset.metric)));

/* Legend of the charts' lines and signs; the buttons show the colours. */
function legend() {
  const shown = visible(), entries = [];
  const curves = scenario().curves;
  for (const sensor of curves ? allSensors : []) {
    const one = shown.find((s) => s.sensor === sensor && !looks.get(s.estimator).floor);
    if (one) entries.push([`l-dash-${one.dash}`, `${sensor}, rolling median`]);
  }
  if (!curves) entries.push(["l-mid", "median of a noise level"]);
  const lines = shown.filter((s) => !looks.get(s.estimator).floor).flatMap((s) => Object.values(s.rolling));
  if (lines.some((r) => r.low.some((low) => low !== null))) entries.push([curves ? "l-band" : "l-bar", "quartiles"]);
  if (charts.some((chart) => chart.failing.length)) entries.push(["l-failed", "failed"]);
  const floor = shown.find((s) => looks.get(s.estimator).floor);
  if (floor) entries.push(["l-floor", `${floor.estimator}, the floor`]);
  byId("chart-axis").textContent = curves ? "Mean absolute error of the observed positions [m]" : "Noise level σ [m]";
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
  writeAddress();
}

/* Legend of a chart's lines and points, for files. */
function chartLegend() {
  const shown = visible().map((s) => [seriesColour(s), looks.get(s.estimator).floor ? s.estimator : `${s.estimator}, ${s.sensor}`]);
  return [...new Map(shown.map((entry) => [entry[1], entry])).values()];
}

function setUpChartSaves() {
  for (const chart of charts) {
    const title = () => `${scenario().name}: ${chart.metric.title} over ${byId("chart-axis").textContent.replace(/^[A-Z]/, (c) => c.toLowerCase())}`;
    chart.canvas.closest("figure").querySelector("figcaption").append(saveButtons(
      () => vectorFigure(chart.canvas, () => chart.draw(), title(), chartLegend()),
      () => fileName(chart.metric.name, scenario().name)));
  }
}

function setUp() {
  setUpTheme(redraw);
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
  byId("trial").addEventListener("change", (event) => showTrial(Number(event.target.value)));
  byId("trial-sensor").addEventListener("change", (event) => {
    state.sensor = event.target.value;
    drawPlayer();
    writeAddress();
  });
  byId("time").addEventListener("input", (event) => { play(false); setTime(Number(event.target.value)); });
  byId("play").addEventListener("click", () => play(!playing));
  byId("pair-error").addEventListener("change", () => { filterTables(); writeAddress(); });
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; redraw(); } });
  setUpTables();
  setUpChartSaves();
  setUpPlayerSaves();
  setUpLinks();
  applyAddress();
}
setUp();
