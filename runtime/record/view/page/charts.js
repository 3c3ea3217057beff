// Plots: uPlot draws the axes, and the curves are drawn here from pieces of any level of detail.
import { DARK, DASHES, LIGHT, UNITS } from "./plots.js";
import { extent, trace, valueAt, visible } from "./source.js";
import { capital, element, number, withUnit } from "./text.js";

export const HEIGHT = 200;   // px
const SPARSE = 8;            // px between samples, from which each is drawn as a dot
const LINE_LIMIT = 60;
const KINDS = ["mark", "change", "warning", "fault"];   // of events that are lines in the plots
const STEPS = [1e-3, 2e-3, 5e-3, .01, .02, .05, .1, .2, .5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 18000];

const scheme = matchMedia("(prefers-color-scheme: dark)");
let known = null;
scheme.addEventListener("change", () => { known = null; });
export const colours = () => (scheme.matches ? DARK : LIGHT);

export function theme() { return known ||= readTheme(); }

function readTheme() {
  const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(`--${name}`).trim();
  return { text: of("text"), soft: of("soft"), line: of("line"), accent: of("accent"), bad: of("bad"), card: of("card"),
    mark: of("accent"), change: of("soft"), warning: of("warning"), fault: of("bad") };
}

// A time in s as text; digits: decimals of the seconds
export function timeText(seconds, digits = 1) {
  const size = Math.abs(seconds), sign = seconds < -1e-9 ? "−" : "";
  if (size < 60) return `${sign}${size.toFixed(digits)} s`;
  const whole = Number(size.toFixed(digits)), hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  const rest = (whole % 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return hours ? `${sign}${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${sign}${minutes}:${rest}`;
}

// Labels of a time axis: seconds, or minutes and seconds where the numbers become large.
export function timeLabels(ticks, long) {
  const step = ticks.length > 1 ? ticks[1] - ticks[0] : 1, digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  if (!long) return ticks.map((tick) => tick.toFixed(digits).replace("-", "−"));
  return ticks.map((tick) => (Math.abs(tick) < 60 ? `${tick < 0 ? "−" : ""}0:${Math.abs(tick).toFixed(digits).padStart(digits ? 3 + digits : 2, "0")}` :
    timeText(tick, digits)));
}
export const isLong = (begin, end) => Math.max(Math.abs(begin), Math.abs(end)) >= 120;
export const timeLabel = (long) => (long ? "time (min:s)" : "time (s)");
export const axisLabel = (signal) => (signal.dtype === "bool" ? "yes or no" : UNITS[signal.shown] || signal.shown || "value");

// A dot of a legend: the line as it is drawn.
export function swatch(place) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(svg.namespaceURI, "line");
  for (const [name, value] of Object.entries({ width: 28, height: 8, "aria-hidden": "true" })) svg.setAttribute(name, value);
  for (const [name, value] of Object.entries({ x1: 1, x2: 27, y1: 4, y2: 4, "stroke-width": 2.5, "stroke-dasharray": DASHES[place % DASHES.length].join(" "), stroke: colours()[place % LIGHT.length] }))
    line.setAttribute(name, value);
  svg.append(line);
  return svg;
}

// Frame of one plot: a card with title, legend and axes. What is inside is drawn by `paint`.
export class Frame {
  constructor(place, { title, xLabel, yLabel, names, places, xValues, ySplits, incrs, remove, paint }) {
    Object.assign(this, { title, yLabel, names, paint });
    this.heading = element("h3", {}, title);
    const head = element("div", { className: "title" }, this.heading);
    if (remove) {
      const button = element("button", { ariaLabel: `remove the plot of ${title}`, title: "Remove" }, "×");
      button.addEventListener("click", remove);
      head.append(button);
    }
    this.values = names.map(() => element("span", { className: "value" }));
    this.legend = element("ul", { className: "legend" }, ...names.map((name, index) =>
      element("li", {}, swatch(places ? places[index] : index), element("span", {}, name), this.values[index])));
    this.body = element("div", { className: "plot", role: "img", ariaLabel: title });
    this.card = element("section", { className: "card chart" }, head, this.legend, this.body);
    place.append(this.card);
    const colour = theme();
    const axis = { stroke: colour.soft, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
      grid: { stroke: colour.line, width: 1 }, ticks: { show: false } };
    const fixed = { auto: false, range: (plot, low, high) => [low, high] };
    this.plot = new uPlot({
      width: Math.max(200, this.body.clientWidth), height: HEIGHT, legend: { show: false }, ms: 1e-3,
      cursor: { show: false }, padding: [8, 18, 0, 0],
      scales: { x: { time: false, ...fixed }, y: fixed },
      axes: [{ ...axis, label: xLabel, labelSize: 18, size: 26, gap: 5, values: xValues, ...(incrs ? { incrs } : {}) },
        { ...axis, label: yLabel, labelSize: 18, size: 50, gap: 4, splits: ySplits,
          values: (plot, ticks) => ticks.map((tick) => (ySplits && yLabel === "yes or no" ? ["no", "yes"][tick] : String(Number(tick.toPrecision(12))).replace("-", "−"))) }],
      series: [{}, { show: false }],
      hooks: { draw: [(plot) => this.draw(plot)] },
    }, [[0, 1], [null, null]], this.body);
    this.line = element("div", { className: "cursor", hidden: true });
    this.plot.over.append(this.line);
    this.watcher = new ResizeObserver(() => {
      if (this.body.clientWidth) this.plot.setSize({ width: this.body.clientWidth, height: HEIGHT });
    });
    this.watcher.observe(this.body);
  }

