/* Deep links: what is shown stands in the page's address, after the #.

   An address such as #scenario=two_player&sigma=0.1&seed=3&at=trajectories brings back scenario,
   sensors, estimators, sort, filter, trial and section; what is as at first is left out. A plain
   #errors still leads to the section of that name. */
const place = { section: "", quiet: true };

function readAddress() {
  const text = location.hash.slice(1);
  return text && byId(text) ? new URLSearchParams({ at: text }) : new URLSearchParams(text);
}

function writeAddress() {
  if (place.quiet) return;
  const told = new URLSearchParams(), first = data.scenarios[0];
  const say = (key, value, usual = "") => { if (String(value) !== String(usual)) told.append(key, value); };
  say("at", place.section);
  tellBoard(say);
  say("scenario", scenario().name, first.name);
  allSensors.filter((name) => !state.sensors.has(name)).forEach((name) => told.append("without-sensor", name));
  data.estimators.filter((e) => !state.estimators.has(e.name)).forEach((e) => told.append("without", e.name));
  const sample = scenario().scene && scenario().scene.samples[state.sample];
  if (sample && (state.sample !== 0 || state.sensor !== trialSensors()[0])) {
    told.append("sigma", sample.sigma);
    told.append("seed", sample.seed);
    told.append("seen", state.sensor);
  }
  if (sample) say("step", state.time, lastStep());
  say("pair", byId("pair-error").value, byId("pair-error").options.length ? byId("pair-error").options[0].value : "");
  const hash = told.toString();
  history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
}

/* Apply the address; what it does not contain has its initial value. */
function applyAddress() {
  const said = readAddress(), all_ = (key) => new Set(said.getAll(key));
  place.quiet = true;
  heedBoard(said);
  state.scenario = Math.max(0, data.scenarios.findIndex((s) => s.name === said.get("scenario")));
  byId("scenario").value = state.scenario;
  const hidden = [all_("without-sensor"), all_("without")];
  press(byId("sensors"), state.sensors, allSensors, hidden[0]);
  press(byId("estimators"), state.estimators, data.estimators.map((e) => e.name), hidden[1]);
  const scene = scenario().scene;
  const found = scene && said.has("sigma")
    ? scene.samples.findIndex((s) => s.sigma === Number(said.get("sigma")) && s.seed === Number(said.get("seed"))) : 0;
  state.sample = Math.max(0, found);
  state.sensor = said.get("seen") || "";
  const pairs = [...byId("pair-error").options], pair = pairs.find((o) => o.value === said.get("pair")) || pairs[0];
  if (pair) byId("pair-error").value = pair.value;
  setUpTrials();
  if (scene && said.has("step")) setTime(Math.max(0, Math.min(lastStep(), Number(said.get("step")) || 0)));
  redraw();
  place.section = said.get("at") || "";
  place.quiet = false;
  if (place.section && byId(place.section)) byId(place.section).scrollIntoView();
}

function setUpLinks() {
  for (const link of all('a[href^="#"]')) {
    link.addEventListener("click", (event) => {
      event.preventDefault();
      goTo(link.getAttribute("href").slice(1));
    });
  }
  addEventListener("hashchange", applyAddress);
}

/* Scroll to a section, and keep it in the address. */
function goTo(id) {
  const target = byId(id);
  place.section = id;
  writeAddress();
  target.scrollIntoView();
  if (!target.hasAttribute("tabindex")) target.tabIndex = -1;
  target.focus({ preventScroll: true });
}
