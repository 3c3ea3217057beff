// The page of `view`: recordings over time and over the gait cycle, from the process that has read them.
import { Source } from "./source.js";
import { axisLabel, StrideChart, swatch, TimeChart, timeText } from "./charts.js";
import { Timeline } from "./timeline.js";
import { png, svg } from "./picture.js";
import { capital, element, number } from "./text.js";

const FIRST = ["position", "torque"];  // of actuators, plotted at the start
const FIRST_LIMIT = 4;                 // plots at the start where there is none of these
const LOG_LIMIT = 500;                 // events that are listed
const SHORTEST = 0.02;                 // s, of a window
const TELL_PERIOD = 400;               // ms after the last movement, until a screen reader is told
const EVENT_SPAN = 10;                 // s around an event, when the whole recording was shown
const RECONNECT_PERIOD = 1000;         // ms
const SIDES = /^(.*), (left|right)$/;

const $ = (id) => document.getElementById(id);
const answers = new Map();             // {id of a question: function of its answer}
const world = { begin: 0, end: 1, first: 0, last: 1, lines: [], gaps: [], preview: [] };
let socket = null, sources = [], charts = new Map(), shown = new Set(), legs = [], ids = 0, cursor = null, drawing = 0, telling = 0;
let hello = "", strideQuestion = "", averages = null;

const timeline = new Timeline($("track"), world, show, go);
const watcher = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) for (const chart of charts.values())
    if (chart.frame.card === target) chart.visible = isIntersecting;
  redraw();
}, { rootMargin: "200px" });

// Link

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => { if (typeof data === "string") take(JSON.parse(data)); else takeWindow(data); };
  socket.onclose = () => {
    alarm("No link to the process that reads the recordings. If it has ended, start `view` again in a terminal.");
    setTimeout(connect, RECONNECT_PERIOD);
  };
}

function alarm(text) {
  $("alarm").textContent = text;
  $("alarm").hidden = !text;
}

function ask(question, then) {
  if (socket.readyState !== WebSocket.OPEN) return;
  answers.set(ids += 1, then);
  socket.send(JSON.stringify({ ...question, id: ids }));
}

function take(message) {
  if (message.type === "hello") takeLink(message.recordings);
  else if (message.type === "progress") takeProgress(message.shares);
  else if (message.type === "average") { answers.get(message.id)(message); answers.delete(message.id); }
}

function takeWindow(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let place = 4 + length;
  const doubles = (count) => { const made = new Float64Array(buffer, place, count); place += 8 * count; return made; };
  const pieces = [];
  for (const { signals, size, step, count } of head.pieces) {
    const time = doubles(count), parts = ["low", "high", "broken"].map((name) => [name, signals.map(() => doubles(count))]);
    signals.forEach((signal, index) => pieces.push({ signal, size, step, time, ...Object.fromEntries(parts.map(([name, all]) => [name, all[index]])) }));
  }
  answers.get(head.id)(head, pieces);
  answers.delete(head.id);
}

function takeProgress(shares) {
  shares.forEach((share, index) => { sources[index].share = share; });
  const least = shares.reduce((sum, share) => sum + share, 0) / shares.length;
  $("loading").value = least;
  $("loading").hidden = least >= 1;
  redraw();
}

// Recordings

// Begin, or continue after a lost link: the answers that were due will not come.
function takeLink(recordings) {
  const text = JSON.stringify(recordings);
  if (hello && hello !== text) { location.reload(); return; }
  alarm(recordings.flatMap((each) => [each.trouble, each.unverified ? `${each.unverified} ticks of ${each.file} are not verified by a checksum` : ""])
    .filter(Boolean).map(capital).join("\n"));
  if (!hello) takeHello(recordings);
  hello = text;
  answers.clear();
  strideQuestion = "";
  for (const source of sources) source.busy = false;
  wantStrides();
}

