// The page for the subject: one value in large digits, its target band, and the last strides or seconds. It shows a run,
// and its space bar stops it; the server gives it no other right.
import { element, nameOf, nearest, number, withUnit } from "./text.js";

const LINK_TIMEOUT = 400;      // ms without a message, after which the link counts as lost
const RECONNECT_PERIOD = 500;  // ms
const TEXT_PERIOD = 200;       // ms; digits that change faster cannot be read
const SPAN = 10;               // s of a signal that is shown
const STRIDES = 12;            // last strides that are shown
const WRAP = 0.5;              // decrease of the phase at the end of a stride
const MARGIN = 0.35;           // room above and below the band, in widths of the band
const LEAST_SPAN = 1e-6;       // of the axis
const FOLD = {                 // [from before the stride, with each sample, at its end]
  last: [() => NaN, (_, value) => value], maximum: [() => NaN, (so, value) => (so > value ? so : value)],
  minimum: [() => NaN, (so, value) => (so < value ? so : value)],
  mean: [() => ({ sum: 0, count: 0 }), (so, value) => ({ sum: so.sum + value, count: so.count + 1 }), (so) => so.sum / so.count],
};

const $ = (id) => document.getElementById(id);
const token = location.hash.slice(1), chosen = new URLSearchParams(location.search);
let socket = null, hello = null, signal = null, heard = 0, opened = 0, over = false, asked = "", tick = -1, advanced = 0, shown = 0;
let band = null, stride = "", counter = -1, points = [], folded = null, before = NaN;

// Link

function connect() {
  opened = performance.now();
  const made = socket = new WebSocket(`ws${location.protocol === "https:" ? "s" : ""}://${location.host}/watching`);
  made.binaryType = "arraybuffer";
  made.onopen = () => { if (token) made.send(token); };
  made.onmessage = (message) => {
    if (made !== socket) return;
    heard = performance.now();
    if (typeof message.data !== "string") takeFrame(new Float64Array(message.data)); else take(JSON.parse(message.data));
  };
  made.onclose = () => { if (made === socket) socket = null; };
}

const linked = () => performance.now() - heard < LINK_TIMEOUT;

function watch() {
  const now = performance.now();
  if (!socket && now - opened > RECONNECT_PERIOD) connect();
  if (socket && !linked() && now - Math.max(heard, opened) > 4 * LINK_TIMEOUT) { socket.close(); socket = null; }
  const old = over || !linked() || now - advanced > Math.max(LINK_TIMEOUT, 3000 / (hello?.rate ?? 1000));
  document.body.classList.toggle("old", old);
  const text = over ? "The run has ended" : asked === "unsent" ? "STOP was NOT SENT: no link. Use the emergency stop" :
    asked ? "Stop was requested" : !linked() ? (heard ? "No link: this picture is old" : "Connecting…") : old ? "Waiting" :
      "The space bar stops the robot";
  if ($("notice").textContent !== text) $("notice").textContent = text;
  $("notice").classList.toggle("lost", !over && (asked === "unsent" || (heard > 0 && !linked())));
  if (asked === "unsent" && linked() && !over) stop();
}

function stop() {
  const sent = socket?.readyState === WebSocket.OPEN && linked();
  if (sent) socket.send(JSON.stringify({ do: "stop" }));
  asked = sent ? "sent" : "unsent";
}

addEventListener("keydown", (event) => {
  if (event.code !== "Space") return;
  event.preventDefault();
  if (!event.repeat && !over) stop();
}, true);
addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); }, true);

// What is shown

function take(message) {
  if (message.type === "hello") build(message);
  else if (message.type === "status") over = message.over;
}

function build(message) {
  if (hello?.run !== message.run) asked = "";
  hello = message;
  const option = (each) => element("option", { value: each.path }, nameOf(each));
  $("signal").replaceChildren(element("option", { value: "" }, "nothing"), ...hello.signals.map(option));
  $("signal").value = chosen.get("signal") ?? hello.subject;
  $("stride").value = chosen.get("stride") ?? hello.stride;
  const index = hello.signals.findIndex((each) => each.path === $("signal").value), factor = hello.signals[index]?.factor ?? 1;
  const [low, high] = hello.target.map((value) => Number((value * factor).toPrecision(6)));
  $("low").value = chosen.get("low") ?? low ?? "";
  $("high").value = chosen.get("high") ?? high ?? "";
  show();
}

function show() {
  const index = hello.signals.findIndex((each) => each.path === $("signal").value);
  signal = index < 0 ? null : { ...hello.signals[index], index };
  counter = signal && $("stride").value ? nearest(hello.signals, signal.path, ["strides", "phase"], hello.phases) : -1;
  stride = counter < 0 ? "" : $("stride").value;
  const [low, high] = ["low", "high"].map((id) => Number.parseFloat($(id).value));
  band = low < high ? [low, high] : null;
  points = [];
  folded = null;
  before = NaN;
  $("name").textContent = signal ? nameOf(signal) : hello.name.replaceAll("_", " ");
  document.title = `${$("name").textContent} – Tickwork`;
  const unit = signal?.shown ? (signal.shown.startsWith("°") ? signal.shown : ` ${signal.shown}`) : "";
  $("goal").textContent = [stride ? $("stride").selectedOptions[0].text.replace("its", "the") + " of each stride" :
    signal && $("stride").value ? "this leg has no strides: the value now" : "",
  band ? `target ${number(low, digits(low))} to ${number(high, digits(high))}${unit}` : ""].filter(Boolean).join(", ");
  $("value").lastElementChild.textContent = unit;
  $("choice").open = !signal;
  showValue(NaN);
}

