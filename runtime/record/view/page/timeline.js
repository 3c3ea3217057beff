// The timeline: the whole of the recordings with their events, and the window that the plots show.
import { colours, isLong, theme, timeLabels, timeText } from "./charts.js";
import { trace, extent } from "./source.js";

const EVENTS = 18, AXIS = 18;   // px of the rows above and below
const GRIP = 9;                 // px beside an edge of the window, or an event, that take it
const SHAPES = ["mark", "change", "warning", "fault", "stop", "other"];

export class Timeline {
  // world: begin, end, first, last, lines, gaps, preview; show: (begin, end); go: (event)
  constructor(place, world, show, go) {
    Object.assign(this, { place, world, show, go });
    this.canvas = place.querySelector("canvas");
    this.brush = place.querySelector("#brush");
    this.tip = place.querySelector("#tip");
    place.addEventListener("pointerdown", (event) => this.take(event));
    place.addEventListener("pointermove", (event) => this.hover(event));
    place.addEventListener("pointerleave", () => { this.tip.hidden = true; });
    place.addEventListener("dblclick", () => show(world.first, world.last));
  }

  get width() { return this.place.clientWidth; }
  x(time) { return (time - this.world.first) / (this.world.last - this.world.first) * this.width; }
  time(x) { return this.world.first + x / this.width * (this.world.last - this.world.first); }
  at(event) { return event.clientX - this.place.getBoundingClientRect().left; }

  eventAt(event) {
    if (event.clientY - this.place.getBoundingClientRect().top > EVENTS + 4) return null;
    const at = this.at(event);
    const near = this.world.lines.filter((line) => Math.abs(this.x(line.time) - at) <= GRIP);
    return near.sort((a, b) => Math.abs(this.x(a.time) - at) - Math.abs(this.x(b.time) - at))[0] || null;
  }

  hover(event) {
    const found = this.eventAt(event);
    this.place.style.cursor = found ? "pointer" : "";
    this.tip.hidden = !found;
    if (!found) return;
    this.tip.textContent = `${timeText(found.time)}  ${found.text}`;
    this.tip.style.left = `${Math.max(0, Math.min(this.x(found.time), this.width - this.tip.offsetWidth))}px`;
  }

  // Move the window, one of its edges, or select another one.
  take(event) {
    if (event.button !== 0) return;
    const found = this.eventAt(event);
    if (found) { this.go(found); return; }
    event.preventDefault();
    this.brush.focus({ preventScroll: true });
    const { begin, end } = this.world, start = this.at(event), [left, right] = [this.x(begin), this.x(end)];
    const whole = right - left > 0.98 * this.width, thin = right - left < 3 * GRIP;
    const edge = Math.abs(start - left) <= GRIP && !thin ? "left" : Math.abs(start - right) <= GRIP && !thin ? "right" : "";
    const inside = start > left - (thin ? GRIP : 0) && start < right + (thin ? GRIP : 0) && !whole;
    let moved = false;
    const move = (next) => {
      const by = this.time(this.at(next)) - this.time(start);
      if (Math.abs(this.at(next) - start) > 3) moved = true;
      if (!moved) return;
      if (edge === "left") this.show(Math.min(begin + by, end), end);
      else if (edge === "right") this.show(begin, Math.max(end + by, begin));
      else if (inside) this.show(begin + by, end + by);
      else this.show(...[this.time(start), this.time(this.at(next))].sort((a, b) => a - b));
    };
    const leave = () => {
      this.place.removeEventListener("pointermove", move);
      if (!moved && !edge && !inside && !whole) this.show(this.time(start) - (end - begin) / 2, this.time(start) + (end - begin) / 2);
    };
    this.place.setPointerCapture(event.pointerId);
    this.place.addEventListener("pointermove", move);
    this.place.addEventListener("pointerup", leave, { once: true });
    this.place.addEventListener("pointercancel", leave, { once: true });
  }

  draw() {
    const { world, width } = this;
    if (!width) return;
    const drawn = [theme(), world.lines, world.first, world.last, width, devicePixelRatio, ...world.preview.map(({ piece }) => piece)];
    if (drawn.length !== this.drawn?.length || drawn.some((each, index) => each !== this.drawn[index])) this.drawAll(this.drawn = drawn);
    const { begin, end } = world, [left, right] = [Math.max(0, this.x(begin)), Math.min(width, this.x(end))];
    this.brush.style.left = `${Math.min(left, width - 6)}px`;
    this.brush.style.width = `${Math.max(6, right - left)}px`;
    this.brush.ariaValueMin = world.first;
    this.brush.ariaValueMax = world.last;
    this.brush.ariaValueNow = (begin + end) / 2;
    this.brush.ariaValueText = `${timeText(begin)} to ${timeText(end)}`;
  }