  // Show a part of the plane.
  set(begin, end, low, high) {
    Object.assign(this, { begin, end, low, high });
    this.plot.batch(() => {
      this.plot.setScale("x", { min: begin, max: end });
      this.plot.setScale("y", { min: low, max: high });
    });
  }

  draw(plot) {
    if (this.begin === undefined) return;   // uPlot draws once before anything is known
    const { ctx, bbox } = plot, ratio = devicePixelRatio;
    const x = (value) => bbox.left + (value - this.begin) / (this.end - this.begin) * bbox.width;
    const y = (value) => bbox.top + (this.high - value) / (this.high - this.low) * bbox.height;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineJoin = ctx.lineCap = "round";
    this.paint(ctx, x, y, bbox, ratio);
    ctx.restore();
  }

  cursor(time) {
    const inside = time !== null && time >= this.begin && time <= this.end;
    this.line.hidden = !inside;
    if (inside) this.line.style.transform = `translateX(${(time - this.begin) / (this.end - this.begin) * this.plot.over.clientWidth}px)`;
  }

  destroy() { this.watcher.disconnect(); this.plot.destroy(); this.card.remove(); }
}

// A range around values, and round numbers at its ends.
export function rangeOf(low, high) {
  if (!(low <= high)) return [0, 1];
  return uPlot.rangeNum(low, high, 0.1, true);
}

// Signals over time. curves: [{source, index, name}]; world: what all plots have in common (begin, end, lines, gaps)
export class TimeChart {
  constructor(place, title, curves, world, remove) {
    Object.assign(this, { title, curves, world });
    this.signal = curves[0].source.recording.signals[curves[0].index];
    this.stepped = this.signal.dtype !== "float";
    this.visible = true;
    this.shown = []; this.extents = [];   // pieces of the curves, and their [low, high] in the window
    this.frame = new Frame(place, {
      title, names: curves.map((curve) => curve.name), remove, xLabel: timeLabel(isLong(world.begin, world.end)),
      yLabel: axisLabel(this.signal), incrs: STEPS, xValues: (plot, ticks) => timeLabels(ticks, isLong(world.begin, world.end)),
      ySplits: this.signal.dtype === "bool" ? () => [0, 1] : undefined,
      paint: (...given) => this.paint(...given),
    });
    this.frame.plot.axes[0].label = () => timeLabel(isLong(world.begin, world.end));
    this.over = this.frame.plot.over;
    this.range = [0, 1];
  }

  pieces() {
    const { begin, end } = this.world;
    return this.curves.map(({ source, index }) => source.piece(index, begin, end));
  }

  update() {
    const { begin, end } = this.world;
    let [low, high] = [Infinity, -Infinity];
    this.shown = this.pieces();
    this.extents = this.shown.map((piece, place) => {
      const { offset } = this.curves[place].source;
      const found = piece ? extent(piece, begin - offset, end - offset) : [Infinity, -Infinity];
      [low, high] = [Math.min(low, found[0]), Math.max(high, found[1])];
      return found;
    });
    this.range = this.signal.dtype === "bool" ? [-0.15, 1.15] : rangeOf(low, high);
    this.frame.set(begin, end, ...this.range);
  }

