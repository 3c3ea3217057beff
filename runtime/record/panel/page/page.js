// The page of the panel: one WebSocket, which brings doubles in binary messages and everything else as JSON.
import { DiagramView } from "./diagram.js";
import { Painter } from "./painter.js";
import { Plots } from "./plots.js";
import { Parameters } from "./parameters.js";
import { capital, clock, element, number, withUnit } from "./text.js";

const LINK_TIMEOUT = 400;      // ms without a message, after which the link counts as lost
const STALL_TIMEOUT = 500;     // ms without a new tick
const RECONNECT_PERIOD = 500;  // ms
const TEXT_PERIOD = 100;       // ms; numbers that change faster cannot be read
const DIAGRAM_PERIOD = 200;    // ms
const NARROW = 700;            // px of a window that has no room for the diagram at first
const REPLY_SPAN = 10;         // s
const BUSY = 0.8;              // share of the bitrate
const HIGH = 0.95;             // share of a limit
const HOT = 0.8;               // share of the temperature at which the run ends
const SIDES = ["left", "right"];
const plain = (signal) => [signal.port, (value) => withUnit(value, signal)];
const GAIT = {                 // names of ports: (signal) => [name of the row, function from value to text]
  walking: plain, standing: plain, strides: plain, stride_time: plain, cadence: plain, speed: plain, incline: plain,
  state: plain, mode: plain, voltage: plain, battery: plain, charge: plain,
  phase: () => ["gait phase", (value) => (Number.isFinite(value) ? `${Math.round(100 * value)} %` : "–")],
  frequency: () => ["steps per minute", (value) => (Number.isFinite(value) ? String(Math.round(120 * value)) : "–")],
};
const WORDS = {
  init: ["Starting", ""], arming: ["Arming", "waiting for the devices"],
  ready: ["Ready", "confirm at the terminal to arm"], running: ["Running", ""],
  stopping: ["Stopping", ""], safe: ["Stopped", ""],
  waiting: ["Fault", "stopped; arm again at the terminal with r"],
};

const $ = (id) => document.getElementById(id);
const token = location.hash.slice(1);
let socket = null, hello = null, status = null, values = null, tick = -1;
let heard = 0, advanced = 0, opened = 0, asked = null, problem = "", ended = false, end = null, shown = 0, drawn = 0, cells = [];
let mine = false, seen = 0;    // whether this page has the controls; time of the newest frame that it has confirmed

const painter = new Painter(parts);
const plots = new Plots($("charts"), $("list"), $("filter"), () => painter.due());
const diagram = new DiagramView($("diagram"), $("drawing"), (indices) => plots.toggleAll(indices));
const parameters = new Parameters($("parameters"), $("both"), send, $("tools"));

// Link

function connect() {
  opened = performance.now();
  const made = socket = new WebSocket(`ws${location.protocol === "https:" ? "s" : ""}://${location.host}/socket`);
  made.binaryType = "arraybuffer";
  made.onopen = () => { if (token) made.send(token); };
  made.onmessage = (message) => {
    if (made !== socket) return;
    heard = performance.now();
    if (typeof message.data === "string") take(JSON.parse(message.data)); else { confirmFrame(message.data); takeFrame(message.data); }
  };
  made.onclose = (event) => {
    if (made !== socket) return;
    socket = null;
    if (event.code === 1008) problem = "The address of this page has no valid token: open the address that the run has printed.";
    watch();
  };
}

function send(order) {
  if (!socket || socket.readyState !== WebSocket.OPEN || !linked()) return false;
  socket.send(JSON.stringify(order));
  return true;
}

// The run watches this page by its confirmations, from here: a frozen page sends none, and one in the background does.
function confirmFrame(buffer) {
  const at = new Float64Array(buffer, 16, 1)[0];
  if (!mine || hello.lost !== "stop" || at === seen) return;
  seen = at;
  socket.send(JSON.stringify({ do: "seen", at }));
}

