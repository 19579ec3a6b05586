// The page of `usbench guide`: keys and buttons go to the server, its answer is drawn. No logic of the task here.
import { drawScene, signed } from "./scene.js";

const PLAY_MS = 700, POLL_MS = 1000, BUSY_MS = 150;
const byId = (id) => document.getElementById(id);
// What the numbers beside the actions are.
const CONFIDENCE = {
  probability: "Probability of each action",
  value: "Discounted return that the agent expects of each action",
  return: "Expected return of each action, to the end",
  loss: "Expected return of each action, minus that of the best",
  choice: "The agent tells its choice alone",
};
const PICTURES = {
  above: byId("above"), side: byId("side"), view: byId("frame-view"), canvas: byId("frame"), axes: byId("frame-axes"),
};
let shown = null, playing = null, poll, pending = Promise.resolve(), waiting = 0, nStale = 0, busy = "";

// One request at a time, in the order of the keys. Keys that were pressed on a picture out of date are forgotten.
function send(path, body, since) {
  if (busy) return renderSettings(shown);
  const before = nStale;
  waiting += 1;
  pending = pending.then(() => before === nStale && finished(path, body && { ...body, place: shown?.place })).then((state) => {
    if (state || shown) render(state || shown, state ? since : undefined);
  }).catch((error) => say(`The page cannot show this (${error.message}): reload it.`)).finally(() => { waiting -= 1; });
  return pending;
}

// What takes long runs beside the server, which says meanwhile what it does.
async function finished(path, body) {
  let state = await request(path, body);
  while (state?.busy) {
    renderBusy(state.busy);
    await new Promise((done) => setTimeout(done, BUSY_MS));
    state = await request("state");
  }
  renderBusy("");
  return state;
}

function renderBusy(doing) {
  busy = doing;
  byId("busy").textContent = doing && `${doing[0].toUpperCase()}${doing.slice(1)} \u2026`;
  document.querySelector("main").setAttribute("aria-busy", String(doing !== ""));
}

// The token stands in the address, as Jupyter has it: nobody else on this machine knows it.
const headers = { "Authorization": `token ${new URLSearchParams(location.search).get("token") ?? ""}` };

async function request(path, body) {
  const options = body
    ? { method: "POST", headers: { ...headers, "Content-Type": "application/json" }, body: JSON.stringify(body) }
    : { headers };
  try {
    const response = await fetch(path, options);
    const answer = await response.json();
    // What was said stays while a training is looked after.
    if (!response.ok || path !== "update") say(response.ok ? answer.message ?? "" : answer.error);
    if (response.ok) byId("notice").textContent = answer.notice ?? "";
    if (response.status !== 409) return response.ok ? answer : null;
    nStale += 1;
    pause();
    return answer.state;
  } catch {
    pause();
    say("The guide does not answer: it has ended. Start it again with: usbench guide");
    return null;
  }
}

// The browser itself tells when it has shown the number of the step, which is drawn together with the frame.
new PerformanceObserver((shownTexts) => {
  for (const { identifier: since, renderTime } of shownTexts.getEntries()) {
    byId("latency").textContent = `${Math.round(renderTime - since)} ms`;
    byId("footer").hidden = false;
  }
}).observe({ type: "element" });

function say(sentence) {
  byId("alert").hidden = !sentence;
  if (byId("alert").textContent !== sentence) byId("alert").textContent = sentence;
}

const OVER = "The episode is over: begin a new one (N).";
function act(action, since) {
  if (busy || !shown.over) send("act", { action }, since);
  // Unless another tab has begun a new one.
  else send("state").then(() => say(shown.over ? OVER : shown.elsewhere));
}
// Another task or noise begins a new episode: ask before one that has begun is lost.
function change(choice, what) {
  // What is on its way may begin the episode that would be lost.
  if (waiting) return pending.then(() => change(choice, what));
  if (shown.over || !shown.step) return send("choose", choice);
  pause();
  byId("sure-words").textContent = `${what} begins a new episode: this one ends at step ${shown.step} of ${shown.n_steps}.`;
  byId("sure-yes").onclick = () => { byId("sure").close(); send("choose", choice); };
  byId("sure").showModal();
}
byId("sure-no").addEventListener("click", () => byId("sure").close());
byId("sure").addEventListener("close", () => renderSettings(shown));
const begin = () => { if (shown && !(shown.study && (!shown.over || shown.ended))) send("begin", {}); };
const follow = (since) => { if (shown?.advice && !shown.study) send("follow", {}, since); };

function play() {
  if (!shown || shown.study) return;
  if (playing !== null) return pause();
  if (!shown.advice && !shown.over) return;
  playing = setInterval(() => {
    if (waiting) return;
    if (shown.over || !shown.advice) pause();
    else send("follow", {});
  }, PLAY_MS);
  if (shown.over) begin();
  showPlaying();
}
function pause() {
  clearInterval(playing);
  playing = null;
  showPlaying();
}
function showPlaying() {
  byId("play").querySelector("span").textContent = playing === null ? "Play" : "Pause";
}

