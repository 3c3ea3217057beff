// The plots as one picture for a paper: SVG with text as text, in the width of a column, and PNG made from it.
import { DASHES, LIGHT } from "./plots.js";

const POINT = 72 / 25.4;        // points in a mm
const PLOT = 92, GAP = 16;      // points: height of the axes of a plot, and between plots
const LEFT = 44, RIGHT = 9, TOP = 8, BELOW = 30;
const FONT = 7;                 // points
const INK = "#1a1a1a", SOFT = "#6b6b6b", GRID = "#e3e3e3", MARK = "#0072b2", FAULT = "#b3261e", WARNING = "#8a6d00";
const COLOURS = { mark: MARK, fault: FAULT, warning: WARNING, change: SOFT };
const DPI = 300;

const escape = (text) => String(text).replace(/[&<>"]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" }[sign]));
const round = (value) => Number(value.toFixed(2));
const minus = (text) => text.replace("-", "−");

// A pen whose path is the text of an SVG path.
class Pen {
  constructor() { this.text = []; }
  moveTo(x, y) { this.text.push(`M${round(x)} ${round(y)}`); }
  lineTo(x, y) { this.text.push(`L${round(x)} ${round(y)}`); }
  closePath() { this.text.push("Z"); }
  toString() { return this.text.join(""); }
}

function pathOf(draw, x, y) {
  const pen = new Pen();
  draw(pen, x, y);
  return pen.toString();
}

export function ticksOf(low, high, count, steps) {
  const least = (high - low) / count;
  let step = steps?.find((each) => each >= least);
  if (!step) {
    const size = 10 ** Math.floor(Math.log10(least));
    step = [1, 2, 5, 10].find((each) => each * size >= least * 0.999) * size;
  }
  const ticks = [];
  for (let tick = Math.ceil(low / step - 1e-9) * step; tick <= high + 1e-9 * step; tick += step) ticks.push(Number(tick.toPrecision(12)));
  return ticks;
}

// figures: as `figure` of a chart; columns: of plots; width in mm. Returns the text of the SVG.
export function svg(figures, { width, columns = 1, title = "" }) {
  const total = width * POINT, each = (total - (columns - 1) * GAP) / columns;
  const lines = (figure) => Math.max(1, legendRows(figure, each - LEFT - RIGHT).length);
  const rows = [];
  for (let index = 0; index < figures.length; index += columns) rows.push(figures.slice(index, index + columns));
  const head = Math.max(0, ...figures.map(lines)) * 1.35 * FONT + 4;
  const labelled = (index) => index === rows.length - 1 || columns > 1;
  const heights = rows.map((_, index) => head + PLOT + (labelled(index) ? BELOW : GAP / 2));
  const height = TOP + heights.reduce((sum, each) => sum + each, 0);
  const body = [];
  let top = TOP;
  rows.forEach((row, index) => {
    row.forEach((figure, column) => body.push(plot(figure, column * (each + GAP) + LEFT, top + head, each - LEFT - RIGHT, head, labelled(index), body.length)));
    top += heights[index];
  });
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}mm" height="${round(height / POINT)}mm" viewBox="0 0 ${round(total)} ${round(height)}" ` +
    `font-family="Arial, Helvetica, sans-serif" font-size="${FONT}" fill="${INK}"><title>${escape(title)}</title>` +
    `<rect width="100%" height="100%" fill="#ffffff"/>${body.join("")}</svg>\n`;
}

function legendRows(figure, width) {
  const rows = [[]];
  let used = 0;
  figure.curves.forEach((curve, place) => {
    const size = 22 + 0.55 * FONT * curve.name.length;
    if (used + size > width && used) { rows.push([]); used = 0; }
    rows.at(-1).push({ ...curve, place: curve.place ?? place, at: used, size });
    used += size;
  });
  return rows;
}

