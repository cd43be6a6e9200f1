"use strict";
// The study's page: welcome, then for each trial a pause and the three pictures against the clock, then saving.
// All that happened stands in `state`, which is kept in the browser after each change, so that a reload goes on there.
(() => {
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const byId = new Map(data.stimuli.map((one) => [one.id, one]));
const KEY = `fog-study:${data.build}`;
const ALLOWED = data.seconds * 1000;
const LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ23456789";

// ---- chance -----------------------------------------------------------------------------------
const coin = () => crypto.getRandomValues(new Uint8Array(1))[0] & 1;
function below(n) {  // evenly: what would favour small numbers is drawn again
  const most = 2 ** 32 - 2 ** 32 % n;
  for (;;) { const x = crypto.getRandomValues(new Uint32Array(1))[0]; if (x < most) return x % n; }
}
function shuffled(list) {
  const out = [...list];
  for (let i = out.length - 1; i > 0; i--) { const j = below(i + 1); [out[i], out[j]] = [out[j], out[i]]; }
  return out;
}
// Practice first; the order is drawn anew for each participant, and for each trial which of its pair is A.
function plan() {
  const part = (practice) => shuffled(data.stimuli.filter((one) => one.practice === practice));
  return [...part(true), ...part(false)].map((one) => ({ id: one.id, swapped: coin() }));
}
const code = () => Array.from({ length: 8 }, () => LETTERS[below(LETTERS.length)]).join("").replace(/(....)/, "$1-");

// ---- what is kept -----------------------------------------------------------------------------
const fresh = () => ({ participant: code(), plan: plan(), trials: [], begun: false, running: null });
let keeps = true;
function restored() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEY));
    const sound = kept && Array.isArray(kept.plan) && Array.isArray(kept.trials) && typeof kept.participant === "string" &&
      kept.trials.length <= kept.plan.length && kept.plan.length === data.stimuli.length && kept.plan.every((one) => byId.has(one.id));
    return sound ? kept : null;
  } catch (error) { return null; }
}
function keep() {
  try { localStorage.setItem(KEY, JSON.stringify(state)); } catch (error) { keeps = false; }
}
let state = restored() || fresh();
keep();

// ---- screens ----------------------------------------------------------------------------------
function show(id) {
  for (const one of document.querySelectorAll("main")) one.hidden = one.id !== id;
  const heading = $(id).querySelector("h1");
  if (heading) heading.focus({ preventScroll: true });
  window.scrollTo(0, 0);
}
const nowTrial = () => byId.get(state.plan[state.trials.length].id);
const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
const practised = data.stimuli.filter((one) => one.practice).length;
const questionOf = (stimulus) => stimulus.true_is === "photograph"
  ? "Which one is the real foggy photograph?" : "Which one is the rendered truth?";

function welcome() {
  const kinds = new Set(data.stimuli.map((one) => one.true_is));
  const say = [];
  if (kinds.has("photograph")) say.push("The other one is a real photograph, taken in fog.");
  if (kinds.has("rendered truth")) say.push((kinds.size > 1 ? "Or the" : "The") +
    " other one is the rendered truth: the whole scene was computed with the fog in it.");
  $("kinds").textContent = say.join(" ");
  for (const one of document.querySelectorAll(".allowed")) one.textContent = data.seconds;
  $("count").textContent = plural(data.stimuli.length - practised, "trial") + (practised ? `, and ${practised} to practise before` : "");
  $("code").textContent = state.participant;
  $("unsaved").hidden = keeps;
  show("welcome");
}

function advance(outcome) {
  if (state.trials.length === state.plan.length) return end();
  const stimulus = nowTrial(), done = state.trials.length;
  $("progress").textContent = stimulus.practice ? `Practice ${done + 1} of ${practised}` :
    `Trial ${done - practised + 1} of ${data.stimuli.length - practised}`;
  $("next").textContent = state.running ? "You were in the middle of this one" : stimulus.practice ? "To practise" :
    done === practised ? (practised ? "Now in earnest" : "The first one") : "Ready for the next?";
  $("asked").textContent = questionOf(stimulus);
  $("outcome").textContent = outcome || "";
  show("ready");
}