function takeHello(recordings) {
  sources = recordings.map((recording, index) => new Source(index, recording, ask));
  const [first] = recordings, several = recordings.length > 1;
  const names = [...new Set(recordings.map((recording) => recording.name.replaceAll("_", " ")))].join(", ");
  document.title = `${several ? `${recordings.length} recordings` : first.file} – Tickwork`;
  $("name").textContent = names;
  $("kind").textContent = several ? recordings.map((recording) => recording.label).join(", ") : first.file;
  const facts = [["length", [...new Set(recordings.map((each) => timeText(each.end - each.begin, each.end - each.begin < 60 ? 1 : 0)))].join(", ")],
    ["rate", [...new Set(recordings.map((each) => `${number(each.rate, 0)} Hz`))].join(", ")],
    ["robot", [...new Set(recordings.map((each) => (each.simulated ? "simulation" : "robot")))].join(", ")]];
  if (!several) {
    if (first.began) facts.push(["recorded", new Date(first.began).toLocaleString([], { dateStyle: "medium", timeStyle: "short" })]);
    for (const [name, value] of Object.entries(first.fields)) facts.push([name.replaceAll("_", " "), value]);
  }
  $("facts").replaceChildren(...facts.map(([name, value]) => element("div", {}, element("dt", {}, name), element("dd", {}, value))));
  showEnd(recordings);
  buildTrials(recordings);
  align("0");
  buildList();
  [world.begin, world.end] = [world.first, world.last];
  choose(firstSignals());
}

function showEnd(recordings) {
  const faults = recordings.filter((each) => each.fault), lost = recordings.filter((each) => each.trouble);
  const [word, detail, state] = faults.length ? ["Fault", faults.length < recordings.length ? `of ${faults.map((each) => each.label).join(", ")}` : faults[0].fault.block, "fault"] :
    lost.length ? ["Incomplete", "", "waiting"] : ["Complete", "", "ok"];
  $("state").hidden = false;
  $("state").dataset.state = state;
  $("word").textContent = word;
  $("detail").textContent = detail;
  $("fault").hidden = !faults.length;
  if (!faults.length) return;
  const { fault, label } = faults[0], card = $("fault"), report = fault.report || [];
  card.querySelector("h2").textContent = `Fault${fault.block ? ` of ${fault.block}` : ""}${recordings.length > 1 ? `, ${label}` : ""}`;
  card.querySelector(".cause").textContent = capital(report[0]?.replace(/^FAULT at .*?\): /, "") || fault.status);
  card.querySelector("pre").textContent = report.join("\n");
  card.querySelector("details").hidden = !report.length;
}

// What the trials are aligned by: the start, the end, a mark that all have, or offsets of the user.
function buildTrials(recordings) {
  const several = recordings.length > 1;
  $("trials").hidden = !several;
  if (!several) return;
  $("recordings").replaceChildren(...sources.map((source, index) => {
    const { label, begin, end, fault, fields } = source.recording;
    const offset = element("input", { type: "number", step: "0.05", value: "0", ariaLabel: `offset of ${label} in s`, title: "offset in s" });
    offset.addEventListener("change", () => { source.offset = Number(offset.value) || 0; $("align").value = "own"; align("own"); });
    source.field = offset;
    const what = [timeText(end - begin), fault ? `fault: ${fault.status}` : "", ...Object.entries(fields).map((pair) => pair.join(" "))];
    return element("li", {}, swatch(index), element("span", { className: "label" }, label),
      element("span", { className: "what" }, what.filter(Boolean).join(", ")), element("label", { className: "what" }, "offset ", offset, " s"));
  }));
  const marks = recordings.map((each) => each.events.map((event) => event.text.match(/^Mark (\d+)/)?.[1]).filter(Boolean));
  const common = marks[0].filter((mark) => marks.every((others) => others.includes(mark)));
  const options = [["0", "the start of the run"], ...common.map((mark) => [`mark ${mark}`, `mark ${mark}`]), ["end", "the end of the run"], ["own", "these offsets"]];
  $("align").replaceChildren(...options.map(([value, text]) => element("option", { value }, text)));
  $("align").addEventListener("change", () => { align($("align").value); all(); });
}

