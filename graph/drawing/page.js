// The page around a drawing: pan, zoom, search, fold, and a card for each block. Needs fold.js and card.js; no network, no library.

const data = JSON.parse(document.getElementById("data").textContent);
const { drawing, cards, elements, families } = data;
const canvas = document.getElementById("canvas");
const scene = document.getElementById("scene");
const panel = document.getElementById("card");
const search = document.getElementById("search");
const results = document.getElementById("results");
const NAMESPACE = "http://www.w3.org/2000/svg";
const byPath = (list) => new Map(list.map((thing) => [thing.path, thing]));
const boxes = byPath(drawing.boxes), frames = byPath(drawing.frames);
const folded = new Set();
const blockOf = (path) => path?.replace(/=command$/, "");       // of a box
const boxOf = (path) => elements[path] ?? path;                // of a block
let view = { x: 0, y: 0, k: 1 };
let map = { x: (v) => v, y: (v) => v };         // from the drawing to where things lie now,
let goal = map, moves = 0;                      // and to where they are on their way to
let chosen = null, fitted = null;

function onEnter(group, act) {
  group.addEventListener("keydown", (event) => {
    if (event.target !== group || (event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    act();
  });
}

const find = (kind, path) => scene.querySelector(`.${kind}[data-path="${CSS.escape(path)}"]`);

// View

function look(next) {
  view = { ...next, k: Math.min(6, Math.max(0.04, next.k)) };
  scene.setAttribute("transform", `translate(${view.x} ${view.y}) scale(${view.k})`);
}

function room() {
  const bounds = canvas.getBoundingClientRect();
  return { width: bounds.width - (panel.hidden ? 0 : panel.offsetWidth), height: bounds.height };
}

function fit() {
  const { width, height } = room();
  const w = goal.x(drawing.width), h = goal.y(drawing.height);
  const top = 48, bottom = 30;
  const k = Math.min(width / w, (height - top - bottom) / h, 1.6);
  look({ x: (width - w * k) / 2, y: top + (height - top - bottom - h * k) / 2, k });
  fitted = view;
}

function zoom(factor, x = room().width / 2, y = room().height / 2) {
  const k = Math.min(6, Math.max(0.04, view.k * factor));
  look({ x: x - ((x - view.x) * k) / view.k, y: y - ((y - view.y) * k) / view.k, k });
}

// Bring a block into view, if it is not there already, large enough to read.
function bring(path) {
  const box = boxes.get(path), { width, height } = room();
  const left = view.x + goal.x(box.x) * view.k, top = view.y + goal.y(box.y) * view.k;
  if (view.k > 0.5 && left > 0 && top > 48 && left + box.width * view.k < width && top + box.height * view.k < height) return;
  const k = Math.max(view.k, 0.8);
  look({ x: width / 2 - (goal.x(box.x) + box.width / 2) * k, y: height / 2 - (goal.y(box.y) + box.height / 2) * k, k });
}

const pointers = new Map();
let dragged = false;
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (event.shiftKey) look({ ...view, x: view.x - event.deltaY - event.deltaX });
  else zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), event.clientX, event.clientY);
}, { passive: false });
canvas.addEventListener("pointerdown", (event) => {
  pointers.set(event.pointerId, event);
  dragged = pointers.size > 1;
});
window.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
  const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
  if (!dragged && Math.hypot(dx, dy) < 4) return;
  dragged = true;
  if (other) {
    const apart = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY) || 1;
    zoom(apart(event) / apart(before), (event.clientX + other.clientX) / 2, (event.clientY + other.clientY) / 2);
  } else look({ ...view, x: view.x + dx, y: view.y + dy });
  pointers.set(event.pointerId, event);
});
for (const name of ["pointerup", "pointercancel"]) window.addEventListener(name, (event) => pointers.delete(event.pointerId));

// Fold

// What stands at places of its own, with the places it has in the drawing.
const originals = [...scene.querySelectorAll(":scope > path, :scope > circle, .frame > *")].map((item) => {
  const names = ["x", "y", "cx", "cy"].filter((name) => item.hasAttribute(name));
  return { item, d: item.getAttribute("d"), places: names.map((name) => [name, +item.getAttribute(name)]) };
});
const need = {};