const linked = () => performance.now() - heard < LINK_TIMEOUT;

function watch() {
  const now = performance.now();
  if (!socket && now - opened > (ended ? 4 : 1) * RECONNECT_PERIOD) connect();
  if (socket && !linked() && now - Math.max(heard, opened) > 4 * LINK_TIMEOUT) { socket.close(); socket = null; }
  const stalled = status && status.state === "running" && now - advanced > Math.max(STALL_TIMEOUT, 3000 / hello.rate);
  const old = !linked() || stalled || !status || status.over;
  document.body.classList.toggle("stale", old);
  document.body.classList.toggle("lost", !ended && (!linked() || Boolean(stalled)));
  let text = "";
  if (ended && !linked()) text = "";
  else if (problem) text = problem;
  else if (!linked()) text = heard ? `Link lost. These values are ${((now - heard) / 1000).toFixed(1)} s old, and this page ` +
    "cannot stop the robot. " + (mine && hello.lost === "stop" ? "The run stops without it. If it does not, use" : "Use") +
    " the emergency stop, or the space bar in the terminal of the run." : "Connecting…";
  else if (status && status.gone) text = "The process of the run has died. Its guardian stops the motors of a rig.";
  else if (stalled) text = "The run does not advance: these values are old.";
  if ($("alarm").textContent !== text) $("alarm").textContent = text;
  $("alarm").hidden = !text;
  showState();
  if (asked === "unsent" && socket && socket.readyState === WebSocket.OPEN && linked()) stop();
}

// Messages

function take(message) {
  if (message.type === "hello") takeHello(message);
  else if (message.type === "status") takeStatus(message);
  else if (message.type === "event") takeEvent(message);
  else if (message.type === "answer") parameters.answered(message);
}

function takeHello(message) {
  const again = hello && hello.run === message.run;
  hello = message;
  problem = "";
  ended = false;
  end = null;
  advanced = performance.now();
  plots.marks = [];
  $("log").replaceChildren(element("li", { className: "none" }, "No events yet"));
  $("fault").hidden = true;
  if (again) return;
  asked = null;
  document.title = `${hello.name} – Tickwork`;
  $("name").textContent = hello.name.replaceAll("_", " ");
  $("kind").textContent = hello.simulated ? "simulation" : "robot";
  values = new Float64Array(hello.signals.length).fill(NaN);
  buildOperate();
  $("marks").replaceChildren(...hello.marks.map((note) => element("button", { onclick: () => mark(note) }, note)));
  $("subject").href = `subject#${hello.watch}`;
  $("link").textContent = hello.link;
  parameters.build(hello.parameters, hello.name);
  $("adjust").hidden = !$("parameters").children.length;
  plots.build(hello);
  $("average-label").hidden = !plots.strides;
  $("drawing").hidden = !hello.diagram;
  $("drawing").open = innerWidth > NARROW;
  if (hello.diagram) diagram.build(hello.diagram, hello.signals);
  diagram.marked((index) => plots.has(index));
}

function takeFrame(buffer) {
  if (!hello) return;
  const doubles = new Float64Array(buffer), count = hello.signals.length;
  if (doubles.length !== 3 + 3 * count) return;
  if (status) status.state = hello.states[doubles[1]];
  if (doubles[0] !== tick) {
    tick = doubles[0];
    advanced = performance.now();
    const [newest, first, second] = [0, 1, 2].map((place) => doubles.subarray(3 + place * count, 3 + (place + 1) * count));
    values = newest;
    if (tick >= 0) plots.add(tick / hello.rate, values, first, second);
  }
  painter.due();
}