function align(by) {
  if (by !== "own") for (const source of sources) {
    const { events, end } = source.recording;
    const moment = ({ recording }) => (by === "end" ? recording.end : by === "0" ? 0 :
      recording.events.find((event) => event.text.startsWith(`M${by.slice(1)}`))?.time ?? 0);
    source.offset = moment(sources[0]) - moment(source);
    if (source.field) source.field.value = Number(source.offset.toFixed(3));
  }
  world.first = Math.min(...sources.map((source) => source.begin));
  world.last = Math.max(...sources.map((source) => source.end), world.first + SHORTEST);
  world.gaps = sources.flatMap(({ recording, offset }) => recording.gaps.map((gap) => gap.map((time) => time + offset)));
  world.lines = sources.flatMap(({ recording, offset }) => recording.events.filter((event) => event.time !== null)
    .map((event) => ({ ...event, time: event.time + offset, text: sources.length > 1 ? `${recording.label}: ${event.text}` : event.text })))
    .sort((a, b) => a.time - b.time);
  for (const { time } of world.lines) world.last = Math.max(world.last, time);   // a fault is after the last tick
  buildLog();
  redraw();
}

function buildLog() {
  const events = world.lines.slice(0, LOG_LIMIT);
  $("log").replaceChildren(...events.map((event) => {
    const button = element("button", {}, element("time", {}, timeText(event.time)), element("span", {}, event.text));
    button.addEventListener("click", () => go(event));
    return element("li", { className: event.kind }, button);
  }));
  if (world.lines.length > LOG_LIMIT) $("log").append(element("li", {}, `and ${world.lines.length - LOG_LIMIT} more on the timeline`));
  if (!events.length) $("log").append(element("li", { className: "none" }, "No events"));
}

// Signals

// {path: described} of all recordings, in order
const signals = () => new Map(sources.flatMap(({ recording }) => recording.signals.map((signal) => [signal.path, signal])));

// "knee position, left"
function nameOf({ block, port }) {
  const [, words, side] = block.match(SIDES) || [null, block, ""];
  return `${words ? `${words} ${port}` : port}${side ? `, ${side}` : ""}`;
}

// {key of a plot: {title, curves: [{path, source, index, name}]}}: left and right of one recording, or one signal of several
function groups() {
  const found = new Map(), several = sources.length > 1;
  for (const [path, signal] of signals()) {
    const key = several ? path : `${signal.port}|${signal.shown}|${signal.dtype}`;
    if (!found.has(key)) found.set(key, { curves: [], signals: [] });
    const group = found.get(key);
    group.signals.push(signal);
    for (const source of sources) if (source.places.has(path))
      group.curves.push({ path, source, index: source.places.get(path), name: several ? source.recording.label : signal.block || nameOf(signal) });
  }
  for (const group of found.values()) {
    const [first] = group.signals, words = group.signals.map(({ block }) => block.match(SIDES) || [null, block, ""]);
    const same = words.every(([, word]) => word === words[0][1]);
    group.title = several ? nameOf(first) : group.signals.length === 1 ? nameOf(first) : same ? `${words[0][1]} ${first.port}` : first.port;
    if (!several && same && group.signals.length > 1) group.curves.forEach((curve, index) => { curve.name = words[index][2] || words[index][1]; });
    if (!several && group.signals.length === 1) group.curves[0].name = nameOf(first);
  }
  return found;
}

function buildList() {
  $("list").replaceChildren();
  let block = null;
  for (const [path, signal] of signals()) {
    if (signal.block !== block) $("list").append(element("li", {}, element("h3", {}, block = signal.block)));
    const box = element("input", { type: "checkbox" }), unit = signal.shown ? ` (${signal.shown})` : "";
    box.addEventListener("change", () => { if (box.checked) shown.add(path); else shown.delete(path); build(); });
    const item = element("li", {}, element("label", { title: path }, box, element("span", {}, `${signal.port}${unit}`)));
    item.dataset.path = path;
    item.dataset.words = `${path} ${nameOf(signal)} ${signal.block}`.toLowerCase();
    $("list").append(item);
  }
}

