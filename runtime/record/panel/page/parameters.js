// Live parameters: a slider and a number each, with what was asked for and what is applied.
import { element, withUnit } from "./text.js";

const SEND_PERIOD = 100;  // ms between two values of a slider that moves
const NOTE_DURATION = 6000;  // ms
const CHANGE_LIMIT = 16;  // changes of one request
const DRAG_PAUSE = 1000;  // ms between changes of one slider that are undone together, at most

export class Parameters {
  constructor(place, both, send, tools) {
    this.place = place; this.both = both; this.send = send;
    this.rows = []; this.asked = new Map(); this.id = 0; this.past = []; this.targets = [];
    const [undo, save, load] = tools.querySelectorAll("button"), file = tools.querySelector("input");
    this.undoes = undo; this.loads = load; this.said = tools.querySelector("span");
    undo.onclick = () => this.undo();
    save.onclick = () => this.save();
    load.onclick = () => file.click();
    file.onchange = async () => {
      if (file.files.length) this.said.textContent = this.load(await file.files[0].text());
      file.value = "";
    };
  }

  // name: of the run, for the file with the values
  build(parameters, name) {
    this.list = parameters; this.name = name; this.past = []; this.said.textContent = "";
    this.byPath = new Map(parameters.map((each, index) => [each.path, index]));
    this.rows = parameters.map((each, index) => this.row(each, index));
    this.place.replaceChildren(...this.rows.filter((row) => !this.list[row.index].withheld).map((row) => row.element));
    this.both.parentElement.hidden = !parameters.some((each, index) => !each.withheld && this.twins(index).length > 1);
    this.both.onchange = () => this.pair();
    this.pair();
  }

  // Show one row for both sides, or one for each.
  pair() {
    for (const row of this.rows) {
      const [index, twin] = this.twins(row.index), each = this.list[index], together = this.both.checked && twin !== undefined;
      row.element.hidden = together && twin < index;
      const block = together ? each.block.replace(/, (left|right)$/, ", both sides") : each.block;
      row.name.textContent = `${each.port} (${block})`;
    }
  }

  nameOf(path) {
    const each = this.list[this.byPath.get(path)];
    return each ? `${each.port} (${each.block})` : path;
  }

  valueOf(path, value) {
    const each = this.list[this.byPath.get(path)];
    return each ? withUnit(Number(value), each) : String(value);
  }