// What is to be drawn, as functions. The message of a frame draws nothing: its reply does not wait.
function parts() {
  const now = performance.now(), due = $("plots").hidden ? [] : plots.parts();
  if (now - shown > TEXT_PERIOD) {
    shown = now;
    due.push($("plots").hidden ? showOperate : () => plots.showValues(values));
    if (tick >= 0) $("time").textContent = clock((tick + 1) / hello.rate);
  }
  if (!$("plots").hidden && $("drawing").open && now - drawn > DIAGRAM_PERIOD) { drawn = now; due.push(() => diagram.show(values)); }
  return due;
}

const showOperate = () => { for (const cell of cells) cell.slow(); };

function takeStatus(message) {
  status = message;
  ended = status.complete;
  const recording = status.recording;
  $("record").classList.toggle("on", Boolean(recording) && !status.complete);
  $("file").textContent = recording ? recording.name : "not recorded";
  $("file").title = recording ? `${recording.folder}/${recording.name}` : "";
  const operator = status.pages.find((page) => page.operates);
  const may = hello.role === "operate", armed = hello.lost === "stop" && status.state === "running";
  mine = Boolean(operator) && operator.name === hello.page;
  $("operator").textContent = (operator ? (mine ? "this page" : operator.name) : "no page") +
    (status.pages.length > 1 ? `, ${status.pages.length} pages open` : "");
  $("controls").firstElementChild.textContent = mine ? "This page has the controls." +
    (hello.lost === "stop" ? " The robot stops if it is closed, reloaded or loses its link." : "") :
    may ? `${operator ? capital(operator.name) : "No page"} has the controls.` : "This page shows the run and may stop it.";
  $("controls").hidden = mine && status.pages.length === 1 && hello.lost !== "stop";
  $("take").textContent = (mine ? "Give them back" : "Take the controls") + (armed && operator ? " and stop the robot" : "");
  $("take").hidden = !may;
  $("take").onclick = () => send({ do: "operate", take: !mine });
  for (const control of [$("mark"), $("note"), ...$("marks").children]) control.disabled = !mine || status.over;
  parameters.show(status.live, mine && !status.over);
  showHealth();
  showState();
}

function takeEvent(event) {
  const list = $("log");
  list.querySelector(".none")?.remove();
  const text = eventText(event);
  if (text) {
    const time = Number.isFinite(event.tick) && event.tick >= 0 ? clock(event.tick / hello.rate) : "";
    list.prepend(element("li", {}, element("time", {}, time), element("span", {}, text)));
  }
  if (event.event === "mark") plots.marks.push({ time: event.tick / hello.rate, text: String(event.number) });
  if ((event.event === "end" || event.event === "fault") && event.status && event.status !== "ok") showFault(event);
  else if (event.event === "rearm") $("fault").hidden = true;
  if (event.unconfirmed?.length) showFault(event);
  if (event.event === "end") end = event;
}

function eventText(event) {
  const by = { keys: "keys of the terminal", replay: "the replay" }[event.by] || event.by;
  if (event.event === "set") return `${parameters.nameOf(event.path)}: ${parameters.valueOf(event.path, event.from)} to ` +
    `${parameters.valueOf(event.path, event.value)} (${by})`;
  if (event.event === "mark") return `Mark ${event.number} (${by})`;
  if (event.event === "note") return `Mark ${event.number}: ${event.text}`;
  if (event.event === "stop") return `Stop (${by})`;
  if (event.event === "confirm") return "Arming was confirmed";
  if (event.event === "rearm") return "Arming again was confirmed";
  if (event.event === "end") return event.status === "ok" ? "The run has ended" : `Fault: ${event.status}`;
  if (event.event === "fault") return `Fault: ${event.status}`;
  return event.text || "";
}