function firstSignals() {
  const known = signals(), paths = [...known.keys()];
  const actuators = paths.filter((path) => known.get(path).limits && path.endsWith(".torque"));
  const chosen = actuators.flatMap((path) => FIRST.map((port) => path.replace(/torque$/, port))).filter((path) => known.has(path));
  return chosen.length ? chosen : paths.slice(0, FIRST_LIMIT);
}

function choose(paths) {
  shown = new Set(paths);
  build();
}

// Make the plots of the chosen signals, and keep those that are there.
function build() {
  const wanted = new Map();
  for (const [key, { title, curves }] of groups()) {
    const chosen = curves.filter((curve) => shown.has(curve.path));
    if (chosen.length) wanted.set(`${key} ${chosen.map((curve) => curve.path).join(" ")}`, { title, curves: chosen });
  }
  for (const [key, chart] of charts) if (!wanted.has(key)) { watcher.unobserve(chart.frame.card); chart.destroy(); charts.delete(key); }
  const kept = charts;
  charts = new Map();
  for (const [key, { title, curves }] of wanted) {
    let chart = kept.get(key);
    if (!chart) {
      chart = new TimeChart($("charts"), title, curves, world, () => { for (const curve of curves) shown.delete(curve.path); build(); });
      steer(chart);
      watcher.observe(chart.frame.card);
    }
    $("charts").append(chart.frame.card);
    charts.set(key, chart);
  }
  for (const item of $("list").querySelectorAll("[data-path]")) item.querySelector("input").checked = shown.has(item.dataset.path);
  $("count").textContent = `${shown.size} of ${signals().size}`;
  redraw();
}

// Time

function show(begin, end) {
  const long = world.last - world.first, span = Math.min(Math.max(end - begin, Math.min(SHORTEST, long)), long);
  const first = Math.min(Math.max(begin, world.first), world.last - span);
  [world.begin, world.end] = [first, first + span];
  redraw();
}

function all() { show(world.first, world.last); }
function move(share) { const by = share * (world.end - world.begin); show(world.begin + by, world.end + by); }

// around: the time that keeps its place
function zoom(factor, around = (world.begin + world.end) / 2) {
  const begin = Math.max(world.first, around - (around - world.begin) * factor);
  show(begin, begin + (world.end - world.begin) * factor);
}

function go(event) {
  const span = world.end - world.begin > 0.9 * (world.last - world.first) ? EVENT_SPAN : world.end - world.begin;
  show(event.time - span / 2, event.time + span / 2);
  setCursor(event.time);
  tell(`${timeText(event.time)}: ${event.text}`);
}

function next(direction) {
  const from = cursor ?? (world.begin + world.end) / 2, tiny = 1e-6;
  const later = world.lines.filter(({ time }) => (direction > 0 ? time > from + tiny : time < from - tiny));
  if (later.length) go(later.at(direction > 0 ? 0 : -1));
}

function setCursor(time) {
  cursor = time;
  for (const chart of charts.values()) if (chart.visible) chart.showValues(cursor);
}

function redraw() { drawing ||= requestAnimationFrame(draw); }

function draw() {
  drawing = 0;
  if (!sources.length || $("curves").hidden) return;
  const visible = [...charts.values()].filter((chart) => chart.visible);
  const width = Math.max(200, ...visible.map((chart) => chart.over.clientWidth)), [chart] = charts.values();
  world.preview = [];
  for (const source of sources) {
    const places = [...shown].map((path) => source.places.get(path)).filter((index) => index !== undefined);
    if (places.length) source.want(places, world.begin, world.end, width * Math.min(2, devicePixelRatio), answered);
    const curve = chart?.curves.findIndex((each) => each.source === source), piece = curve >= 0 && source.whole.get(chart.curves[curve].index);
    if (piece) world.preview.push({ piece, offset: source.offset, place: curve });
  }
  for (const each of visible) { each.update(); each.showValues(cursor); }
  timeline.draw();
  $("span").textContent = `${timeText(world.begin)} to ${timeText(world.end)}`;
  clearTimeout(telling);
  telling = setTimeout(() => { for (const each of charts.values()) if (each.shown) each.describe(); }, TELL_PERIOD);
}