// Drawing ------------------------------------------------------------------------------------------------------

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function icon(name) {
  const template = byId("advice").querySelector("svg").cloneNode(true);
  template.firstElementChild.setAttribute("href", `#icon-${name}`);
  return template;
}

function options(id, entries, value) {
  const select = byId(id), text = JSON.stringify(entries);
  if (select.dataset.entries !== text) {
    select.dataset.entries = text;
    const groups = Map.groupBy(entries, (entry) => entry.group ?? "");
    select.replaceChildren(...[...groups].flatMap(([label, members]) => {
      const made = members.map((entry) => element("option", { value: entry.value }, entry.label));
      return label ? [element("optgroup", { label }, ...made)] : made;
    }));
  }
  select.value = value;
}

// `since` is when the key was pressed whose answer this is, if it was one.
function render(state, since) {
  const taskChanged = shown?.task !== state.task;
  shown = state;
  renderSettings(state);
  if (taskChanged) renderControls(state.controls);
  drawScene(PICTURES, state);
  renderFrame(state);
  renderAdvice(state);
  renderEpisode(state, since);
  renderTraining(state.training, state.untrained);
}

function renderSettings(state) {
  if (!state) return;
  options("task", Object.entries(state.tasks).map(([value, label]) => ({ value, label })), state.task);
  options("noise", state.noises.map((value) => ({ value: String(value), label: `${Number((100 * value).toPrecision(6))} %` })), String(state.noise));
  const group = (agent) => agent.task === null ? "Reference policy" : `Trained: ${state.tasks[agent.task]}`;
  options("agent", state.agents.map((agent) => ({ value: agent.name, label: agent.label, group: group(agent) })), state.agent);
  byId("hidden").checked = state.hidden;
  byId("study").textContent = state.study;
  for (const input of byId("settings").querySelectorAll("select, #hidden")) input.disabled = state.study !== "";
  byId("goal").textContent = state.goal;
}

function renderControls(controls) {
  byId("controls").replaceChildren(...controls.map((control, action) => {
    const button = element("button", { type: "button", "aria-keyshortcuts": control.key === " " ? "Space" : control.key },
      icon(control.icon), element("span", {}, control.name), element("kbd", {}, control.key_label));
    button.addEventListener("click", (event) => act(action, event.timeStamp));
    return button;
  }));
}

function renderFrame({ frame, shape: [height, width], frame_mm: [depthMm, widthMm], pose }) {
  const bytes = atob(frame), image = new ImageData(width, height);
  for (let i = 0; i < bytes.length; i += 1) image.data.fill(bytes.charCodeAt(i), 4 * i, 4 * i + 3);
  for (let i = 3; i < image.data.length; i += 4) image.data[i] = 255;
  const small = new OffscreenCanvas(width, height), canvas = byId("frame"), context = canvas.getContext("2d");
  small.getContext("2d").putImageData(image, 0, 0);
  context.imageSmoothingQuality = "high";
  context.drawImage(small, 0, 0, canvas.width, canvas.height);
  canvas.setAttribute("aria-label", `B-mode frame, ${widthMm} by ${depthMm} mm, focus at ${pose.focal_depth_mm} mm`);
}

function renderAdvice(state) {
  const { advice, controls, over, exact, label, study } = state;
  byId("adviser").textContent = exact ? "of the exact optimum, which knows the pose" : `of ${label}`;
  // At the end all keeps its place, so that no button moves away under a finger.
  byId("advice").hidden = !advice && !over;
  byId("silence").textContent = advice || over ? "" : state.study ? "No advice in this episode." : "No advice: choose an agent that fits the task.";
  byId("confidence-title").textContent = !advice ? "\u00a0" : CONFIDENCE[advice.kind];
  const words = advice?.words ?? "the episode is over";
  byId("advice").querySelector("use").setAttribute("href", advice ? `#icon-${advice.icon}` : "");
  byId("advice").querySelector("strong").textContent = words[0].toUpperCase() + words.slice(1);
  byId("confidence").replaceChildren(...(advice || over ? controls : []).map((control, action) => {
    const bar = element("i");
    bar.style.width = `${100 * (advice?.bars[action] ?? 0)}%`;
    const row = element("li", {}, element("span", {}, control.name),
      element("span", { class: "bar", "aria-hidden": "true" }, bar), element("b", {}, minus(advice?.texts[action] ?? "")));
    row.classList.toggle("best", action === advice?.action);
    return row;
  }));
  [...byId("controls").children].forEach((button, action) => {
    button.classList.toggle("advised", advice?.action === action);
    button.setAttribute("aria-disabled", String(over));
  });
  // A button that is disabled would lose the focus, and the space bar would move the probe.
  byId("follow").setAttribute("aria-disabled", String(!advice || study !== ""));
  byId("play").setAttribute("aria-disabled", String((!advice && !over) || study !== ""));
  byId("begin").setAttribute("aria-disabled", String(study !== "" && (!over || state.ended)));
}