function label(frame, pin) {
  const inward = pin.side !== "out", prefix = frame.path.replace(/=\d+/g, "");
  const text = document.createElementNS(NAMESPACE, "text");
  text.setAttribute("class", inward ? "port pin" : "port pin end");
  text.setAttribute("x", pin.x + (inward ? 9 : -9));
  text.setAttribute("y", pin.y + 3.8);
  text.textContent = pin.side === "enabled" ? "" : inward ? pin.signal : pin.signal.slice(prefix.length + 1);
  return text;
}

function prepareFrames() {
  scene.classList.add("measuring");               // text that is not displayed has no length
  for (const frame of drawing.frames) {
    const group = find("frame", frame.path);
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-expanded", "true");
    group.setAttribute("aria-label", `subsystem ${frame.path}`);
    const widest = { in: 0, out: 0, enabled: 0 };
    for (const pin of frame.pins) {
      const text = label(frame, pin);
      group.append(text);
      widest[pin.side] = Math.max(widest[pin.side], text.getComputedTextLength());
      originals.push({ item: text, d: null, places: [["x", pin.x], ["y", pin.y]], beside: [+text.getAttribute("x") - pin.x, 3.8] });
    }
    const heading = [...group.querySelectorAll(".title, .note")].reduce((sum, text) => sum + text.getComputedTextLength(), 0);
    need[frame.path] = { width: Math.max(heading + 60, widest.in + widest.out + 44), height: drawing.head + 14 };
    group.addEventListener("click", (event) => {
      if (!dragged && (folded.has(frame.path) || event.target.closest(".head"))) fold(frame.path, !folded.has(frame.path));
    });
    onEnter(group, () => fold(frame.path, !folded.has(frame.path)));
  }
  scene.classList.remove("measuring");
}

function show() {
  for (const { item, d, places, beside } of originals) {
    if (d) item.setAttribute("d", mapPath(d, map));
    places.forEach(([name, value], i) => {
      item.setAttribute(name, (name.endsWith("x") ? map.x(value) : map.y(value)) + (beside ? beside[i] : 0));
    });
  }
  for (const box of drawing.boxes) find("box", box.path).setAttribute("transform", `translate(${map.x(box.x)} ${map.y(box.y)})`);
}

function hideFolded() {
  for (const item of scene.querySelectorAll("[data-in]")) item.classList.toggle("hidden", isHidden(item.dataset.in, folded));
  for (const box of drawing.boxes) find("box", box.path).classList.toggle("hidden", isHidden(box.subsystem, folded));
  for (const frame of drawing.frames) {
    const group = find("frame", frame.path);
    group.classList.toggle("hidden", isHidden(frame.subsystem, folded));
    group.classList.toggle("folded", folded.has(frame.path));
    group.setAttribute("aria-expanded", String(!folded.has(frame.path)));
  }
}

function fold(path, shut) {
  if (shut) folded.add(path); else folded.delete(path);
  refold(path);
}

// Move everything to where it belongs now; the head of the frame at `anchor` stays under the pointer.
function refold(anchor) {
  const before = map, after = (goal = squeeze(drawing, folded, need)), move = ++moves;
  const frame = frames.get(anchor), start = performance.now(), from = view;
  hideFolded();
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches || document.hidden;
  function frameAt(now) {
    if (move !== moves) return;                   // it has ended, or another has begun
    const share = still ? 1 : Math.min(1, Math.max(0, (now - start) / 220)), ease = share * (2 - share);
    const mix = (a, b) => (v) => a(v) + (b(v) - a(v)) * ease;
    map = share < 1 ? { x: mix(before.x, after.x), y: mix(before.y, after.y) } : after;
    show();
    const moved = (axis) => (frame ? (before[axis](frame[axis]) - map[axis](frame[axis])) * from.k : 0);
    if (frame) look({ ...from, x: from.x + moved("x"), y: from.y + moved("y") });
    if (share < 1) requestAnimationFrame(frameAt); else moves++;
  }
  frameAt(start);
  setTimeout(frameAt, 300, Infinity);               // where nothing is painted, no frame comes
}

function foldAll(shut) {
  folded.clear();
  if (shut) drawing.frames.forEach((frame) => folded.add(frame.path));
  refold(null);
  fit();
}

