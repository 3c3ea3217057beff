// Plots of the last seconds: signals of one port and unit share a plot, so that left and right can be compared.
import { element, nearest, number, withUnit } from "./text.js";

const KEPT = 60;            // s
const PARTS = 3;            // samples of a frame: the extremes of its ticks, and the newest one
const SAMPLES = 30 * PARTS * KEPT;
const BINS = 50;            // of a stride
const AVERAGE_PERIOD = 1000;  // ms
const PLOT_LIMIT = 12;
const FIRST = ["position", "torque"];  // of actuators, plotted at the start
const HEIGHT = 210;         // px
export const UNITS = { "°": "degrees", "°/s": "degrees per second" };
// Okabe and Ito: colours that people with any kind of colour vision can tell apart; each also has a dash of its own
export const LIGHT = ["#0072b2", "#d55e00", "#007a5a", "#a3487f", "#8a6d00", "#3a3f45"];
export const DARK = ["#56b4e9", "#f0883e", "#2fc79c", "#e39ac6", "#f0e442", "#d5dae1"];
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [1, 5]];

const shown = (plot, value) => (value === null || value === undefined ? "–" : number(value));

export class Plots {
  // due(): asks for the parts to be drawn
  constructor(place, list, filter, due) {
    this.place = place; this.list = list; this.filter = filter; this.due = due;
    this.charts = new Map(); this.span = 10; this.paused = false; this.count = 0; this.zoomed = false; this.average = false;
    filter.addEventListener("input", () => this.find());
    const note = (notes, take) => {
      for (const each of notes) { const chart = this.charts.get(each.target.dataset.key); if (chart) take(chart, each); }
      this.due();
    };
    this.sizes = new ResizeObserver((notes) => note(notes, (chart, { contentRect }) => { chart.width = Math.floor(contentRect.width); }));
    this.sights = new IntersectionObserver((notes) => note(notes, (chart, { isIntersecting }) => { chart.seen = isIntersecting; }));
  }

  build(hello) {
    this.hello = hello;
    this.count = 0;
    this.times = new Float64Array(2 * SAMPLES);
    this.columns = hello.signals.map(() => new Float64Array(2 * SAMPLES));
    this.phases = hello.signals.map(({ path }) => nearest(hello.signals, path, ["phase"], hello.phases));
    this.walks = this.phases.map((phase) => {
      const path = hello.signals[phase]?.path;
      return hello.signals.findIndex((each) => path && each.path === (hello.phases[path] || path.replace(/phase$/, "walking")));
    });
    this.strides = this.phases.some((phase) => phase >= 0);
    this.averages = new Map();
    this.marks = [];  // {time in s, text} of each mark
    this.cells = [];
    this.clear();
    this.list.replaceChildren();
    let block = null;
    hello.signals.forEach((signal, index) => {
      if (signal.block !== block) this.list.append(element("li", {}, element("h3", {}, block = signal.block)));
      const box = element("input", { type: "checkbox" }), value = element("span", { className: "live" });
      box.addEventListener("change", () => this.toggle(index, box.checked));
      const label = element("label", { title: signal.path }, box, element("span", {}, signal.port), value);
      const item = element("li", {}, label);
      item.dataset.path = signal.path;
      this.list.append(item);
      this.cells.push({ box, value, item, words: `${signal.path} ${signal.block} ${signal.port}`.toLowerCase() });
    });
    const places = new Map(hello.signals.map((signal, index) => [signal.path, index]));
    for (const port of FIRST)
      for (const { path, limits } of hello.signals)
        if (limits && path.endsWith(".torque") && places.has(path.replace(/torque$/, port)))
          this.toggle(places.get(path.replace(/torque$/, port)), true);
  }

  // time in s; values: of all signals; first, second: their extremes since the frame before, in the order of time
  add(time, values, first, second) {
    const last = this.count - 1, step = (time - this.times[last]) / PARTS;
    if (first && last >= 0 && step > 0) {
      const begin = this.times[last], before = this.columns.map((column) => column[last]);
      for (let part = 1; part < PARTS; part += 1)
        this.push(begin + part * step, (index, factor) => {
          const from = before[index], to = values[index] * factor, a = first[index] * factor, b = second[index] * factor;
          const extreme = Math.min(a, b) < Math.min(from, to) || Math.max(a, b) > Math.max(from, to);
          return extreme || this.hello.signals[index].dtype !== "float" ? (part === 1 ? a : b) : from + ((to - from) * part) / PARTS;
        });
    }
    this.push(time, (index, factor) => values[index] * factor);
  }