function answered(problem) {
  if (problem) alarm(problem);
  redraw();
}

function tell(text) { $("told").textContent = text; }

// Drag, wheel and fingers on a plot.
function steer(chart) {
  const { over } = chart, fingers = new Map();
  const time = (x, begin = world.begin, end = world.end) => {
    const box = over.getBoundingClientRect();
    return begin + (x - box.left) / box.width * (end - begin);
  };
  let grip = null, chosen = null;
  const start = () => { grip = { begin: world.begin, end: world.end, places: [...fingers.values()] }; };
  over.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    fingers.set(event.pointerId, event.clientX);
    over.setPointerCapture(event.pointerId);
    over.classList.add("moving");
    start();
    if (event.shiftKey) {
      chosen = element("div", { className: "chosen" });
      over.append(chosen);
    }
  });
  over.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) { setCursor(time(event.clientX)); return; }
    fingers.set(event.pointerId, event.clientX);
    const places = [...fingers.values()], box = over.getBoundingClientRect();
    if (chosen) {
      const [from, to] = [grip.places[0], places[0]].map((x) => Math.min(Math.max(x - box.left, 0), box.width)).sort((a, b) => a - b);
      Object.assign(chosen.style, { left: `${from}px`, width: `${to - from}px` });
      return;
    }
    const [from, to] = [grip.places, places].map((xs) => xs.map((x) => (x - box.left) / box.width));
    if (places.length < 2) {
      const by = (from[0] - to[0]) * (grip.end - grip.begin);
      show(grip.begin + by, grip.end + by);
      return;
    }
    const span = (grip.end - grip.begin) * Math.abs(from[1] - from[0]) / Math.max(0.02, Math.abs(to[1] - to[0]));
    const middle = grip.begin + (from[0] + from[1]) / 2 * (grip.end - grip.begin);
    show(middle - (to[0] + to[1]) / 2 * span, middle + (1 - (to[0] + to[1]) / 2) * span);
  });
  const leave = (event) => {
    if (chosen && event.type === "pointerup") {
      const ends = [grip.places[0], event.clientX].map((x) => time(x)).sort((a, b) => a - b);
      if (Math.abs(grip.places[0] - event.clientX) > 4) show(...ends);
    }
    chosen?.remove();
    chosen = null;
    fingers.delete(event.pointerId);
    over.classList.toggle("moving", fingers.size > 0);
    start();
  };
  for (const name of ["pointerup", "pointercancel"]) over.addEventListener(name, leave);
  over.addEventListener("pointerleave", () => { if (!fingers.size) setCursor(null); });
  over.addEventListener("dblclick", all);
  over.addEventListener("wheel", (event) => wheel(event, time(event.clientX), event.ctrlKey || event.metaKey, over.clientWidth), { passive: false });
}

// zooms: whether the wheel zooms, where it would scroll the page; width: px of the plot
function wheel(event, around, zooms, width) {
  const scale = event.deltaMode === 1 ? 20 : event.deltaMode === 2 ? 200 : 1;
  const across = event.shiftKey && !event.deltaX ? event.deltaY : event.deltaX;
  if (zooms) zoom(Math.exp(Math.max(-1, Math.min(1, scale * event.deltaY / (event.ctrlKey && Math.abs(event.deltaY) < 40 ? 100 : 400)))), around);
  else if (Math.abs(across) > Math.abs(event.shiftKey ? 0 : event.deltaY)) move(scale * across / width);
  else return;
  event.preventDefault();
}

// Strides