const minus = (text) => text.replaceAll("-", "\u2212");

function renderEpisode(state, since) {
  const { pose, advice } = state;
  const timed = since === undefined ? {} : { elementtiming: since };
  byId("progress-words").replaceChildren(element("span", timed, `Step ${state.step} of ${state.n_steps}`));
  Object.assign(byId("steps"), { max: state.n_steps, value: state.step });
  byId("return").textContent = minus(state.return ?? "hidden");
  byId("optimum").textContent = minus(state.optimum ?? "hidden");
  byId("x").textContent = `${signed(pose.x_mm)} mm`;
  byId("z").textContent = `${pose.focal_depth_mm} mm`;
  byId("angle").textContent = `${pose.angle_deg}°`;
  const goal = state.at_goal && !state.over ? " The probe is at the goal: hold it there." : "";
  const next = advice ? ` Advice: ${advice.words}.` : "";
  byId("status").textContent = `${state.happened}${goal}${next}`;
  byId("percent").textContent = minus(state.percent);
  byId("verdict").textContent = minus(state.verdict);
  byId("status").append(element("span", { class: "unseen" }, minus(` ${state.percent} ${state.verdict}`)));
  byId("outcome").classList.toggle("success", state.at_goal === true);
  byId("legend-body").hidden = !state.balls.length && !state.target;
  byId("legend-body").textContent = state.target ? "image plane of the target" : "body of the object";
  byId("legend-limb").hidden = !state.balls.length;
  byId("begin").classList.toggle("primary", state.over);
}

function renderTraining(training, untrained) {
  const running = training.status === "running", failed = training.status === "failed" && training.task === shown.task;
  byId("training").hidden = shown.study !== "" || !(untrained || training.offered || running || failed);
  byId("train").hidden = running || !training.offered;
  byId("training-bar").hidden = !running;
  byId("training-bar").value = training.step / training.steps;
  byId("training-words").textContent = running
    ? `Training on ${shown.tasks[training.task]}: step ${training.step} of ${training.steps}. Meanwhile ${shown.label} advises.`
    : failed ? `Training failed: ${training.reason}` : untrained || "Or train one of your own: dqn, some minutes in the background.";
  if (running) poll ??= setTimeout(() => { poll = undefined; send("update", {}); }, POLL_MS);
}

// Hands --------------------------------------------------------------------------------------------------------

const shortcuts = { a: follow, p: play, n: begin };
document.addEventListener("keydown", (event) => {
  const { key, target } = event, name = key.length === 1 ? key.toLowerCase() : key;
  if (!shown || busy || byId("sure").open || !byId("keys").checked || event.ctrlKey || event.altKey || event.metaKey) return;
  if (target.matches("select") || (key === " " && target.matches("button, input"))) return;
  const action = shown.controls.findIndex((control) => control.key === name);
  if (action < 0 && !(name in shortcuts)) return;
  event.preventDefault();
  if (event.repeat && waiting) return;
  if (action >= 0) act(action, event.timeStamp);
  else shortcuts[name](event.timeStamp);
});
// Who chooses with the mouse goes on with the probe's keys, not with those of the list.
let byMouse = false;
document.addEventListener("pointerdown", () => { byMouse = true; }, true);
document.addEventListener("keydown", () => { byMouse = false; }, true);
byId("settings").addEventListener("change", (event) => { if (byMouse) event.target.blur(); });
// A click leaves the focus where it is, so that the space bar still means "stay".
document.querySelector(".moves").addEventListener("mousedown", (event) => event.preventDefault());
byId("follow").addEventListener("click", (event) => follow(event.timeStamp));
byId("play").addEventListener("click", play);
byId("begin").addEventListener("click", begin);
byId("train").addEventListener("click", () => {
  byId("training-words").focus(); // the button will be gone
  send("train", {});
});
byId("task").addEventListener("change", (event) => change({ task: event.target.value }, "The other task"));
byId("noise").addEventListener("change", (event) => change({ noise: Number(event.target.value) }, "Another noise"));
byId("agent").addEventListener("change", (event) => send("choose", { agent: event.target.value }));
byId("hidden").addEventListener("change", (event) => send("choose", { hidden: event.target.checked }));
byId("settings").addEventListener("submit", (event) => event.preventDefault());
// Another tab may have moved the same probe meanwhile.
document.addEventListener("visibilitychange", () => { if (!document.hidden) send("state"); });
send("state");