// ---- a trial ----------------------------------------------------------------------------------
// `running` is what must outlive a reload: milliseconds seen, milliseconds and times hidden, reloads.
let ticking = null, last = 0, hiddenSince = null, warned = false;
const images = ["clear", "a", "b"].map((id) => $(id).querySelector("img"));

async function trial() {
  const stimulus = nowTrial(), { swapped } = state.plan[state.trials.length];
  const [first, second] = swapped ? [stimulus.pair[1], stimulus.pair[0]] : stimulus.pair;
  if (state.running) state.running.reloads += 1;
  else state.running = { seen: 0, hidden: 0, times_hidden: 0, reloads: 0 };
  keep();
  $("question").textContent = questionOf(stimulus);
  $("pictures").classList.add("wait");
  $("pick_a").disabled = $("pick_b").disabled = true;
  warned = false;
  images.forEach((image, k) => { image.src = data.pictures[[stimulus.clear, first, second][k]]; });
  show("trial");
  draw(ALLOWED - state.running.seen);
  await Promise.all(images.map((image) => image.decode().catch(() => undefined)));
  layout();
  $("pictures").classList.remove("wait");
  $("pick_a").disabled = $("pick_b").disabled = false;
  // two frames on, the pictures are on the screen; a hidden tab draws none
  const start = () => { last = performance.now(); hiddenSince = document.hidden ? last : null; ticking = setInterval(tick, 50); };
  if (document.hidden) start(); else requestAnimationFrame(() => requestAnimationFrame(start));
}

function spend() {  // the time since the last look, to what it was
  const now = performance.now();
  if (hiddenSince === null) state.running.seen += now - last; else state.running.hidden += now - last;
  last = now;
}
let kept = 0;
function tick() {
  if (ticking === null) return;
  spend();
  const left = ALLOWED - state.running.seen;
  draw(left);
  if (left <= 0) return answered(null);
  if (!warned && left <= 5000 && ALLOWED > 5000) { warned = true; $("spoken").textContent = "5 seconds left"; }
  if (Math.abs(last - kept) > 500) { kept = last; keep(); }
}
function draw(left) {
  $("left").textContent = `${Math.max(0, Math.ceil(left / 1000))} s`;
  $("bar").style.transform = `scaleX(${Math.min(1, Math.max(0, left / ALLOWED))})`;
}
// A page that is left, or loaded again, is no hidden one; where the browser brings it back as it was, it was away meanwhile.
let leaving = false;
document.addEventListener("visibilitychange", () => {
  if (ticking === null || leaving) return;
  spend();
  if (document.hidden) { hiddenSince = last; state.running.times_hidden += 1; } else hiddenSince = null;
  keep();
});
window.addEventListener("pagehide", () => { leaving = true; if (ticking !== null) { spend(); hiddenSince = last; keep(); } });
window.addEventListener("pageshow", () => { if (leaving && ticking !== null) { spend(); hiddenSince = null; } leaving = false; });

const odd = (x) => { let n = 0; for (; x > 0; x = Math.floor(x / 2)) n += x % 2; return n % 2; };
function answered(answer) {
  if (ticking === null) return;
  if (answer !== null) spend();
  if (answer !== null && state.running.seen >= ALLOWED) answer = null;
  clearInterval(ticking);
  ticking = null;
  const stimulus = nowTrial(), { swapped } = state.plan[state.trials.length], { seen, hidden, times_hidden, reloads } = state.running;
  const size = images[1].getBoundingClientRect();
  state.trials.push({
    order: state.trials.length + 1, practice: stimulus.practice, stimulus: stimulus.id, scene: stimulus.scene, fog: stimulus.fog,
    density: stimulus.density, true_is: stimulus.true_is, true_side: odd(stimulus.mark) === swapped ? "A" : "B", answer,
    timed_out: answer === null, milliseconds: Math.min(Math.round(seen), Math.round(ALLOWED)), hidden_milliseconds: Math.round(hidden), times_hidden, reloads,
    viewport: [window.innerWidth, window.innerHeight], shown: [Math.round(size.width), Math.round(size.height)],
    pixel_ratio: Math.round(window.devicePixelRatio * 100) / 100 });
  state.running = null;
  keep();
  images.forEach((image) => image.removeAttribute("src"));
  $("spoken").textContent = "";
  advance(answer === null ? "The time was over; that happens." : `You chose ${answer}.`);
}

