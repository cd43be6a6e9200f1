"use strict";
// The annotation page in the browser: keys, which drags move a point and which the view, and panels as the server sends them.
// Bokeh draws, zooms, pans, drags points and keeps the models below alike in browser and server; what a person does otherwise goes
// to the server as a command in `wire.asked`, and what it means is decided there (pipeline/annotate/page/page.py).
(() => {
const $ = (id) => document.getElementById(id);
const scene = document.body.dataset.scene, WIDTH = +document.body.dataset.width, HEIGHT = +document.body.dataset.height;
const base = location.pathname.replace(/[^/]*$/, "");
const stage = $("stage");
let model, view, count = 0, fitted = true;

const send = (command) => { annotate.acted = performance.now(); model.wire.asked = JSON.stringify({ ...command, n: ++count }); };

// ---- panels ------------------------------------------------------------------------------------
const shownPanels = {};
const busy = (element) => {  // text that is being typed, or a slider that is held, is not replaced under the hand
  const one = document.activeElement;
  return element.contains(one) && (one.type === "range" ? one.matches(":active") : one.type === "text" && one.value !== one.defaultValue);
};
function showPanels() {
  for (const [id, html] of Object.entries(model.wire.panels)) {
    const element = $(id);
    if (!element || shownPanels[id] === html || busy(element)) continue;
    const one = element.contains(document.activeElement) ? document.activeElement : null;
    const again = one && (one.id ? `#${CSS.escape(one.id)}` : one.dataset.do ? `[data-do="${one.dataset.do}"]` +
      ["place", "kind", "name", "value"].map((key) => one.dataset[key] ? `[data-${key}="${CSS.escape(one.dataset[key])}"]` : "").join("") : null);
    element.innerHTML = shownPanels[id] = html;
    if (again) element.querySelector(again)?.focus({ preventScroll: true });
    if (id === "things") element.querySelector(".thing.on")?.scrollIntoView({ block: "nearest" });
  }
}
function commandOf(element, value) {
  const { do: todo, set, place, kind, name, value: stated } = element.dataset;
  const command = { do: todo || set };
  if (place) command.place = JSON.parse(place);
  if (kind) command.kind = kind;
  if (name) command.name = name;
  if (value !== undefined || stated !== undefined) command.value = value === undefined ? stated : value;
  return command;
}
document.addEventListener("click", (event) => {
  const element = event.target.closest("[data-do]");
  if (element) { send(commandOf(element)); if (element.dataset.do === "add") stage.focus({ preventScroll: true }); }
  const zoom = event.target.closest("[data-zoom]");
  if (zoom) zoomBy(zoom.dataset.zoom);
});
document.addEventListener("change", (event) => {
  const element = event.target;
  if (element.dataset.set) { if (element.type === "text") element.defaultValue = element.value; send(commandOf(element, element.type === "checkbox" ? element.checked : element.value)); }
  if (element.dataset.slide) send({ do: "slid", name: element.dataset.slide, value: element.value });
});
document.addEventListener("focusout", () => setTimeout(showPanels));

// ---- sliders: what is shown follows at once, the picture as fast as the server makes it ---------
const slid = new Map();
document.addEventListener("input", (event) => {
  const element = event.target;
  if (!element.dataset.slide) return;
  const { least, most, log, unit } = element.dataset, share = element.value / element.max;
  const value = +log ? least * (most / least) ** share : +least + (most - least) * share;
  element.previousElementSibling.textContent = `${+value.toPrecision(3)}${unit ? ` ${unit}` : ""}`;
  if (!slid.size) requestAnimationFrame(() => { const began = annotate.acted; for (const command of slid.values()) send(command); slid.clear(); annotate.acted = began; });
  slid.set(element.dataset.slide, { do: "slide", name: element.dataset.slide, value: element.value });
  annotate.acted = performance.now();
});

// ---- the picture -------------------------------------------------------------------------------
let wanted = "", held = false, result = 0;
const addresses = () => ({ clear: `${base}picture/${scene}/clear`, fog: `${base}picture/${scene}/fog/${model.wire.picture}`,
                           result: `${base}picture/${scene}/result/${result}` });
async function showPicture() {
  const which = held || (model.wire.view === "fog" && !model.wire.picture) ? "clear" : model.wire.view;
  const url = addresses()[which];
  for (const button of document.querySelectorAll('[data-do="view"]')) button.classList.toggle("on", button.dataset.value === which);
  if (url === wanted) return;
  wanted = url;
  const image = new Image();
  image.src = url;
  // decoded before Bokeh is told, so that nothing flickers; an older one that comes late is left out
  try { await image.decode(); } catch (error) { if (which !== "clear") { wanted = ""; held = false; model.wire.view = "clear"; } return; }
  if (url !== wanted) return;
  model.picture.data = { url: [url] };
  requestAnimationFrame(() => requestAnimationFrame(() => { annotate.shown = { url, at: performance.now(), count: annotate.shown.count + 1 }; }));
}

// ---- zoom and pan ------------------------------------------------------------------------------
const size = () => [view.frame.bbox.width, view.frame.bbox.height];
function setView(x, y, scale) {  // middle in the photograph's pixels, photograph's pixels a screen pixel
  const [w, h] = size();
  model.plot.x_range.setv({ start: x - scale * w / 2, end: x + scale * w / 2 });
  model.plot.y_range.setv({ start: y + scale * h / 2, end: y - scale * h / 2 });
}
function now() {
  const { x_range: x, y_range: y } = model.plot;
  return [(x.start + x.end) / 2, (y.start + y.end) / 2, (x.end - x.start) / size()[0]];
}
const whole = () => Math.max(WIDTH / size()[0], HEIGHT / size()[1]) * 1.04;
function fit() { setView(WIDTH / 2, HEIGHT / 2, whole()); fitted = true; }
function zoomBy(how) {
  if (how === "fit") { fit(); return; }
  const [x, y, scale] = now();
  setView(x, y, scale * (how === "in" ? 1 / 1.4 : 1.4));
  fitted = false;
}
function resized() {
  if (fitted) { fit(); return; }
  const [x, y, scale] = model.kept;
  setView(x, y, scale);
}

// ---- drags: on a point they move it, elsewhere the view -----------------------------------------
function pointAt(event) {
  const box = view.el.getBoundingClientRect(), { x, y } = model.handles.data;
  const reach = event.pointerType === "touch" ? 24 : 12;
  let best = -1, least = reach;
  for (let i = 0; i < x.length; i++) {
    const far = Math.hypot(view.frame.x_scale.compute(x[i]) - (event.clientX - box.left), view.frame.y_scale.compute(y[i]) - (event.clientY - box.top));
    if (far <= least) { best = i; least = far; }
  }
  return best;
}
let grasped = -1;
function grasp(event) {
  if (event.target.closest && event.target.closest("#zoom, #brush-size")) return;
  if (brushing()) { beginStroke(event); return; }
  grasped = pointAt(event);
  if (grasped >= 0) { model.handles.selected.indices = [grasped]; model.move.active = true; } else model.pan.active = true;
}
function release() {
  if (stroke) { endStroke(); return; }
  annotate.acted = performance.now();
  if (grasped >= 0) { const index = grasped; setTimeout(() => { if (index < model.handles.data.x.length) model.handles.selected.indices = [index]; }); }
  grasped = -1;
}
function follow() {  // the line through the points, while they are dragged
  const x = Array.from(model.handles.data.x), y = Array.from(model.handles.data.y), line = model.active.data;
  if (line.xs.length) {
    const closed = line.xs[0].length === x.length + 1;
    model.active.data = { xs: [closed ? [...x, x[0]] : x], ys: [closed ? [...y, y[0]] : y] };
  }
  if (model.names.data.x.length === x.length) model.names.data = { ...model.names.data, x, y };
}

// ---- brush: what a stroke covers becomes part of a region's outline, in the server ----------------
const strokes = $("strokes"), brush = $("brush"), MOST_STROKE = 1000;
let stroke = null, pointer = null;
const brushing = () => model && model.wire.brush !== "off";
const radius = () => brush.value * now()[2] / 2;  // the photograph's pixels
function inPhotograph(event) {
  const box = view.el.getBoundingClientRect();
  return [view.frame.x_scale.invert(event.clientX - box.left), view.frame.y_scale.invert(event.clientY - box.top)];
}
function beginStroke(event) {
  // neither Bokeh's pan nor its taps
  event.stopPropagation();
  event.preventDefault();
  if (event.button !== 0 || !event.isPrimary) return;
  stage.focus({ preventScroll: true });
  stroke = [inPhotograph(event)];
  drawStroke();
}
function moveStroke(event) {
  pointer = brushing() && stage.contains(event.target) ? event : null;
  if (stroke) {
    for (const one of event.getCoalescedEvents?.() ?? [event]) {
      const [x, y] = inPhotograph(one), [u, v] = stroke[stroke.length - 1];
      if (Math.hypot(x - u, y - v) >= radius() / 4 && stroke.length < MOST_STROKE) stroke.push([x, y]);
    }
    event.stopPropagation();
  }
  if (brushing() || strokes.drawn) requestAnimationFrame(drawStroke);
}
function endStroke() {
  const points = stroke.map(([x, y]) => [+x.toFixed(1), +y.toFixed(1)]);
  stroke = null;
  send({ do: "stroke", points, radius: +radius().toFixed(2) });
  setTimeout(drawStroke, 150);  // until the outline follows
}
function drawStroke() {
  const box = stage.getBoundingClientRect(), pen = strokes.getContext("2d"), ratio = window.devicePixelRatio || 1;
  strokes.width = box.width * ratio; strokes.height = box.height * ratio;
  strokes.drawn = false;
  pen.scale(ratio, ratio);
  if (stroke) {
    const off = view.el.getBoundingClientRect();
    pen.strokeStyle = model.wire.brush === "erase" ? "#101010" : "#ffcf33";
    pen.globalAlpha = 0.45; pen.lineWidth = +brush.value; pen.lineCap = pen.lineJoin = "round";
    pen.beginPath();
    stroke.forEach(([x, y], i) => { const at = [view.frame.x_scale.compute(x) + off.left - box.left, view.frame.y_scale.compute(y) + off.top - box.top];
      if (i) pen.lineTo(...at); else { pen.moveTo(...at); pen.lineTo(at[0] + 0.01, at[1]); } });
    pen.stroke();
    pen.globalAlpha = 1;
    strokes.drawn = true;
  }
  if (pointer && brushing()) {
    for (const [colour, wide] of [["#101010", 3], ["#ffffff", 1.2]]) {
      pen.strokeStyle = colour; pen.lineWidth = wide;
      pen.beginPath();
      pen.arc(pointer.clientX - box.left, pointer.clientY - box.top, brush.value / 2, 0, 2 * Math.PI);
      pen.stroke();
    }
    strokes.drawn = true;
  }
}
function showBrush() {
  stage.classList.toggle("brushing", brushing());
  $("brush-size").hidden = !brushing();
  if (!brushing()) stroke = null;
  drawStroke();
}
function resizeBrush(by) { brush.value = Math.round(brush.value * (by > 0 ? 1.25 : 0.8) + by); drawStroke(); }

// ---- keys ---------------------------------------------------------------------------------------
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
let moved = null;
function arrow(event) {
  const [dx, dy] = ARROWS[event.key], far = event.shiftKey ? 10 : 1, [index] = model.handles.selected.indices;
  if (index === undefined) {
    const [x, y, scale] = now();
    setView(x + 40 * dx * scale, y + 40 * dy * scale, scale);
    fitted = false;
    return;
  }
  const x = Array.from(model.handles.data.x), y = Array.from(model.handles.data.y);
  x[index] += dx * far; y[index] += dy * far;
  // shown at once, told to the server when the keys rest
  model.handles.data.x = x; model.handles.data.y = y;
  model.handles.change.emit();
  clearTimeout(moved);
  moved = setTimeout(settle, 250);
}
function settle() {
  if (moved === null) return;
  clearTimeout(moved);
  moved = null;
  // the data were changed in place, so that Bokeh sees no difference by itself
  model.handles.setv({ data: { x: Array.from(model.handles.data.x), y: Array.from(model.handles.data.y) } }, { check_eq: false });
}
function nextPoint(by) {
  const many = model.handles.data.x.length, [index] = model.handles.selected.indices;
  if (many) model.handles.selected.indices = [index === undefined ? (by > 0 ? 0 : many - 1) : (index + by + many) % many];
}
const KEYS = { Enter: { do: "finish" }, Escape: { do: "cancel" }, Delete: { do: "delete" }, Backspace: { do: "delete" }, n: { do: "here" },
  i: { do: "insert" }, ",": { do: "walk", by: -1 }, ".": { do: "walk", by: 1 } };
document.addEventListener("keydown", (event) => {
  if (model && (event.key === "Enter" || event.key === "Escape") && event.target.matches("aside input[type=text]")) {
    if (event.key === "Escape") event.target.value = event.target.defaultValue;
    event.target.blur();  // which sends what was typed; keys then draw again
    stage.focus({ preventScroll: true });
    event.preventDefault();
    return;
  }
  if (!model || event.target.closest("input:not([type=range]), select, textarea, dialog[open]")) return;
  const key = event.key, low = key.length === 1 ? key.toLowerCase() : key;
  if (event.target.closest("button, summary") && (key === "Enter" || key === " ")) return;
  if (event.target.type === "range" && ARROWS[key]) return;
  if (event.ctrlKey || event.metaKey) {
    if (low === "z" || low === "y") { settle(); send({ do: low === "y" || event.shiftKey ? "redo" : "undo" }); event.preventDefault(); }
    if (low === "s") { settle(); send({ do: "save" }); event.preventDefault(); }
    return;
  }
  if (event.altKey) return;
  if (ARROWS[key]) { arrow(event); event.preventDefault(); return; }
  if (key === "+" || key === "=") zoomBy("in");
  else if (key === "-" || key === "−") zoomBy("out");
  else if (key === "0") fit();
  else if (key === "?") $("help").showModal();
  else if ((key === "[" || key === "]") && brushing()) resizeBrush(key === "]" ? 1 : -1);
  else if (key === "[" || key === "]") nextPoint(key === "]" ? 1 : -1);
  else if (low === "q") send({ do: "brush", value: brushing() ? "off" : "add" });
  else if (low === "v") send({ do: "view", value: model.wire.view === "clear" ? "fog" : "clear" });
  else if (key === " ") { held = true; showPicture(); event.preventDefault(); }
  else if (KEYS[low]) { settle(); send(KEYS[low]); event.preventDefault(); }
  else for (const button of document.querySelectorAll("#add button"))
    if (button.querySelector("kbd")?.textContent.toLowerCase() === low && !button.disabled) { button.click(); event.preventDefault(); }
});
document.addEventListener("keyup", (event) => { if (event.key === " " && held) { held = false; showPicture(); } });

// ---- files --------------------------------------------------------------------------------------
$("help-button").addEventListener("click", () => $("help").showModal());
$("more").addEventListener("click", () => $("files").showModal());
async function upload(query, file) {
  $("upload-said").textContent = "sending …";
  try {
    const answer = await fetch(`${base}upload?${new URLSearchParams(query)}`, { method: "POST", body: file });
    const said = await answer.json().catch(() => ({ error: answer.status === 413 ? "that file is too large" : `refused (${answer.status})` }));
    $("upload-said").textContent = said.error || "";
    return said.error ? null : said;
  } catch (error) { $("upload-said").textContent = "the server does not answer, or the file is too large"; return null; }
}
$("upload").addEventListener("submit", async (event) => {
  event.preventDefault();
  const said = await upload({ what: "photograph", name: $("new-name").value }, $("new-photo").files[0]);
  if (said) location.search = new URLSearchParams({ scene: said.scene });
});
$("label-upload").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await upload({ what: "labels", scene }, $("label-file").files[0])) $("files").close();
});
$("import").addEventListener("submit", async (event) => {
  event.preventDefault();
  const said = await upload({ what: "annotations", scene }, $("import-file").files[0]);
  if (said) $("upload-said").textContent = said.said.join("; ");
});