  // Events that are lines in the window: marks and faults alone where a slider has made many changes.
  lines() {
    const { begin, end, lines } = this.world;
    const inside = lines.filter((line) => line.time >= begin && line.time <= end && KINDS.includes(line.kind));
    return inside.length > LINE_LIMIT ? inside.filter(({ kind }) => kind === "mark" || kind === "fault") : inside;
  }

  paint(ctx, x, y, box, ratio) {
    const { begin, end, gaps } = this.world, colour = theme(), palette = colours();
    for (const [from, to] of gaps) if (to >= begin && from <= end) {
      ctx.fillStyle = colour.bad;
      ctx.globalAlpha = 0.18;
      ctx.fillRect(x(from), box.top, Math.max(2 * ratio, x(to) - x(from)), box.height);
      ctx.globalAlpha = 1;
    }
    ctx.lineWidth = ratio;
    const limits = this.signal.limits || [];
    ctx.strokeStyle = colour.soft;
    ctx.setLineDash([6 * ratio, 4 * ratio]);
    for (const limit of limits) {
      const at = y(limit * this.signal.factor);
      ctx.beginPath(); ctx.moveTo(box.left, at); ctx.lineTo(box.left + box.width, at); ctx.stroke();
    }
    for (const { time, kind } of this.lines()) {
      ctx.strokeStyle = colour[kind];
      ctx.setLineDash(kind === "fault" ? [] : kind === "mark" ? [5 * ratio, 3 * ratio] : [ratio, 3 * ratio]);
      ctx.lineWidth = (kind === "fault" ? 2 : 1) * ratio;
      ctx.beginPath(); ctx.moveTo(x(time), box.top); ctx.lineTo(x(time), box.top + box.height); ctx.stroke();
    }
    this.shown.forEach((piece, place) => {
      if (!piece || !piece.time.length) return;
      const { offset } = this.curves[place].source, at = (time) => x(time + offset);
      ctx.strokeStyle = ctx.fillStyle = palette[place % palette.length];
      ctx.lineWidth = 1.6 * ratio;
      ctx.setLineDash(DASHES[place % DASHES.length].map((part) => part * ratio));
      ctx.beginPath();
      trace(ctx, piece, begin - offset, end - offset, at, y, this.stepped, 0.8 * ratio);
      const [first, last] = visible(piece, begin - offset, end - offset);
      ctx.globalAlpha = piece.size > 1 && this.shown.length > 1 ? 0.85 : 1;   // a curve behind shows through
      if (piece.size > 1) ctx.fill(); else ctx.stroke();
      ctx.globalAlpha = 1;
      if (piece.size === 1 && at(piece.step) - at(0) > SPARSE * ratio) {
        ctx.setLineDash([]);
        ctx.beginPath();
        for (let i = first; i < last; i += 1) if (piece.low[i] === piece.low[i]) {
          ctx.moveTo(at(piece.time[i]), y(piece.low[i]));
          ctx.arc(at(piece.time[i]), y(piece.low[i]), 2.2 * ratio, 0, 2 * Math.PI);
        }
        ctx.fill();
      }
      ctx.beginPath();       // where it is not a number
      const width = Math.max(ratio, at(piece.size * piece.step) - at(0)), bottom = box.top + box.height - 3 * ratio * (place + 1);
      for (let i = first; i < last; i += 1) if (piece.broken[i]) ctx.rect(at(piece.time[i]), bottom, width, 2 * ratio);
      ctx.globalAlpha = 0.6;
      ctx.fill();
      ctx.globalAlpha = 1;
    });
  }

  // Show the values at the cursor; without one the range in the window.
  showValues(time) {
    this.frame.cursor(time);
    this.curves.forEach(({ source }, place) => { this.frame.values[place].textContent = this.valueText(place, time, source); });
  }

  valueText(place, time, source) {
    const piece = this.shown?.[place];
    if (!piece) return "…";
    const at = time === null ? this.extents[place] : valueAt(piece, time - source.offset);
    const text = (value) => withUnit(value / this.signal.factor, this.signal);
    if (!(at[0] <= at[1])) return "–";
    const [low, high] = at.map(text);
    return low === high ? low : `${low.replace(/ ?[^\d]+$/, "") || low} to ${high}`;
  }

  describe() {
    const { begin, end } = this.world;
    this.frame.body.ariaLabel = `${this.title}, ${timeText(begin)} to ${timeText(end)}: ` +
      this.curves.map((curve, place) => `${curve.name} ${this.valueText(place, null, curve.source)}`).join("; ");
  }

