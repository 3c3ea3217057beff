// Plots of the last seconds: signals of one port and unit share a plot, so that left and right can be compared.
import { element, number, withUnit } from "./text.js";

const KEPT = 60;            // s
const SAMPLES = 30 * KEPT;
const PLOT_LIMIT = 12;
const FIRST = ["position", "torque"];  // of actuators, plotted at the start
const HEIGHT = 210;         // px
const UNITS = { "°": "degrees", "°/s": "degrees per second" };
// Okabe and Ito: colours that people with any kind of colour vision can tell apart; each also has a dash of its own
const LIGHT = ["#0072b2", "#d55e00", "#007a5a", "#a3487f", "#8a6d00", "#3a3f45"];
const DARK = ["#56b4e9", "#f0883e", "#2fc79c", "#e39ac6", "#f0e442", "#d5dae1"];
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [1, 5]];

export class Plots {
  constructor(place, list, filter) {
    this.place = place; this.list = list; this.filter = filter;
    this.charts = new Map(); this.span = 10; this.paused = false; this.count = 0; this.zoomed = false;
    filter.addEventListener("input", () => this.find());
  }

  build(hello) {
    this.hello = hello;
    this.count = 0;
    this.times = new Float64Array(2 * SAMPLES);
    this.columns = hello.signals.map(() => new Float64Array(2 * SAMPLES));
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

  // time in s; values: of all signals
  add(time, values) {
    if (this.count === 2 * SAMPLES) {
      for (const column of [this.times, ...this.columns]) column.copyWithin(0, SAMPLES);
      this.count = SAMPLES;
    }
    this.times[this.count] = time;
    this.columns.forEach((column, index) => { column[this.count] = values[index] * this.hello.signals[index].factor; });
    this.count += 1;
  }

  keyOf(index) {
    const { port, shown } = this.hello.signals[index];
    return `${port}${shown ? ` (${shown})` : ""}`;
  }

  toggle(index, on) {
    const key = this.keyOf(index), chart = this.charts.get(key) || { indices: [] };
    if (on && !this.charts.has(key) && this.charts.size >= PLOT_LIMIT) { this.cells[index].box.checked = false; return; }
    chart.indices = chart.indices.filter((other) => other !== index);
    if (on) chart.indices.push(index);
    this.cells[index].box.checked = on;
    this.charts.set(key, chart);
    this.make(key);
  }

  make(key) {
    const chart = this.charts.get(key);
    chart.plot?.destroy();
    if (!chart.indices.length) {
      chart.card.remove();
      this.charts.delete(key);
      return;
    }
    if (!chart.card) {
      const remove = element("button", { ariaLabel: `remove the plot of ${key}` }, "Remove");
      remove.addEventListener("click", () => { for (const index of [...chart.indices]) this.toggle(index, false); });
      chart.body = element("div");
      chart.card = element("section", { className: "card" },
        element("div", { className: "title" }, element("h2", {}, key), remove), chart.body);
      this.place.append(chart.card);
    }
    const dark = matchMedia("(prefers-color-scheme: dark)").matches, colours = dark ? DARK : LIGHT;
    const axis = { stroke: dark ? "#a3afbd" : "#525c69", grid: { stroke: dark ? "#2c3541" : "#e4e8ed", width: 1 }, ticks: { show: false } };
    const unit = this.hello.signals[chart.indices[0]].shown;
    chart.plot = new uPlot({
      width: Math.max(200, chart.body.clientWidth), height: HEIGHT, ms: 1e-3,
      scales: { x: { time: false } },
      cursor: { sync: { key: "tickwork" }, drag: { x: true, y: false } },
      hooks: { setSelect: [() => { this.zoomed = true; }] },
      axes: [{ ...axis, label: "time (s)", labelSize: 20, size: 34 },
        { ...axis, label: UNITS[unit] || unit || "value", labelSize: 20, size: 52, values: (plot, ticks) => ticks.map((each) => String(each).replace("-", "−")) }],
      series: [{ label: "time", value: (plot, value) => (value === null ? "–" : `${value.toFixed(2)} s`) },
        ...chart.indices.map((index, place) => ({
          label: this.hello.signals[index].block, width: 2,
          stroke: colours[place % colours.length], dash: DASHES[place % DASHES.length], points: { show: false },
          value: (plot, value) => (value === null || value === undefined ? "–" : number(value)),
        }))],
    }, this.data(chart), chart.body);
    chart.body.addEventListener("dblclick", () => { this.zoomed = false; });
  }

  data(chart) {
    const first = this.start(), from = (column) => column.subarray(first, this.count);
    return [from(this.times), ...chart.indices.map((index) => from(this.columns[index]))];
  }

  // Index of the first sample that is shown.
  start() {
    const begin = this.times[this.count - 1] - this.span;
    let first = Math.max(0, this.count - SAMPLES);
    while (first < this.count - 1 && this.times[first] < begin) first += 1;
    return first;
  }

  draw() {
    if (this.paused || this.zoomed || !this.count) return;
    for (const chart of this.charts.values()) chart.plot.setData(this.data(chart));
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

  setSpan(seconds) { this.span = seconds; this.zoomed = false; this.draw(); }

  clear() { for (const chart of [...this.charts.values()]) for (const index of [...chart.indices]) this.toggle(index, false); }

  find() {
    const words = this.filter.value.toLowerCase().split(/\s+/);
    for (const cell of this.cells) cell.item.hidden = !words.every((word) => cell.words.includes(word));
  }

  rebuild() { for (const key of [...this.charts.keys()]) this.make(key); }

  resize() {
    for (const chart of this.charts.values())
      if (chart.body.clientWidth) chart.plot.setSize({ width: chart.body.clientWidth, height: HEIGHT });
    this.draw();
  }
}
