/* The player of one trial. */
const state = { scenario: 0, estimators: new Set(), sample: 0, sensor: "", time: 0 };
const scenario = () => data.scenarios[state.scenario];
/* A scene with one of its draws: the shared parts, and the draw's truth, limits and lanes. */
const drawOf = (sample) => ({ ...scenario().scene, ...scenario().scene.draws[sample.draw] });
const looks = new Map((data.estimators || []).map((e) => [e.name, e]));
let playing = 0, clock = 0;

const trialSample = () => scenario().scene.samples[state.sample];
const lastStep = () => drawOf(trialSample()).truth[0].length - 1;
const trialSensors = () => [...new Set(scenario().scene.samples.flatMap((s) => s.predictions.map((p) => p.sensor)))]
  .sort((a, b) => data.sensors.indexOf(a) - data.sensors.indexOf(b));
const trialPredictions = () => trialSample().predictions.filter(
  (p) => p.sensor === state.sensor && state.estimators.has(p.estimator));
const pace = () => Math.max(60, Math.min(250, 6000 / lastStep())); // milliseconds per step

function setUpTrials() {
  const scene = scenario().scene, select = byId("trial");
  all(".stage").forEach((part) => { part.hidden = !scene; });
  document.querySelector(".missing").hidden = Boolean(scene);
  if (!scene) return;
  select.replaceChildren(...scene.samples.map((s, k) => new Option(`σ = ${number(s.sigma)}, seed ${s.seed}`, k)));
  state.sample = Math.min(state.sample, scene.samples.length - 1);
  select.value = state.sample;
  const sensors = trialSensors();
  byId("trial-sensor").replaceChildren(...sensors.map((v) => new Option(v, v)));
  if (!sensors.includes(state.sensor)) state.sensor = sensors[0];
  byId("trial-sensor").value = state.sensor;
  byId("time").max = lastStep();
  setTime(lastStep());
}

/* Show a trial, chosen from the list. */
function showTrial(sample) {
  play(false);
  state.sample = sample;
  byId("trial").value = sample;
  byId("time").max = lastStep();
  setTime(lastStep());
}

function setTime(step) {
  state.time = step;
  byId("time").value = step;
  drawPlayer();
  if (!playing) writeAddress();
}

function drawPlayer() {
  if (!scenario().scene) return;
  const sample = trialSample(), scene = drawOf(sample), shown = trialPredictions();
  drawTrial(sample, scene, shown, state.time);
  const time = number(state.time * scene.dt), end = number(lastStep() * scene.dt);
  byId("clock").textContent = `${time} / ${end} s`;
  byId("time").setAttribute("aria-valuetext", `${time} seconds of ${end}`);
  fillValues(scene, shown, state.time);
  fillEstimates(scene, shown);
}

function drawTrial(sample, scene, shown, t) {
  const upto = t + 1, ink = css("--ink");
  const plane = new Plane(byId("player"), scene, isWide(scene) ? 380 : 440);
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
    c.fillText(i, plane.x(path[t][0]), plane.y(path[t][1]) + 0.5);
  });
}

/* True and estimated weights: a row for each player and weight. */
function fillEstimates(scene, shown) {
  const table = byId("estimates"), head = document.createElement("tr");
  const title = (text, numeric = true) => {
    const cell = document.createElement("th");
    cell.scope = "col";
    // A name may break behind an underscore.
    text.split(/(?<=_)/).forEach((part) => cell.append(part, document.createElement("wbr")));
    if (numeric) cell.className = "n";
    head.append(cell);
  };
  title("Player", false); title("Weight", false); title("Truth");
  shown.forEach((p) => title(p.estimator));
  table.style.setProperty("--one", `${Math.min(5, 46 / (shown.length + 1))}rem`);
  table.tHead.replaceChildren(head);
  const names = scenario().scene.weights;
  table.tBodies[0].replaceChildren(...scene.weights.flatMap((own, i) => own.map((value, k) => {
    const row = document.createElement("tr");
    row.insertCell().textContent = i;
    row.insertCell().textContent = names[k];
    [value, ...shown.map((p) => (p.weights ? p.weights[i][k] : null))].forEach((weight) => {
      const cell = row.insertCell();
      cell.className = "n share-of-one";
      cell.textContent = weight === null ? "–" : weight.toFixed(3);
      cell.style.setProperty("--share", weight ?? 0);
    });
    return row;
  })));
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
  if (!on) { writeAddress(); return; }
  const last = lastStep(), milliseconds = pace();
  if (state.time >= last) setTime(0);
  clock = performance.now();
  const tick = (now) => {
    if (now - clock >= milliseconds) {
      clock = now;
      if (state.time + 1 >= last) play(false);
      setTime(Math.min(last, state.time + 1));
      if (state.time >= last) return;
    }
    playing = requestAnimationFrame(tick);
  };
  playing = requestAnimationFrame(tick);
}
