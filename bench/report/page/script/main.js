/* Starts the page; the last file. */
function redraw() {
  drawPlayer();
  filterTables(scenario().name);
  writeAddress();
}

/* Buttons for the predictions: at first, those of the first two estimators. */
function setUpEstimators() {
  byId("estimators").replaceChildren(...data.estimators.map(({ name, colours }) => {
    const button = document.createElement("button"), swatch = document.createElement("i");
    button.type = "button";
    swatch.className = "swatch";
    swatch.style.setProperty("--a", colours[0]);
    swatch.style.setProperty("--b", colours[1]);
    button.append(swatch, name);
    button.setAttribute("aria-pressed", String(state.estimators.has(name)));
    button.addEventListener("click", () => {
      const on = !state.estimators.delete(name);
      if (on) state.estimators.add(name);
      button.setAttribute("aria-pressed", String(on));
      redraw();
    });
    return button;
  }));
}

function showScenario(index) {
  play(false);
  Object.assign(state, { scenario: index, sample: 0 });
  const { name, pictures, scene } = scenario();
  state.estimators = new Set(scene ? scene.shown : []);
  byId("scenario").selectedIndex = index;
  byId("shown-scenario").textContent = name;
  if (Object.keys(pictures).length) {
    byId("plots").replaceChildren(...Object.values(pictures).map((svg) => {
      const figure = document.createElement("figure");
      figure.className = "plot";
      figure.innerHTML = svg; // drawn by this package, with its names escaped
      return figure;
    }));
  }
  setUpEstimators();
  setUpTrials();
}

/* What is shown stands in the page's address, such as #scenario=two_player&sigma=0.1&seed=3. */
let quiet = true;
function writeAddress() {
  const { scene, name } = scenario();
  if (quiet) return;
  const told = new URLSearchParams({ scenario: name });
  if (scene) {
    const { sigma, seed } = trialSample();
    Object.entries({ sigma, seed, seen: state.sensor, step: state.time }).forEach(([key, value]) => told.set(key, value));
  }
  history.replaceState(null, "", `#${told}`);
}

function readAddress() {
  const text = location.hash.slice(1), said = new URLSearchParams(byId(text) ? "" : text);
  quiet = true;
  showScenario(Math.max(0, data.scenarios.findIndex((s) => s.name === said.get("scenario"))));
  const { scene } = scenario();
  if (scene && said.has("sigma")) {
    state.sensor = said.get("seen") || state.sensor;
    const same = (s) => s.sigma === Number(said.get("sigma")) && s.seed === Number(said.get("seed"));
    state.sample = Math.max(0, scene.samples.findIndex(same));
    setUpTrials();
    if (said.has("step")) setTime(Math.max(0, Math.min(lastStep(), Number(said.get("step")) || 0)));
  }
  redraw();
  quiet = false;
}

function setUpScenes() {
  byId("scenario").addEventListener("change", (event) => { showScenario(event.target.selectedIndex); redraw(); });
  byId("trial").addEventListener("change", (event) => showTrial(Number(event.target.value)));
  byId("trial-sensor").addEventListener("change", (event) => { state.sensor = event.target.value; redraw(); });
  byId("time").addEventListener("input", (event) => { play(false); setTime(Number(event.target.value)); });
  byId("play").addEventListener("click", () => play(!playing));
  let width = innerWidth;
  addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; drawPlayer(); } });
  addEventListener("hashchange", () => { if (!byId(location.hash.slice(1))) readAddress(); });
  readAddress();
}

const playable = Boolean(data.scenarios && data.scenarios.length);
setUpTheme(() => { if (playable) drawPlayer(); });
setUpTables();
if (playable) setUpScenes();