function showFault(event) {
  const card = $("fault"), report = event.report?.length ? event.report : event.lines || [];
  const set = (selector, text) => { card.querySelector(selector).textContent = text; };
  const fault = event.status && event.status !== "ok";
  card.hidden = false;
  set("h2", !fault ? "The stop is not confirmed" : event.culprit ? `Fault of ${blockName(event.culprit)}` : "Fault");
  set(".cause", !fault ? "" : capital(report[0]?.replace(/^FAULT at .*?\): /, "") || event.status));
  set(".remedy", event.unconfirmed?.length ?
    `${event.unconfirmed.map(blockName).join("; ")}: no confirmation of the stop. Cut the power of the motors.` :
    event.event === "end" ? "The run has ended in its safe stop. Remove the cause, then start the run again." :
      "The run waits in its safe stop. Remove the cause, then arm again at the terminal.");
  set("pre", report.join("\n"));
  card.querySelector("details").hidden = !report.length;
}

const blockName = (path) => hello.signals.find((signal) => signal.path.startsWith(`${path}.`))?.block || path;

// State and STOP

function showState() {
  const box = $("state");
  let [word, detail] = ["No link", ""], state = "none";
  if (ended) {
    [word, detail] = ["Ended", $("fault").hidden ? (status.recording ? "the recording is complete" : "") : "after a fault"];
    state = "safe";
  } else if (status && linked()) {
    state = status.state;
    [word, detail] = WORDS[state];
    if (state === "running") detail = gaitWord();
    if (state === "safe" && !end) [word, detail, state] = ["Stopping", "the drives confirm the stop", "stopping"];
    else if ((state === "stopping" || state === "safe") && status.stopped_by)
      detail = status.stopped_by === "keys" ? "by the space bar of the terminal" : `by ${status.stopped_by.replace("set", "process")}`;
  }
  if (end?.unconfirmed?.length) [word, detail] = ["Not confirmed", "cut the power of the motors"];
  if (!$("fault").hidden && state === "safe") state = "fault";
  if (box.dataset.state !== state) box.dataset.state = state;
  if ($("word").textContent !== word) $("word").textContent = word;
  if ($("detail").textContent !== detail) $("detail").textContent = detail;
  const over = ended || (status && status.over), button = $("stop");
  if (over) asked = null;
  button.disabled = Boolean(over);
  button.classList.toggle("unsent", asked === "unsent");
  $("stop-hint").classList.toggle("idle", !over && !asked);
  $("stop-hint").textContent = over ? (status.stopped_by ? "the run has been stopped" : "the run has ended") : asked === "unsent" ?
    "NOT SENT: no link. Use the emergency stop" : asked ? "requested…" : "or press the space bar";
}