// The arrangement in which A and B are largest; both have the same size, and the clear one that or a smaller one.
function layout() {
  const area = $("pictures"), [, image] = images, ratio = image.naturalWidth / image.naturalHeight || 1;
  const width = area.clientWidth, height = area.clientHeight, gap = 8, caption = 22;
  const within = (w, h) => Math.max(1, Math.min(w, h * ratio, 2 * image.naturalWidth));
  const row = within((width - 2 * gap) / 3, height - caption);
  const column = within(width, (height - 2 * gap) / 3 - caption);
  let two = within((width - gap) / 2, (height - gap) * 0.58 - caption);
  const over = within(Math.min(two, width), height - gap - 2 * caption - two / ratio);
  const best = row >= Math.max(column, two) ? ["row", row, row] : column >= two ? ["column", column, column] : ["two", two, over];
  area.className = area.className.replace(/\b(row|column|two)\b/g, "").trim();
  area.classList.add(best[0]);
  images.forEach((one, k) => { const w = Math.floor(k ? best[1] : best[2]); one.style.width = `${w}px`; one.style.height = `${Math.round(w / ratio)}px`; });
}
window.addEventListener("resize", () => { if (!$("trial").hidden) layout(); });

// ---- the end ----------------------------------------------------------------------------------
function answers() {
  return JSON.stringify({ format: data.format, version: data.version, study: data.digest, page: data.build,
    participant: state.participant, seconds_allowed: data.seconds, trials: state.trials }, null, 1) + "\n";
}
function end() {
  const late = state.trials.filter((one) => one.timed_out).length;
  $("told").textContent = `That was all: ${plural(state.trials.length, "trial")}, ${late ? plural(late, "time") + " without an answer" : "each answered"}. ` +
    `Your code is ${state.participant}.`;
  $("text").value = answers();
  show("end");
}
function save() {
  const link = document.createElement("a"), url = URL.createObjectURL(new Blob([answers()], { type: "application/json" }));
  link.href = url;
  link.download = `answers-${state.participant}.json`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
  $("saved").textContent = `Saved as ${link.download}, where this browser puts its downloads.`;
}

// ---- hands ------------------------------------------------------------------------------------
$("begin").addEventListener("click", () => { state.begun = true; keep(); advance(); });
$("show").addEventListener("click", trial);
$("pick_a").addEventListener("click", () => answered("A"));
$("pick_b").addEventListener("click", () => answered("B"));
$("save").addEventListener("click", save);
$("anew").addEventListener("click", () => { state = fresh(); keep(); welcome(); });
document.addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
  const key = event.key.toLowerCase(), shown = document.querySelector("main:not([hidden])").id;
  if (shown === "trial") {
    const answer = { a: "A", arrowleft: "A", b: "B", arrowright: "B" }[key];
    if (answer) { event.preventDefault(); answered(answer); }
  } else if (key === " " && (shown === "ready" || shown === "welcome") && !event.target.closest("button, summary")) {
    event.preventDefault();
    $(shown === "ready" ? "show" : "begin").click();
  }
});
window.study = Object.freeze({ plan });  // for tests of chance; it draws anew and says nothing of this participant

if (!state.begun) welcome(); else advance(state.running ? "The page was loaded again; the time goes on where it was." : "");
})();