function plot(figure, left, top, width, head, labelled, number) {
  const { begin, end, range: [low, high] } = figure;
  const x = (value) => left + (value - begin) / (end - begin) * width, y = (value) => top + (high - value) / (high - low) * PLOT;
  const out = [`<clipPath id="c${number}"><rect x="${round(left)}" y="${round(top)}" width="${round(width)}" height="${PLOT}"/></clipPath>`];
  const line = (x1, y1, x2, y2, stroke, more = "") =>
    out.push(`<line x1="${round(x1)}" y1="${round(y1)}" x2="${round(x2)}" y2="${round(y2)}" stroke="${stroke}" ${more}/>`);
  const text = (at, height, words, more = "") => out.push(`<text x="${round(at)}" y="${round(height)}" ${more}>${escape(words)}</text>`);
  const across = figure.yValues?.splits || ticksOf(low, high, 5), along = ticksOf(begin, end, Math.max(2, width / 28), figure.steps);
  for (const tick of across) {
    line(left, y(tick), left + width, y(tick), GRID, 'stroke-width="0.5"');
    text(left - 4, y(tick) + 0.35 * FONT, figure.yValues ? figure.yValues.text(tick) : minus(String(tick)), 'text-anchor="end"');
  }
  const labels = figure.xValues(along);
  along.forEach((tick, index) => {
    line(x(tick), top + PLOT, x(tick), top + PLOT + 2.5, INK, 'stroke-width="0.6"');
    if (labelled) text(x(tick), top + PLOT + 4 + FONT, labels[index], 'text-anchor="middle"');
  });
  if (labelled) text(left + width / 2, top + PLOT + 8 + 2.2 * FONT, figure.xLabel, 'text-anchor="middle"');
  text(0, 0, figure.yLabel, `text-anchor="middle" font-size="${round(Math.min(FONT, (PLOT + head) / (0.56 * figure.yLabel.length)))}" transform="translate(${round(left - LEFT + FONT + 1)} ${round(top + PLOT / 2)}) rotate(-90)"`);
  out.push(`<g clip-path="url(#c${number})" fill="none" stroke-linejoin="round" stroke-linecap="round">`);
  for (const [from, to] of figure.gaps)
    out.push(`<rect x="${round(x(from))}" y="${round(top)}" width="${round(Math.max(1, x(to) - x(from)))}" height="${PLOT}" fill="${FAULT}" fill-opacity="0.15"/>`);
  if (figure.zero) line(left, y(0), left + width, y(0), SOFT, 'stroke-width="0.5"');
  for (const limit of figure.limits) line(left, y(limit), left + width, y(limit), SOFT, 'stroke-width="0.6" stroke-dasharray="4 3"');
  for (const { at, place } of figure.toeOffs || [])
    line(x(100 * at), top, x(100 * at), top + PLOT, LIGHT[place % LIGHT.length], 'stroke-width="0.6" stroke-dasharray="1 2"');
  for (const { time, kind } of figure.lines)
    line(x(time), top, x(time), top + PLOT, COLOURS[kind], `stroke-width="${kind === "fault" ? 1.2 : 0.6}"${kind === "fault" ? "" : ' stroke-dasharray="3 2"'}`);
  figure.curves.forEach((curve, order) => {
    const place = curve.place ?? order, stroke = LIGHT[place % LIGHT.length];
    if (curve.band) out.push(`<path d="${pathOf(curve.band, x, y)}" fill="${stroke}" fill-opacity="0.2"/>`);
    out.push(`<path d="${pathOf(curve.trace, x, y)}" stroke="${stroke}"` +
      `${curve.area ? ` stroke-width="0.2" fill="${stroke}" opacity="${figure.curves.length > 1 ? 0.75 : 1}"` : dash(place)}/>`);
  });
  out.push("</g>");
  line(left, top, left, top + PLOT, INK, 'stroke-width="0.6"');
  line(left, top + PLOT, left + width, top + PLOT, INK, 'stroke-width="0.6"');
  const rows = legendRows(figure, width);
  rows.forEach((row, index) => {
    const height = top - 4 - (rows.length - 1 - index) * 1.35 * FONT;
    for (const { name, place, at } of row) {
      line(left + at, height - 0.35 * FONT, left + at + 15, height - 0.35 * FONT, LIGHT[place % LIGHT.length], `stroke-width="1.2"${dash(place)}`);
      text(left + at + 18, height, name);
    }
  });
  return out.join("");
}

function dash(place) {
  const parts = DASHES[place % DASHES.length];
  return !parts.length ? "" : ` stroke-dasharray="${parts.map((part) => round(part / 2.2)).join(" ")}"`;
}

// The same as PNG. Returns a promise of a Blob.
export async function png(text) {
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  await image.decode();
  const scale = DPI / 96, canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [Math.round(image.width * scale), Math.round(image.height * scale)];
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => { canvas.toBlob(done, "image/png"); });
}