function gaitWord() {
  for (const [index, signal] of hello.signals.entries())
    if (signal.path.endsWith(".walking") && signal.dtype === "bool" && !/^(left|right)\//.test(signal.path))
      return values[index] ? "walking" : "standing";
  return "";
}

function stop() {
  asked = send({ do: "stop" }) ? "sent" : "unsent";
  showState();
}

// Operate

function buildOperate() {
  const blocks = new Map();
  cells = [];
  hello.signals.forEach((signal, index) => {
    const block = signal.path.slice(0, signal.path.lastIndexOf("."));
    if (!blocks.has(block)) blocks.set(block, { path: block, name: signal.block, ports: new Map() });
    blocks.get(block).ports.set(signal.path.slice(block.length + 1), { ...signal, index });
  });
  $("actuators").replaceChildren();
  const rest = [];
  for (const block of blocks.values()) {
    const torque = block.ports.get("torque");
    if (torque && torque.limits) $("actuators").append(actuator(block, torque)); else rest.push(block);
  }
  buildGait(rest);
}

// One row for each quantity of the gait, with the left side beside the right one.
function buildGait(blocks) {
  const rows = new Map();
  for (const block of blocks)
    for (const [port, make] of Object.entries(GAIT)) {
      const signal = block.ports.get(port);
      if (!signal || (port === "frequency" && !block.ports.has("phase")) || (signal.dtype === "int" && port === "state" && !signal.labels.length)) continue;
      const side = SIDES.find((name) => block.path.startsWith(`${name}/`)) || "";
      if (!side && (port === "walking" || port === "standing")) continue;   // beside the state
      const [name, text] = make(signal);
      if (!rows.has(name)) rows.set(name, {});
      rows.get(name)[side] ??= () => text(values[signal.index]);
    }
  const cell = (read) => {
    const made = element("td", { className: "live" });
    if (read) cells.push({ slow() { made.textContent = read(); } });
    return made;
  };
  const sides = SIDES.some((side) => [...rows.values()].some((row) => row[side]));
  const head = element("tr", {}, element("td"), ...SIDES.map((side) => element("th", { scope: "col" }, side)));
  $("gait").querySelector("table").replaceChildren(...(sides ? [head] : []), ...[...rows].map(([name, row]) => {
    const whole = cell(row[""]);
    whole.colSpan = sides ? 2 : 1;
    return element("tr", {}, element("th", { scope: "row" }, name), ...(row[""] ? [whole] : SIDES.map((side) => cell(row[side]))));
  }));
  $("gait").hidden = !rows.size;
}

function actuator(block, torque) {
  const [low, high] = torque.limits, size = Math.max(-low, high);
  const value = element("b", { className: "live" }), share = element("span", { className: "live" });
  const fill = element("i"), bar = element("div", { className: "bar live-bar" }, fill, element("u"));
  const rest = element("dl", { className: "values" });
  cells.push({
    slow() {
      const part = Math.max(-1, Math.min(1, values[torque.index] / size)) || 0;
      fill.style.left = `${50 + 50 * Math.min(0, part)}%`;
      fill.style.width = `${50 * Math.abs(part)}%`;
      bar.classList.toggle("high", Math.abs(part) > HIGH);
      value.textContent = withUnit(values[torque.index], torque);
      share.textContent = Number.isFinite(values[torque.index]) ? `${Math.round(100 * Math.abs(part))} % of the limit` : "";
    },
  });
  for (const name of ["position", "velocity", "temperature", "rms_torque", "fault"]) {
    const signal = block.ports.get(name);
    if (signal) valueRow(rest, { position: "angle", fault: "fault of the drive" }[name] || signal.port, signal);
  }
  return element("section", { className: "card actuator" }, element("h2", {}, block.name),
    element("div", { className: "torque" }, value, share), bar,
    element("div", { className: "ends", ariaHidden: "true" }, element("span", {}, withUnit(-size, torque)),
      element("span", {}, "torque"), element("span", {}, withUnit(size, torque))), rest);
}

function valueRow(list, name, signal) {
  const cell = element("dd", { className: "live", title: signal.path }), fault = name === "fault of the drive";
  list.append(element("dt", {}, name), cell);
  cells.push({ slow() {
    const value = values[signal.index];
    cell.textContent = fault && value === 0 ? "none" : withUnit(value, signal) + (signal.hot ? ` of ${signal.hot} °C` : "");
    cell.classList.toggle("bad", fault ? value > 0 : Boolean(signal.hot) && value > HOT * signal.hot);
  } });
}

// The greatest age of a drive's reply in the last seconds: a lost one makes the next older by a period.
function oldestReply(text) {
  const drives = hello.signals.flatMap(({ path, block }, index) =>
    (path.endsWith(".age") && hello.signals.some((each) => each.limits && each.path === path.replace(/age$/, "torque")) ? [{ block, index }] : []));
  const ages = drives.map(({ block, index }) => [plots.largest(index, REPLY_SPAN), block]).filter(([age]) => age > -Infinity);
  if (!ages.length) return [];
  const [age, block] = ages.reduce((one, other) => (other[0] > one[0] ? other : one));
  return [[`oldest reply in ${REPLY_SPAN} s`, `${text(age)}, ${block}`]];
}

// The commands of each drive that had no reply before the next one.
function lostReplies() {
  const block = (path) => hello.signals.find((signal) => signal.path === `${path}.torque`)?.block || path;
  return Object.entries(status.lost_replies).map(([path, count]) => [`lost replies, ${block(path)}`, String(count), count > 0]);
}

function showHealth() {
  const frames = (count) => (count === null ? "–" : String(Math.round(count)));
  const micro = (seconds) => seconds === null ? "–" : seconds < 1e-3 ? `${Math.round(1e6 * seconds)} µs` : `${number(1e3 * seconds)} ms`;
  const rows = [
    ["rate", `${number(status.ticks_per_second ?? NaN)} Hz`],
    ["late, median and 99 %", `${micro(status.late[0])}, ${micro(status.late[1])}`],
    ["time in ticks", `${number(100 * (status.load ?? NaN))} %`],
    ...status.buses.map(({ name, received, sent, bits, bitrate }) => [`bus ${name}`, `${frames(sent)} sent, ${frames(received)} received` +
      `${bitrate ? `, ${Math.round((100 * bits) / bitrate)} %` : " a second"}`, bits > BUSY * bitrate]),
    ...oldestReply(micro),
    ...lostReplies(),
    ["missed ticks", String(status.missed), status.missed > 0],
    ["lost records", String(status.dropped), status.dropped > 0],
  ];
  if (status.recording && status.recording.free !== null)
    rows.push(["free space for recordings", `${number(status.recording.free / 1e9)} GB`, status.recording.free < 1e9]);
  if (status.refused) rows.push(["refused messages", String(status.refused), true]);
  $("health").replaceChildren(...rows.flatMap(([name, text, bad]) =>
    [element("dt", {}, name), element("dd", { className: bad ? "live bad" : "live" }, text)]));
}

// Controls

$("stop").addEventListener("pointerdown", (event) => { if (event.button === 0) stop(); });
$("stop").addEventListener("click", (event) => { if (event.detail === 0) stop(); });   // keyboard, screen reader
const writes = (place) => place.id === "note" || place.id === "filter";   // there a space is a letter
addEventListener("keydown", (event) => {
  if (event.code !== "Space" || writes(event.target)) return;
  event.preventDefault();
  event.stopPropagation();
  if (!event.repeat && !$("stop").disabled) stop();
}, true);
addEventListener("keyup", (event) => {        // a space also presses a button when it is released
  if (event.code === "Space" && !writes(event.target)) event.preventDefault();
}, true);
let marks = 0;
const mark = (note) => send({ do: "mark", id: --marks, note });
$("marking").addEventListener("submit", (event) => {
  event.preventDefault();
  if (mark($("note").value)) $("note").value = "";
  $("note").blur();                            // so that the space bar stops again
});
const tabs = ["operate", "plots"];
const places = { events: $("events").parentElement, timing: $("timing").parentElement };   // cards that both tabs show
function select(name) {
  for (const each of tabs) {
    $(each).hidden = each !== name;
    $(`tab-${each}`).setAttribute("aria-selected", String(each === name));
    $(`tab-${each}`).tabIndex = each === name ? 0 : -1;
  }
  for (const [id, place] of Object.entries(places)) (name === "plots" ? $("beside") : place).append($(id));
}
for (const name of tabs) $(`tab-${name}`).addEventListener("click", () => select(name));
$("tab-operate").parentElement.addEventListener("keydown", (event) => {
  if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
  const other = tabs[1 - tabs.findIndex((name) => !$(name).hidden)];
  select(other);
  $(`tab-${other}`).focus();
});
$("pause").addEventListener("click", () => $("pause").setAttribute("aria-pressed", String(plots.pause())));
$("pause").addEventListener("click", () => { $("pause").textContent = plots.paused ? "Go on" : "Pause"; });
$("span").addEventListener("change", () => plots.setSpan(Number($("span").value)));
$("clear").addEventListener("click", () => plots.clear());
$("average").addEventListener("change", () => plots.setAverage($("average").checked));
document.addEventListener("visibilitychange", watch);   // its timers are slow in the background
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.rebuild());

setInterval(watch, 50);
connect();