function wantStrides() {
  if ($("strides").hidden) return;
  const whole = $("part").value === "all";
  const of = sources.flatMap((source, index) => {
    const [begin, end] = [world.begin - source.offset, world.end - source.offset];
    if (whole) return [[index, null, null]];
    return end < source.recording.begin || begin > source.recording.end ? [] : [[index, begin, end]];
  });
  const question = { do: "average", of, paths: [...shown] }, text = JSON.stringify(question);
  if (text === strideQuestion) { showStrides(); return; }
  strideQuestion = text;
  $("found").textContent = "averaging…";
  ask(question, (answer) => { if (text === strideQuestion) { averages = answer; showStrides(); } });
}

function showStrides() {
  for (const chart of legs) chart.destroy();
  legs = [];
  $("legs").replaceChildren();
  if (!averages) return;
  const several = sources.length > 1, label = (each) => sources[each.recording].recording.label;
  const ranges = {};
  for (const name of ["angle", "torque", "power"]) ranges[name] = rangeAround(averages.legs.flatMap((leg) => leg.of.map((each) => each.curves[name])));
  for (const leg of averages.legs) {
    const place = element("section", { className: "leg" }, element("h2", {}, capital(leg.title.replaceAll("_", " "))));
    $("legs").append(place);
    place.append(figures(leg));
    for (const name of ["angle", "torque", "power"]) {
      const curves = leg.of.map((each) => ({ ...each.curves[name], place: each.recording, name: several ? `${label(each)}, ${each.strides} strides` : `mean ± SD of ${each.strides} strides` }));
      const sign = leg.positive && name !== "power" ? `, ${leg.positive} +` : "";
      const title = `${leg.joint} ${name}, ${leg.title.replaceAll("_", " ")}`;
      legs.push(new StrideChart(place, title, `${axisLabel(curves[0])}${sign}`, curves, ranges[name],
        leg.of.filter((each) => each.toe_off !== null).map((each) => ({ at: each.toe_off, place: each.recording }))));
    }
  }
  if (averages.signals.length) {
    const place = element("section", { className: "leg" }, element("h2", {}, "Chosen signals"));
    $("legs").append(place);
    for (const signal of averages.signals) {
      const curves = signal.of.map((each) => ({ ...each, place: each.recording, name: several ? `${label(each)}, ${each.strides} strides` : `mean ± SD of ${each.strides} strides` }));
      legs.push(new StrideChart(place, nameOf(signal), axisLabel(signal), curves, rangeAround(curves)));
    }
  }
  $("found").textContent = averages.problems.join("\n");
}

function rangeAround(curves) {
  const low = Math.min(0, ...curves.flatMap((curve) => curve.mean.map((value, index) => value - curve.sd[index])));
  const high = Math.max(0, ...curves.flatMap((curve) => curve.mean.map((value, index) => value + curve.sd[index])));
  return uPlot.rangeNum(low, high, 0.08, true);
}

// Figures of a leg: mean and standard deviation over its strides, one column for each recording.
function figures(leg) {
  const several = sources.length > 1, cell = ({ mean, sd, unit }) => `${number(mean)} ± ${number(sd)} ${unit}`;
  const head = several ? [element("tr", {}, element("td"), ...leg.of.map((each) => element("th", { scope: "col" }, sources[each.recording].recording.label)))] : [];
  const rows = leg.of[0].figures.map((first, index) => element("tr", {}, element("th", { scope: "row" }, first.name),
    ...leg.of.map((each) => element("td", {}, cell(each.figures[index])))));
  return element("div", { className: "card scroll", tabIndex: 0, role: "region", ariaLabel: `figures of ${leg.title}` }, element("table", {}, ...head, ...rows));
}

// Picture of the plots of the open tab