  // Indices of a parameter and of that of the other side.
  twins(index) {
    const { path, unit, low, high } = this.list[index];
    const other = path.replace(/^(left|right)\//, (side) => (side === "left/" ? "right/" : "left/"));
    const twin = this.byPath.get(other);
    const same = twin !== undefined && twin !== index && this.list[twin].unit === unit && this.list[twin].low === low &&
      this.list[twin].high === high;
    return same ? [index, twin] : [index];
  }

  row(each, index) {
    const label = `${each.port}, ${each.block}`, scale = each.factor, choice = each.dtype === "bool";
    const range = { min: each.low * scale, max: each.high * scale, step: each.dtype === "int" ? 1 : "any" };
    const slider = choice ? element("input", { type: "checkbox", ariaLabel: label }) :
      element("input", { type: "range", ariaLabel: label, ...range });
    const field = element("input", { type: "number", ariaLabel: `${label}, as a number`, ...range, hidden: choice });
    const reset = element("button", { title: `default: ${withUnit(each.built, each)}`, ariaLabel: `reset ${label}` }, "Reset");
    const applied = element("span", { className: "applied live" });
    const read = (input) => Math.min(each.high, Math.max(each.low, choice ? Number(slider.checked) : Number(input.value) / scale));
    const row = { index, slider, field, reset, applied, held: false, note: "", until: 0, last: 0, later: 0 };
    const ask = () => {
      clearTimeout(row.later);
      [row.later, row.last] = [0, performance.now()];
      this.change(row, read(slider));
    };
    slider.addEventListener("input", () => {
      row.held = true;
      if (!choice) field.value = rounded(slider.value);
      clearTimeout(row.later);
      row.later = setTimeout(ask, Math.max(0, row.last + SEND_PERIOD - performance.now()));
    });
    slider.addEventListener("change", () => {
      row.held = false;
      if (row.later) ask();  // before the next status moves the slider back
    });
    field.addEventListener("change", () => { if (field.value !== "") this.change(row, read(field)); });
    reset.addEventListener("click", () => this.change(row, each.built));
    const entry = element("span", { className: "entry" }, field, element("span", {}, choice ? "" : each.shown));
    row.name = element("span", { className: "name" });
    row.element = element("div", { className: "parameter", title: each.path },
      row.name, applied, element("span", { className: "slider" }, slider), entry, reset,
      element("span", { className: "what" }, each.description));
    row.element.dataset.path = each.path;
    return row;
  }

  change(row, value) {
    const indices = this.both.checked ? this.twins(row.index) : [row.index];
    this.remember(indices);
    this.request(indices.map((index) => [index, value]));
  }

  request(changes) {
    for (let first = 0; first < changes.length; first += CHANGE_LIMIT) {
      const part = changes.slice(first, first + CHANGE_LIMIT), id = ++this.id;
      this.asked.set(id, part.map(([index]) => index));
      for (const [index, value] of part) { this.rows[index].wanted = value; this.rows[index].pending = id; }
      if (!this.send({ do: "set", id, changes: part })) this.answered({ id, taken: false, text: "no link: not sent" });
    }
  }

  remember(indices) {
    const time = performance.now(), key = String(indices), last = this.past.at(-1);
    if (last?.key === key && time - last.time < DRAG_PAUSE) last.time = time;
    else this.past.push({ key, time, before: indices.map((index) => [index, this.targets[index]]) });
  }

  undo() {
    const last = this.past.pop();
    if (last) this.request(last.before);
  }

  // The values as a file that `--set @FILE` reads.
  save() {
    const text = (each, value) => (each.dtype === "bool" ? String(value > 0) : String(value));
    const lines = this.list.map((each, index) => (each.withheld ? "" : `${each.path}=${text(each, this.targets[index])}\n`));
    const file = new Blob([lines.join("")], { type: "text/plain" });
    const link = element("a", { href: URL.createObjectURL(file), download: `${this.name}.set` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), NOTE_DURATION);
  }

  // Ask for the values of such a file, all that differ. Returns what was done as text.
  load(text) {
    const changes = [], unknown = [];
    for (const line of text.replace(/^\uFEFF/, "").split("\n").map((each) => each.trim())) {
      if (!line || line === "#" || line.startsWith("# ")) continue;
      const [path, word = ""] = line.split("=").map((each) => each.trim()), index = this.byPath.get(path);
      const value = { true: 1, false: 0 }[word] ?? (word ? Number(word) : NaN);
      if (index === undefined || !Number.isFinite(value)) unknown.push(line);
      else if (value === this.targets[index]) continue;
      else if (this.list[index].withheld) unknown.push(line);
      else changes.push([index, value]);
    }
    if (unknown.length) return `Nothing was loaded. This run cannot take: ${unknown.join(", ")}`;
    if (changes.length) this.remember(changes.map(([index]) => index));
    this.request(changes);
    return changes.length ? `Asked for ${changes.length} of its values` : "These are the present values";
  }

  answered(answer) {
    for (const index of this.asked.get(answer.id) || []) {
      const row = this.rows[index];
      if (!row) continue;
      if (row.pending === answer.id) row.pending = 0;
      row.note = answer.taken ? "" : `not changed: ${answer.text}`;
      row.until = performance.now() + NOTE_DURATION;
    }
    this.asked.delete(answer.id);
  }

  // live: [value in the newest tick, target] of each parameter
  show(live, enabled) {
    this.targets = live.map(([, target]) => target);
    this.undoes.disabled = !enabled || !this.past.length;
    this.loads.disabled = !enabled;
    for (const row of this.rows) {
      const each = this.list[row.index], [value, target] = live[row.index], choice = each.dtype === "bool";
      for (const input of [row.slider, row.field, row.reset]) input.disabled = !enabled;
      if (!row.held && !row.pending) {
        if (choice) row.slider.checked = target > 0;
        else if (document.activeElement !== row.field || !row.field.matches(":focus")) {
          row.slider.value = target * each.factor;
          row.field.value = rounded(target * each.factor);
        } else row.slider.value = target * each.factor;
      }
      const note = row.note && performance.now() < row.until;
      row.applied.classList.toggle("bad", Boolean(note));
      row.applied.textContent = note ? row.note : row.pending ? `asked for ${withUnit(row.wanted, each)}` : this.applied(row, live);
    }
  }

  applied(row, live) {
    const text = ([value, target]) => {
      const each = this.list[row.index];
      return value === target ? `applied: ${withUnit(value, each)}` : `asked for ${withUnit(target, each)}, applied: ${withUnit(value, each)}`;
    };
    const [index, twin] = this.twins(row.index);
    const same = !this.both.checked || twin === undefined || live[index].every((value, place) => value === live[twin][place]);
    return same ? text(live[index]) : [index, twin].map((each) => `${this.list[each].path.split("/")[0]} ${text(live[each])}`).join("; ");
  }
}

const rounded = (value) => String(Number(Number(value).toPrecision(4)));