function takeFrame(doubles) {
  if (!hello) return;
  const count = hello.signals.length, head = doubles.length - 3 * count;
  const [values, first, second] = [0, 1, 2].map((place) => doubles.subarray(head + place * count, head + (place + 1) * count));
  if (doubles[0] === tick) return;
  tick = doubles[0];
  advanced = performance.now();
  if (!signal || tick < 0) return;
  const time = tick / hello.rate, value = values[signal.index] * signal.factor;
  if (stride) {
    const now = values[counter], ended = hello.signals[counter].path.endsWith(".strides") ? now > before : before - now > WRAP;
    if (ended) {
      if (folded !== null) points.push([time, (FOLD[stride][2] ?? ((so) => so))(folded)]);
      folded = FOLD[stride][0]();
    }
    before = now;
    const ticks = stride === "maximum" || stride === "minimum" ? [first, second, values] : [values];   // each spike counts
    for (const each of folded === null ? [] : ticks)
      if (Number.isFinite(each[signal.index])) folded = FOLD[stride][1](folded, each[signal.index] * signal.factor);
    points = points.slice(-STRIDES);
  } else {
    points.push([time, value]);
    while (points[0][0] < time - SPAN) points.shift();
  }
  if (advanced - shown > TEXT_PERIOD) {
    shown = advanced;
    showValue(points.at(-1)?.[1] ?? NaN);
  }
  draw(time);
}

function showValue(value) {
  const known = Number.isFinite(value) && signal;
  const text = known ? (signal.labels?.length || signal.dtype === "bool" ? withUnit(value, signal) : number(value, digits(value))) : "–";
  if ($("value").firstElementChild.textContent !== text) $("value").firstElementChild.textContent = text;
  const place = known && band ? Math.sign(value - Math.min(band[1], Math.max(band[0], value))) : null;
  const word = place === null ? "" : place > 0 ? "▼ less" : place < 0 ? "▲ more" : "✓ in the target";
  document.body.classList.toggle("inside", place === 0);
  document.body.classList.toggle("outside", place === 1 || place === -1);
  if ($("word").textContent !== word) $("word").textContent = word;
}

// Decimals: those that the width of the band needs, two significant ones without a band.
function digits(value) {
  const size = band ? (band[1] - band[0]) / 4 : Math.abs(value) / 20 || 1;
  return Math.min(3, Math.max(0, Math.ceil(-Math.log10(size))));
}

// Picture

function draw(time) {
  const canvas = $("picture"), ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(name);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const values = points.map(([, value]) => value).filter(Number.isFinite);
  if (!values.length && !band) return;
  const room = band ? MARGIN * (band[1] - band[0]) : 0;
  let low = Math.min(...values, ...(band ? [band[0] - room] : [])), high = Math.max(...values, ...(band ? [band[1] + room] : []));
  if (high - low < LEAST_SPAN) { low -= 1; high += 1; }
  const size = Math.max(4, Math.min(width, height) * 0.022), font = Math.max(14, Math.min(width, height) * 0.045);
  pen.font = `${font}px system-ui, sans-serif`;
  const texts = band ? band.map((end) => number(end, digits(end))) : [];
  const left = Math.max(0, ...texts.map((text) => pen.measureText(text).width)) + (band ? 0.6 * font : 0);
  const y = (value) => height - 2 * size - ((value - low) / (high - low)) * (height - 4 * size);
  const x = stride ? (_, place) => left + (width - left - size) * ((place + 0.5 + STRIDES - points.length) / STRIDES) :
    ([at]) => left + (width - left - 2 * size) * (1 - (time - at) / SPAN);
  if (band) {
    pen.fillStyle = colour("--band");
    pen.fillRect(left, y(band[1]), width - left, y(band[0]) - y(band[1]));
    pen.fillStyle = pen.strokeStyle = colour("--edge");
    pen.lineWidth = Math.max(2, size / 4);
    pen.textBaseline = "middle";
    band.forEach((end, place) => {
      pen.beginPath();
      pen.moveTo(left, y(end));
      pen.lineTo(width, y(end));
      pen.stroke();
      pen.fillText(texts[place], 0, y(end));
    });
  }
  pen.strokeStyle = stride ? colour("--line") : colour("--text");
  pen.lineWidth = stride ? Math.max(2, size / 3) : Math.max(3, size / 2);
  pen.lineJoin = "round";
  pen.beginPath();
  points.forEach((point, place) => pen.lineTo(x(point, place), y(point[1])));
  pen.stroke();
  points.forEach((point, place) => {
    const newest = place === points.length - 1, inside = !band || (point[1] >= band[0] && point[1] <= band[1]);
    if (!stride && !newest) return;
    pen.fillStyle = !band ? colour("--text") : inside ? colour("--inside") : colour("--outside");
    pen.beginPath();
    pen.arc(x(point, place), y(point[1]), newest ? 2 * size : 1.2 * size, 0, 2 * Math.PI);
    pen.fill();
  });
}

// Choice on the page, which stays in its address

document.querySelector("form").addEventListener("submit", (event) => {
  event.preventDefault();
  for (const id of ["signal", "stride", "low", "high"]) chosen.set(id, $(id).value);
  history.replaceState(null, "", `?${chosen}${location.hash}`);
  show();
});

setInterval(watch, 50);
connect();