async function save(kind) {
  const strides = !$("strides").hidden, list = strides ? legs : [...charts.values()];
  if (!list.length) { tell("There is no plot to save"); return; }
  if (!strides) for (const chart of list) chart.update();   // those outside the window, too
  const stem = sources.map((source) => source.recording.label).join("_").replaceAll(/[^\w.-]+/g, "_");
  const width = Number($("width").value), text = svg(list.map((chart) => chart.figure()), { width, columns: strides && width > 100 ? 2 : 1, title: `${stem}, ${timeText(world.begin)} to ${timeText(world.end)}` });
  const part = strides ? "strides" : `${world.begin.toFixed(1)}-${world.end.toFixed(1)}s`;
  const file = kind === "png" ? await png(text) : new Blob([text], { type: "image/svg+xml" });
  const link = element("a", { href: URL.createObjectURL(file), download: `${stem}_${part}.${kind}` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  tell(`${link.download} was saved`);
}

// Controls

const KEYS = {
  ArrowLeft: () => move(-0.1), ArrowRight: () => move(0.1), "+": () => zoom(0.5, cursor ?? undefined), "=": () => zoom(0.5, cursor ?? undefined),
  "-": () => zoom(2, cursor ?? undefined), 0: all, Home: () => show(world.first, world.first + world.end - world.begin),
  End: () => show(world.last - (world.end - world.begin), world.last), n: () => next(1), p: () => next(-1),
  ",": () => step(-1), ".": () => step(1),
};

// Move the cursor by a two-hundredth of the window, and read the values.
function step(direction) {
  const span = world.end - world.begin;
  setCursor(Math.min(world.end, Math.max(world.begin, (cursor ?? world.begin + span / 2) + direction * span / 200)));
  tell(`${timeText(cursor, 2)}: ${[...charts.values()].filter((chart) => chart.visible).map((chart) =>
    `${chart.title} ${chart.curves.map((curve, place) => `${chart.curves.length > 1 ? curve.name : ""} ${chart.valueText(place, cursor, curve.source)}`).join(", ")}`).join("; ")}`);
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || $("curves").hidden || !sources.length) return;
  if (event.target.closest?.("input:not([type=checkbox]), select, nav, pre, dialog")) return;
  const act = KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
for (const [id, act] of Object.entries({ earlier: () => move(-0.5), later: () => move(0.5), in: () => zoom(0.5), out: () => zoom(2), all }))
  $(id).addEventListener("click", act);
$("track").addEventListener("wheel", (event) => wheel(event, timeline.time(timeline.at(event)), !event.shiftKey && Math.abs(event.deltaY) > Math.abs(event.deltaX), $("track").clientWidth), { passive: false });
$("filter").addEventListener("input", () => {
  const words = $("filter").value.toLowerCase().split(/\s+/);
  for (const item of $("list").children) item.hidden = item.dataset.path ? !words.every((word) => item.dataset.words.includes(word)) : Boolean($("filter").value);
});
const listed = () => [...$("list").querySelectorAll("[data-path]:not([hidden])")].map((item) => item.dataset.path);
$("every").addEventListener("click", () => choose([...shown, ...listed()]));
$("none").addEventListener("click", () => { const gone = new Set(listed()); choose([...shown].filter((path) => !gone.has(path))); });
$("saving").addEventListener("submit", (event) => { event.preventDefault(); save(event.submitter?.value || "svg"); });
$("part").addEventListener("change", wantStrides);

const tabs = ["curves", "strides"];
function select(name) {
  for (const each of tabs) {
    $(each).hidden = each !== name;
    $(`tab-${each}`).setAttribute("aria-selected", String(each === name));
    $(`tab-${each}`).tabIndex = each === name ? 0 : -1;
  }
  if (name === "strides") wantStrides(); else redraw();
}
for (const name of tabs) $(`tab-${name}`).addEventListener("click", () => select(name));
$("tab-curves").parentElement.addEventListener("keydown", (event) => {
  if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
  const other = tabs[1 - tabs.findIndex((name) => !$(name).hidden)];
  select(other);
  $(`tab-${other}`).focus();
});

addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const chart of charts.values()) { watcher.unobserve(chart.frame.card); chart.destroy(); }
  charts = new Map();
  build();
  if (!$("strides").hidden) showStrides();
});
if (innerWidth < 992) for (const id of ["signals", "happened"]) $(id).open = false;

connect();
