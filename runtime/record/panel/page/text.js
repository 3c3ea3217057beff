// Elements, numbers and times as text.

export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const DIGITS = { "°": 1, "°/s": 0, "N·m": 1, "°C": 0, "V": 1, "Hz": 1 };  // decimals that people read

export function number(value, digits) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text = value.toFixed(digits ?? (size < 10 ? 2 : size < 100 ? 1 : 0));
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

// signal: as in the message "hello", with dtype, labels, factor and shown, its unit for people
export function withUnit(value, signal) {
  if (!Number.isFinite(value)) return "–";
  if (signal.dtype === "bool") return value ? "yes" : "no";
  if (signal.labels?.length) return signal.labels[value] ?? String(value);
  if (signal.dtype === "int") return String(value).replace("-", "−") + spaced(signal.shown);
  return number(value * signal.factor, DIGITS[signal.shown]) + spaced(signal.shown);
}

const spaced = (unit) => (unit && unit !== "°" ? ` ${unit}` : unit);

export function clock(seconds) {
  const minutes = Math.floor(seconds / 60), rest = seconds - 60 * minutes;
  return minutes ? `${minutes}:${rest.toFixed(1).padStart(4, "0")}` : `${rest.toFixed(1)} s`;
}

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

// "knee position, left"
export const nameOf = ({ block, port }) => block.replace(/(, (?:left|right))?$/, ` ${port}$1`);

const folderOf = (path) => path.slice(0, Math.max(0, path.lastIndexOf("/")));

// Index of the first of some ports in the innermost subsystem around a signal that has one, -1 without.
// phases: {path of a gait phase: path of what is true while it is known}, whatever its port is called
export function nearest(signals, path, ports, phases) {
  for (let around = folderOf(path); ; around = folderOf(around)) {
    for (const port of ports) {
      const index = signals.findIndex((each) => folderOf(each.path) === around &&
        (each.path.endsWith(`.${port}`) || (port === "phase" && each.path in phases)));
      if (index >= 0) return index;
    }
    if (!around) return -1;
  }
}