function reveal(path) {
  const shut = [...folded].filter((frame) => within(boxes.get(path).subsystem, frame));
  shut.forEach((frame) => folded.delete(frame));
  if (shut.length) refold(null);
}

// The chosen block

function choose(path, go = false) {
  if (chosen) find("box", boxOf(chosen)).classList.remove("chosen");
  chosen = cards[blockOf(path)] ? path : null;
  panel.hidden = !chosen;
  if (!chosen) return history.replaceState(null, "", location.pathname + location.search);
  reveal(boxOf(path));
  find("box", boxOf(path)).classList.add("chosen");
  panel.replaceChildren(...card(cards[blockOf(path)]));
  panel.scrollTop = 0;
  history.replaceState(null, "", "#" + encodeURIComponent(path));
  if (go) bring(boxOf(path));
}

function prepareBoxes() {
  for (const box of drawing.boxes) {
    const group = find("box", box.path);
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-label", `${cards[blockOf(box.path)].type} ${box.path}`);
    group.addEventListener("click", () => dragged || choose(box.path));
    onEnter(group, () => choose(box.path));
  }
  for (const item of scene.querySelectorAll("[data-signal]")) {
    const all = scene.querySelectorAll(`[data-signal="${CSS.escape(item.dataset.signal)}"]`);
    item.addEventListener("pointerenter", () => all.forEach((part) => part.classList.add("lit")));
    item.addEventListener("pointerleave", () => all.forEach((part) => part.classList.remove("lit")));
  }
}

// Search

function matches(wanted) {
  const words = wanted.toLowerCase().split(/\s+/).filter(Boolean);
  if (!words.length) return [];
  const text = (block) => [block.path, block.type, families[block.family].title, block.summary, ...ports(block)].join(" ").toLowerCase();
  const ports = (block) => block.inputs.concat(block.outputs).map((port) => port.name);
  const rank = (block) => (block.path.toLowerCase().includes(words[0]) ? 0 : 1);
  return Object.values(cards).filter((block) => words.every((word) => text(block).includes(word))).sort((a, b) => rank(a) - rank(b));
}

function searched() {
  const found = matches(search.value);
  const paths = new Set(found.map((block) => boxOf(block.path)));
  scene.classList.toggle("searching", search.value.trim() !== "");
  for (const box of drawing.boxes) find("box", box.path).classList.toggle("match", paths.has(blockOf(box.path)));
  const item = (block) => element("li", { onclick: () => pick(block.path) }, element("b", {}, block.path), ` ${block.type}`);
  results.replaceChildren(...found.slice(0, 12).map(item));
  if (search.value.trim() && !found.length) results.replaceChildren(element("li", { class: "none" }, "no block has that"));
  return found;
}

function pick(path) {
  search.value = "";
  searched();
  search.blur();
  choose(path, true);
}

search.addEventListener("input", searched);
search.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && matches(search.value).length) pick(matches(search.value)[0].path);
});

document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { search.value = ""; searched(); search.blur(); choose(null); }
  if (event.target === search || event.ctrlKey || event.metaKey || event.altKey) return;
  const act = { "/": () => search.focus(), 0: fit, "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8),
    ArrowLeft: () => look({ ...view, x: view.x + 60 }), ArrowRight: () => look({ ...view, x: view.x - 60 }),
    ArrowUp: () => look({ ...view, y: view.y + 60 }), ArrowDown: () => look({ ...view, y: view.y - 60 }) }[event.key];
  if (act) { event.preventDefault(); act(); }
});
const buttons = { fit, closer: () => zoom(1.25), further: () => zoom(0.8), fold: () => foldAll(true), unfold: () => foldAll(false) };
Object.entries(buttons).forEach(([id, act]) => document.getElementById(id).addEventListener("click", act));
window.addEventListener("resize", () => view === fitted && fit());

prepareFrames();
prepareBoxes();
drawing.frames.filter((frame) => frame.like).forEach((frame) => folded.add(frame.path));
map = goal = squeeze(drawing, folded, need);
hideFolded();
show();
if (location.hash) choose(decodeURIComponent(location.hash.slice(1)));
fit();
if (chosen) bring(boxOf(chosen));
