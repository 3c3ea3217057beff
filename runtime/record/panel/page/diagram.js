// The drawing of the diagram, with the values of its signals at their ports and a glow on the wires that change. A click
// on a port or on a wire plots its signal. The drawing is in a shadow tree, so that its classes and the page's do not mix.
import { number, withUnit } from "./text.js";

const ZOOM = 1.25;          // of one step
const SMALLEST = 0.2, LARGEST = 4;
const LEGIBLE = 0.75;       // scale from which its text can be read
const CALM = 0.01;          // share of the range of a signal that no glow shows
const STYLE = `
:host { display: block; }
svg { display: block; }
.paper { fill: none; }
.line { stroke: color-mix(in srgb, var(--wire), var(--glow) calc(100% * var(--pulse, 0)));
  stroke-width: calc(1.4px + 1.6px * var(--pulse, 0)); }
.hit { fill: none; stroke: transparent; stroke-width: 12; cursor: pointer; }
.port.signal { cursor: pointer; }
.port.signal:hover, .port.signal[aria-pressed="true"] { font-weight: 700; text-decoration: underline; }
.port.signal:focus-visible { outline: 2px solid var(--glow); outline-offset: 2px; }
.signal .note { fill: var(--value); font-weight: 600; font-variant-numeric: tabular-nums; }
:host { --wire: #475569; --glow: #e06c00; --value: #005f99; }
@media (prefers-color-scheme: dark) {
  :host { --wire: #8593a6; --glow: #ffa94d; --value: #6cbcf0; }
  text { fill: #e5e9f0; } .type, .detail, .note { fill: #a3afbd; }
  .box > .body { fill: #10151d; } .box > .head { fill-opacity: .22; } .box > .edge { stroke-opacity: .9; }
  .frame > .edge { fill: #141a22; stroke: #313a48; } .frame > .head { fill: #1d2530; stroke: #313a48; }
  .state > rect { fill: #10151d; } .state.active > rect { fill: #5c2a4e; }
  .dot, .joint { fill: #8593a6; } .back { --wire: #d98a52; }
}`;