  push(time, read) {
    if (this.count === 2 * SAMPLES) {
      for (const column of [this.times, ...this.columns]) column.copyWithin(0, SAMPLES);
      this.count = SAMPLES;
    }
    this.times[this.count] = time;
    this.columns.forEach((column, index) => { column[this.count] = read(index, this.hello.signals[index].factor); });
    this.count += 1;
  }

  // Largest value of a signal in the last seconds, each spike counted.
  largest(index, seconds) {
    let largest = -Infinity;
    for (let place = this.count - 1; place >= 0 && this.times[place] > this.times[this.count - 1] - seconds; place -= 1)
      if (this.columns[index][place] > largest) largest = this.columns[index][place];
    return largest;
  }

  keyOf(index) {
    const { port, shown } = this.hello.signals[index];
    return `${port}${shown ? ` (${shown})` : ""}`;
  }

  toggle(index, on) {
    const key = this.keyOf(index);
    if (on && !this.charts.has(key) && this.charts.size >= PLOT_LIMIT) { this.cells[index].box.checked = false; return; }
    const chart = this.charts.get(key) ?? this.open(key);
    chart.indices = chart.indices.filter((other) => other !== index);
    if (on) chart.indices.push(index);
    this.cells[index].box.checked = on;
    chart.stale = true;
    if (!chart.indices.length) this.close(chart);
    this.due();
  }

  has(index) { return this.cells[index].box.checked; }

  // Plot signals, or no longer if all are plotted.
  toggleAll(indices) {
    const on = !indices.every((index) => this.has(index));
    for (const index of indices) if (this.has(index) !== on) this.toggle(index, on);
  }

  open(key) {
    const remove = element("button", { ariaLabel: `remove the plot of ${key}` }, "Remove"), body = element("div");
    const card = element("section", { className: "card" }, element("div", { className: "title" }, element("h2", {}, key), remove), body);
    const chart = { key, card, body, indices: [], width: 0, seen: false };
    remove.addEventListener("click", () => { for (const index of [...chart.indices]) this.toggle(index, false); });
    body.addEventListener("dblclick", () => { this.zoomed = false; });
    body.dataset.key = key;
    this.charts.set(key, chart);
    this.place.append(card);
    this.sizes.observe(body);
    this.sights.observe(body);
    return chart;
  }

  close(chart) {
    chart.plot?.destroy();
    this.sizes.unobserve(chart.body);
    this.sights.unobserve(chart.body);
    chart.card.remove();
    this.charts.delete(chart.key);
  }

  make(chart) {
    chart.plot?.destroy();
    chart.stale = false;
    const dark = matchMedia("(prefers-color-scheme: dark)").matches, colours = dark ? DARK : LIGHT;
    const axis = { stroke: dark ? "#a3afbd" : "#525c69", grid: { stroke: dark ? "#2c3541" : "#e4e8ed", width: 1 }, ticks: { show: false } };
    const unit = this.hello.signals[chart.indices[0]].shown;
    chart.plot = new uPlot({
      width: chart.width, height: HEIGHT, ms: 1e-3,
      scales: { x: { time: false } },
      cursor: { sync: { key: "tickwork" }, drag: { x: true, y: false } },
      hooks: { setSelect: [() => { this.zoomed = true; }], draw: [(plot) => this.drawMarks(plot, axis.stroke)] },
      axes: [{ ...axis, label: "time (s)", labelSize: 20, size: 34 },
        { ...axis, label: UNITS[unit] || unit || "value", labelSize: 20, size: 52, values: (plot, ticks) => ticks.map((each) => String(each).replace("-", "−")) }],
      series: [{ label: "time", value: (plot, value) => (value === null ? "–" : `${value.toFixed(2)} s`) },
        ...chart.indices.map((index, place) => ({
          label: this.hello.signals[index].block, width: 2,
          stroke: colours[place % colours.length], dash: DASHES[place % DASHES.length], points: { show: false },
          value: shown,
        })),
        ...this.averaged(chart).map((index) => ({
          label: `${this.hello.signals[index].block}, average stride`, width: 1.5, stroke: axis.stroke, dash: [2, 2], points: { show: false },
          value: shown,
        }))],
    }, this.data(chart), chart.body);
  }