  // The plot for a picture.
  figure() {
    const { begin, end } = this.world;
    return {
      begin, end, range: this.range, yLabel: `${capital(this.title)}${this.signal.shown ? ` (${this.signal.shown})` : ""}`,
      xLabel: timeLabel(isLong(begin, end)), xValues: (ticks) => timeLabels(ticks, isLong(begin, end)), steps: STEPS,
      yValues: this.signal.dtype === "bool" ? { splits: [0, 1], text: (tick) => ["no", "yes"][tick] } : null,
      lines: this.lines(),
      gaps: this.world.gaps.filter(([from, to]) => to >= begin && from <= end),
      limits: (this.signal.limits || []).map((limit) => limit * this.signal.factor),
      curves: this.shown.map((piece, place) => ({
        name: this.curves[place].name, area: Boolean(piece && piece.size > 1),
        trace: (pen, x, y) => {
          const { offset } = this.curves[place].source;
          if (piece) trace(pen, piece, begin - offset, end - offset, (time) => x(time + offset), y, this.stepped, 0.4);
        },
      })),
    };
  }

  destroy() { this.frame.destroy(); }
}

// Averages over the gait cycle, each with a band of one standard deviation. curves: [{name, mean, sd, colour}]
export class StrideChart {
  constructor(place, title, yLabel, curves, range, toeOffs = []) {
    Object.assign(this, { title, yLabel, curves, range, toeOffs });
    this.frame = new Frame(place, {
      title, yLabel, names: curves.map((curve) => curve.name), places: curves.map((curve) => curve.place), xLabel: "gait cycle (%)", incrs: [10, 20, 25, 50],
      xValues: (plot, ticks) => ticks.map(String), paint: (...given) => this.paint(...given),
    });
    const text = (values) => `${number(Math.min(...values))} to ${number(Math.max(...values))}`;
    this.frame.body.ariaLabel = `${title}, ${yLabel}, mean over the gait cycle: ` +
      curves.map(({ name, mean }) => `${name} ${text(mean)}`).join("; ");
    this.frame.set(0, 100, ...range);
  }

  paint(ctx, x, y, box, ratio) {
    const palette = colours(), colour = theme();
    ctx.strokeStyle = colour.soft;
    ctx.lineWidth = ratio;
    ctx.beginPath(); ctx.moveTo(box.left, y(0)); ctx.lineTo(box.left + box.width, y(0)); ctx.stroke();
    ctx.setLineDash([ratio, 3 * ratio]);
    for (const { at, place } of this.toeOffs) {
      ctx.strokeStyle = palette[place % palette.length];
      ctx.beginPath(); ctx.moveTo(x(100 * at), box.top); ctx.lineTo(x(100 * at), box.top + box.height); ctx.stroke();
    }
    this.curves.forEach((curve) => {
      ctx.strokeStyle = ctx.fillStyle = palette[curve.place % palette.length];
      ctx.globalAlpha = 0.2;
      ctx.beginPath(); band(ctx, curve, x, y); ctx.fill();
      ctx.globalAlpha = 1;
      ctx.lineWidth = 2 * ratio;
      ctx.setLineDash(DASHES[curve.place % DASHES.length].map((part) => part * ratio));
      ctx.beginPath(); mean(ctx, curve, x, y); ctx.stroke();
    });
  }

  figure() {
    return {
      begin: 0, end: 100, range: this.range, yLabel: `${capital(this.title)}${this.curves[0].shown ? ` (${this.curves[0].shown})` : ""}`, xLabel: "gait cycle (%)",
      xValues: (ticks) => ticks.map(String), steps: [20], lines: [], gaps: [], limits: [], zero: true,
      toeOffs: this.toeOffs,
      curves: this.curves.map((curve) => ({
        name: curve.name, place: curve.place, trace: (pen, x, y) => mean(pen, curve, x, y), band: (pen, x, y) => band(pen, curve, x, y),
      })),
    };
  }

  destroy() { this.frame.destroy(); }
}

function mean(pen, curve, x, y) {
  curve.mean.forEach((value, percent) => (percent ? pen.lineTo(x(percent), y(value)) : pen.moveTo(x(0), y(value))));
}

function band(pen, curve, x, y) {
  curve.mean.forEach((value, percent) => {
    const to = y(value + curve.sd[percent]);
    if (percent) pen.lineTo(x(percent), to); else pen.moveTo(x(0), to);
  });
  for (let percent = curve.mean.length - 1; percent >= 0; percent -= 1)
    pen.lineTo(x(percent), y(curve.mean[percent] - curve.sd[percent]));
  pen.closePath();
}