export class DiagramView {
  // place: element for the drawing; tools: with the buttons out, fit and in; toggle(indices): plots signals, or no longer
  constructor(place, tools, toggle) {
    this.place = place; this.toggle = toggle; this.ports = []; this.scale = 1;
    this.root = place.attachShadow({ mode: "open" });
    const [out, whole, closer] = tools.querySelectorAll("button");
    out.onclick = () => this.zoom(this.scale / ZOOM);
    closer.onclick = () => this.zoom(this.scale * ZOOM);
    whole.onclick = () => this.fit(0);
    place.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoom(this.scale * Math.exp(-0.01 * event.deltaY), event);
    }, { passive: false });
    place.addEventListener("pointerdown", (event) => { this.drag = event.pointerType === "mouse" ? event : null; });
    addEventListener("pointerup", () => { this.drag = null; });
    place.addEventListener("pointermove", (event) => {
      if (!this.drag) return;
      place.scrollLeft -= event.clientX - this.drag.clientX;
      place.scrollTop -= event.clientY - this.drag.clientY;
      this.drag = event;
    });
  }

  // text: SVG of the drawing; signals: of the run
  build(text, signals) {
    const own = /<style>([^]*?)<\/style>/;    // which the policy of the page does not allow in the drawing
    this.svg = new DOMParser().parseFromString(text.replace(own, ""), "image/svg+xml").documentElement;
    this.svg.setAttribute("role", "group");
    this.svg.setAttribute("aria-label", "Diagram of the run");
    this.root.adoptedStyleSheets = [text.match(own)[1], STYLE].map((rules) => {
      const sheet = new CSSStyleSheet();
      sheet.replaceSync(rules);
      return sheet;
    });
    this.root.replaceChildren(this.svg);
    [this.width, this.height] = ["width", "height"].map((name) => Number(this.svg.getAttribute(name)));
    this.signals = signals;
    const places = new Map();
    signals.forEach(({ path }, index) => {
      const whole = path.replace(/\[\d+\]$/, "");
      places.set(whole, [...(places.get(whole) ?? []), index]);
    });
    const wires = [...this.svg.querySelectorAll(".line[data-signal]")];
    this.ports = [];
    for (const label of this.svg.querySelectorAll(".box .port.end")) {
      const path = label.dataset.signal ?? `${label.closest(".box").dataset.path}.${label.firstChild.textContent.trim()}`;
      const indices = places.get(path);
      const value = label.querySelector(".note");
      if (!indices) { value?.remove(); continue; }
      const port = { label, value, indices, lines: wires.filter((line) => line.dataset.signal === path), before: null, low: Infinity, high: -Infinity };
      label.classList.add("signal");
      this.act(label, port, true);
      for (const line of port.lines) {
        const hit = line.cloneNode(true);
        hit.setAttribute("class", "hit");
        line.after(hit);
        this.act(hit, port, false);
      }
      this.ports.push(port);
    }
    this.charts = [...this.svg.querySelectorAll(".chart")].map((chart) => ({ chart, index: places.get(chart.dataset.signal)?.[0] }));
    this.fitted = false;
  }

  act(element, port, keys) {
    const toggle = () => { this.toggle(port.indices); this.marked(); };
    element.addEventListener("click", toggle);
    if (!keys) return;
    const { port: name, block } = this.signals[port.indices[0]];
    element.setAttribute("tabindex", "0");
    element.setAttribute("role", "button");
    element.setAttribute("aria-label", `plot ${port.indices.length > 1 ? port.label.firstChild.textContent.trim() : name} of ${block}`);
    element.addEventListener("keydown", (event) => { if (event.key === "Enter") toggle(); });
  }

  // plotted(index): whether a signal is plotted
  marked(plotted = this.plotted) {
    this.plotted = plotted;
    for (const { label, indices } of this.ports) label.setAttribute("aria-pressed", String(indices.every(plotted)));
  }

  // values: of all signals, while the drawing can be seen
  show(values) {
    if (!this.fitted) this.fit(LEGIBLE);
    for (const port of this.ports) {
      const signal = this.signals[port.indices[0]], each = port.indices.map((index) => values[index]);
      const text = each.length > 1 ? each.map((value) => number(value * signal.factor, 1)).join(" ") : withUnit(each[0], signal);
      if (port.value && port.value.textContent !== text) port.value.textContent = text;
      const moved = port.before ? Math.max(...each.map((value, place) => Math.abs(value - port.before[place]))) : 0;
      for (const value of each) { port.low = Math.min(port.low, value); port.high = Math.max(port.high, value); }
      const share = moved / (port.high - port.low), pulse = share > CALM ? Math.min(1, 2 * share).toFixed(2) : "0";
      if (pulse !== port.pulse) for (const line of port.lines) line.style.setProperty("--pulse", pulse);
      port.pulse = pulse;
      port.before = each;
    }
    for (const { chart, index } of this.charts) {
      const active = chart.querySelector(`.state[data-number="${values[index]}"]`);
      for (const state of chart.querySelectorAll(".state")) state.classList.toggle("active", state === active);
    }
  }

  // The whole drawing, but no smaller than a scale.
  fit(least) {
    this.fitted = true;
    const across = this.place.clientWidth / this.width, down = Math.max(this.place.clientHeight, 320) / this.height;
    this.zoom(Math.max(least, Math.min(1, across, least ? across : down)));
  }

  zoom(scale, at) {
    const box = this.place.getBoundingClientRect();
    const x = at ? at.clientX - box.left : box.width / 2, y = at ? at.clientY - box.top : box.height / 2;
    const ratio = Math.min(LARGEST, Math.max(SMALLEST, scale)) / this.scale;
    this.scale *= ratio;
    this.svg.setAttribute("width", this.width * this.scale);
    this.svg.setAttribute("height", this.height * this.scale);
    this.place.scrollLeft = (this.place.scrollLeft + x) * ratio - x;
    this.place.scrollTop = (this.place.scrollTop + y) * ratio - y;
  }
}