  // Vertical lines at the marks.
  drawMarks({ ctx, bbox, valToPos }, colour) {
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([4 * devicePixelRatio, 3 * devicePixelRatio]);
    ctx.textAlign = "left";
    for (const { time, text } of this.marks) {
      const x = valToPos(time, "x", true);
      if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.fillText(text, x + 4 * devicePixelRatio, bbox.top + 12 * devicePixelRatio);
    }
    ctx.restore();
  }

  data(chart) {
    const first = this.start(), from = (column) => column.slice(first, this.count);   // which a paused plot keeps
    return [from(this.times), ...chart.indices.map((index) => from(this.columns[index])),
      ...this.averaged(chart).map((index) => this.overlay(index, first))];
  }

  // Signals of a chart whose average stride is laid over them.
  averaged(chart) { return this.average ? chart.indices.filter((index) => this.phases[index] >= 0) : []; }

  setAverage(on) {
    this.average = on;
    this.rebuild();
    this.zoomed = false;
  }

  // The average stride of a signal at the gait phase of each sample from `first` on.
  overlay(index, first) {
    const phases = this.columns[this.phases[index]], walks = this.columns[this.walks[index]], mean = this.meanOf(index, phases, walks);
    const made = new Array(this.count - first);
    for (let place = first; place < this.count; place += 1) {
      const at = phases[place] * BINS, low = Math.min(BINS - 1, Math.floor(at));
      made[place - first] = at >= 0 && at <= BINS && (!walks || walks[place]) ? mean[low] + (mean[low + 1] - mean[low]) * (at - low) : NaN;
    }
    return made.map((value) => (Number.isFinite(value) ? value : null));
  }

  // Mean of a signal at 0, 1/BINS, ... 1 of the gait phase, over the samples that are kept.
  meanOf(index, phases, walks) {
    const known = this.averages.get(index), now = performance.now();
    if (known && now - known.at < AVERAGE_PERIOD) return known.mean;
    const sums = new Float64Array(BINS + 1), counts = new Float64Array(BINS + 1), column = this.columns[index];
    for (let place = Math.max(0, this.count - SAMPLES); place < this.count; place += 1) {
      const bin = Math.round(phases[place] * BINS);
      if (bin >= 0 && bin <= BINS && Number.isFinite(column[place]) && (!walks || walks[place])) { sums[bin] += column[place]; counts[bin] += 1; }
    }
    [sums[0], counts[0]] = [sums[BINS], counts[BINS]] = [sums[0] + sums[BINS], counts[0] + counts[BINS]];
    const mean = sums.map((sum, bin) => sum / counts[bin]);
    this.averages.set(index, { mean, at: now });
    return mean;
  }

  // Index of the first sample that is shown.
  start() {
    const begin = this.times[this.count - 1] - this.span;
    let first = Math.max(0, this.count - SAMPLES);
    while (first < this.count - 1 && this.times[first] < begin) first += 1;
    return first;
  }

  // What is to be drawn, as functions, one for each plot.
  parts() {
    return [...this.charts.values()].filter((chart) => chart.width && (chart.seen || chart.stale)).map((chart) => () => this.draw(chart));
  }

  draw(chart) {
    if (this.charts.get(chart.key) !== chart || !this.count) return;
    if (chart.stale) this.make(chart);
    else if (chart.width !== chart.plot.width) chart.plot.setSize({ width: chart.width, height: HEIGHT });
    else if (!this.paused && !this.zoomed) chart.plot.setData(this.data(chart));
  }

  showValues(values) {
    this.cells.forEach(({ value, item }, index) => {
      if (!item.hidden) value.textContent = withUnit(values[index], this.hello.signals[index]);
    });
  }

  pause() {
    this.paused = !this.paused;
    if (!this.paused) this.zoomed = false;
    return this.paused;
  }

  setSpan(seconds) { this.span = seconds; this.zoomed = false; this.due(); }

  clear() { for (const chart of [...this.charts.values()]) for (const index of [...chart.indices]) this.toggle(index, false); }

  find() {
    const words = this.filter.value.toLowerCase().split(/\s+/);
    for (const cell of this.cells) cell.item.hidden = !words.every((word) => cell.words.includes(word));
  }

  rebuild() {
    for (const chart of this.charts.values()) chart.stale = true;
    this.due();
  }
}