  // All but the window, which an element shows.
  drawAll() {
    const { canvas, world, width } = this, ratio = devicePixelRatio, height = this.place.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio))
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const ctx = canvas.getContext("2d"), colour = theme();
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, width, height);
    const top = EVENTS, bottom = height - AXIS;
    for (const { piece, offset, place } of world.preview) {
      const [low, high] = extent(piece, -Infinity, Infinity);
      if (!(low < high)) continue;
      ctx.strokeStyle = ctx.fillStyle = colours()[place % colours().length];
      ctx.globalAlpha = 0.6;
      ctx.lineWidth = 1;
      ctx.beginPath();
      trace(ctx, piece, -Infinity, Infinity, (time) => this.x(time + offset), (value) => bottom - 3 - (value - low) / (high - low) * (bottom - top - 6), false, 0.5);
      if (piece.size > 1) ctx.fill(); else ctx.stroke();
      ctx.globalAlpha = 1;
    }
    ctx.fillStyle = colour.bad;
    for (const [from, to] of world.gaps) {
      ctx.globalAlpha = 0.25;
      ctx.fillRect(this.x(from), top, Math.max(2, this.x(to) - this.x(from)), bottom - top);
      ctx.globalAlpha = 1;
    }
    ctx.fillStyle = colour.soft;
    ctx.font = "12px system-ui, sans-serif";
    ctx.textBaseline = "bottom";
    const step = roundStep((world.last - world.first) / Math.max(2, width / 110));
    const ticks = [];
    for (let tick = Math.ceil(world.first / step) * step; tick <= world.last; tick += step) ticks.push(Number(tick.toPrecision(12)));
    timeLabels(ticks.length > 1 ? ticks : [0, step].slice(0, ticks.length), isLong(world.first, world.last)).forEach((text, index) => {
      const x = this.x(ticks[index]), size = ctx.measureText(text).width;
      ctx.fillRect(x, bottom, 1, 4);
      ctx.fillText(text, Math.max(0, Math.min(x - size / 2, width - size)), height);
    });
    const order = (line) => SHAPES.indexOf(line.kind);
    for (const line of [...world.lines].sort((a, b) => order(a) - order(b))) this.shape(ctx, line, colour, bottom);
  }

  shape(ctx, { time, kind }, colour, bottom) {
    const x = Math.min(Math.max(this.x(time), 7), this.width - 7), y = EVENTS / 2;
    ctx.strokeStyle = ctx.fillStyle = colour[kind] || colour.soft;
    ctx.lineWidth = kind === "fault" ? 2.5 : 1.5;
    ctx.beginPath();
    if (kind === "mark") { ctx.moveTo(x - 6, 3); ctx.lineTo(x + 6, 3); ctx.lineTo(x, 14); ctx.closePath(); ctx.fill(); }
    else if (kind === "fault") { ctx.moveTo(x - 5, 4); ctx.lineTo(x + 5, 14); ctx.moveTo(x + 5, 4); ctx.lineTo(x - 5, 14); ctx.stroke(); }
    else if (kind === "warning") { ctx.moveTo(x, 2); ctx.lineTo(x + 6, y); ctx.lineTo(x, 16); ctx.lineTo(x - 6, y); ctx.closePath(); ctx.stroke(); }
    else if (kind === "change") { ctx.arc(x, y, 3, 0, 2 * Math.PI); ctx.fill(); }
    else ctx.strokeRect(x - 3, y - 3, 6, 6);
    if (kind !== "mark" && kind !== "fault") return;
    ctx.globalAlpha = 0.6;
    ctx.lineWidth = 1;
    ctx.beginPath(); ctx.moveTo(x, EVENTS); ctx.lineTo(x, bottom); ctx.stroke();
    ctx.globalAlpha = 1;
  }
}

function roundStep(least) {
  const steps = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 18000, 36000];
  if (least > 1) return steps.find((step) => step >= least) || 36000 * Math.ceil(least / 36000);
  const size = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].find((step) => step * size >= least) * size;
}