// ---- the beginning ------------------------------------------------------------------------------
const annotate = window.annotate = { shown: { url: "", at: 0, count: 0 }, acted: 0,
  // where a point of the photograph is on the screen
  where: (x, y) => { const box = view.el.getBoundingClientRect(); return [box.left + view.frame.x_scale.compute(x), box.top + view.frame.y_scale.compute(y)]; } };
function begin() {
  const doc = window.Bokeh?.documents?.[0];
  const plot = doc?.get_model_by_name("plot");
  const found = plot && [...window.Bokeh.index].find((one) => one.model === plot);
  if (!found || !doc.get_model_by_name("wire") || !found.frame?.bbox.width) { setTimeout(begin, 20); return; }
  view = found;
  model = { plot };
  for (const name of ["wire", "picture", "handles", "active", "names", "move", "pan"]) model[name] = doc.get_model_by_name(name);
  model.wire.properties.panels.change.connect(showPanels);
  model.wire.properties.brush.change.connect(showBrush);
  for (const name of ["picture", "view"]) model.wire.properties[name].change.connect(showPicture);
  model.handles.change.connect(follow);
  model.handles.properties.data.change.connect(() => { clearTimeout(moved); moved = null; });
  stage.addEventListener("pointerdown", grasp, true);
  window.addEventListener("pointerup", release, true);
  window.addEventListener("pointercancel", release, true);
  window.addEventListener("pointermove", moveStroke, true);
  stage.addEventListener("wheel", () => { fitted = false; }, { passive: true });
  stage.addEventListener("pointerdown", () => { fitted = false; });
  for (const range of [plot.x_range, plot.y_range]) range.change.connect(() => { model.kept = now(); });
  new ResizeObserver(() => requestAnimationFrame(resized)).observe(stage);
  fit();
  model.kept = now();
  showPanels();
  showPicture();
  showBrush();
  doc.on_event("connection_lost", () => { $("gone").hidden = false; });
  annotate.ready = true;
}
begin();
})();
