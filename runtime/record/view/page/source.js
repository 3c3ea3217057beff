// Windows of the signals of one recording. The process answers one question at a time; the newest wish is asked next.

const WHOLE_WIDTH = 2000;  // intervals of the whole recording, which are always kept
const MARGIN = 0.5;        // of the window, that is fetched on either side
const SPARE = 0.2;         // of the window, below which more is fetched
const COARSE = 1.4, FINE = 0.2;  // s per interval, as multiples of those of a pixel, that are good enough

export class Source {
  // recording: as in the message "hello"; ask: (question, function of the answer)
  constructor(number, recording, ask) {
    Object.assign(this, { number, recording, ask });
    this.offset = 0;       // s, of its time 0 in the time of the page
    this.share = 0;        // of the recording, that the process has prepared
    this.whole = new Map(); this.near = new Map();  // {signal: piece}
    this.wanted = null; this.busy = false;
    this.places = new Map(recording.signals.map((signal, index) => [signal.path, index]));
  }

  get begin() { return this.recording.begin + this.offset; }
  get end() { return this.recording.end + this.offset; }

  // Ask for signals in a window of the page, in s; width: its pixels; then: called after each answer.
  want(signals, begin, end, width, then) {
    this.wanted = { signals, begin: begin - this.offset, end: end - this.offset, width, then };
    this.next();
  }

  next() {
    if (this.busy || !this.wanted) return;
    const question = this.missing(this.wanted);
    if (!question) return;
    this.busy = true;
    const kept = question.whole ? this.whole : this.near, { whole, ...sent } = question;
    this.ask({ do: "window", recording: this.number, ...sent }, (head, pieces) => {
      this.busy = false;
      for (const index of sent.signals) kept.set(index, { ...sent, share: head.share, time: [], low: [], high: [], broken: [] });
      for (const piece of pieces) kept.set(piece.signal, { ...sent, share: head.share, ...piece });
      this.wanted.then(head.problem);
      this.next();
    });
  }

  missing({ signals, begin, end, width }) {
    const { recording } = this, span = end - begin, pixel = span / width;
    const all = { begin: recording.begin, end: recording.end, width: WHOLE_WIDTH, whole: true };
    const old = signals.filter((index) => !(this.whole.get(index)?.share >= this.share));
    if (old.length) return { ...all, signals: old };
    if ((all.end - all.begin) / WHOLE_WIDTH <= COARSE * pixel || end < all.begin || begin > all.end) return null;
    const [first, last] = [begin - SPARE * span, end + SPARE * span];
    const poor = signals.filter((index) => {
      const piece = this.near.get(index), fine = piece && (piece.end - piece.begin) / piece.width / pixel;
      return !(piece && fine <= COARSE && fine >= FINE && piece.begin <= Math.max(first, all.begin) &&
        piece.end >= Math.min(last, all.end) && piece.share >= Math.min(this.share, this.fraction(piece.end)));
    });
    if (!poor.length) return null;
    return { signals: poor, begin: begin - MARGIN * span, end: end + MARGIN * span, width: (1 + 2 * MARGIN) * width };
  }

  fraction(time) { return (time - this.recording.begin) / (this.recording.end - this.recording.begin || 1); }

  // The best piece of a signal that covers a window of the page; undefined while there is none.
  piece(index, begin, end) {
    const near = this.near.get(index), whole = this.whole.get(index), { recording, offset } = this;
    const covers = near && near.begin <= Math.max(begin - offset, recording.begin) &&
      near.end >= Math.min(end - offset, recording.end);
    if (!covers) return whole;
    const finer = !whole || (near.end - near.begin) / near.width < (whole.end - whole.begin) / whole.width;
    return finer ? near : whole;
  }
}

// Index of the first number that is `value` or more.
export function lowerBound(numbers, value) {
  let low = 0, high = numbers.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

// Indices [first, last) of the intervals of a piece that a window shows, and one beside it on either side.
export function visible(piece, begin, end) {
  return [Math.max(0, lowerBound(piece.time, begin) - 2), Math.min(piece.time.length, lowerBound(piece.time, end) + 1)];
}

// Smallest and largest value of a piece in a window; [Infinity, -Infinity] without one.
export function extent(piece, begin, end) {
  let [low, high] = [Infinity, -Infinity];
  const [first, last] = visible(piece, begin, end);
  for (let i = first; i < last; i += 1) {
    if (piece.low[i] < low) low = piece.low[i];
    if (piece.high[i] > high) high = piece.high[i];
  }
  return [low, high];
}

// [low, high] at a time, [NaN, NaN] without a value there.
export function valueAt(piece, time) {
  const width = piece.size * piece.step, half = piece.size > 1 ? 0 : 0.5 * piece.step;
  const i = lowerBound(piece.time, time + half + 1e-9) - 1;
  return i >= 0 && time - piece.time[i] <= Math.max(width, 2 * piece.step) ? [piece.low[i], piece.high[i]] : [NaN, NaN];
}

// Draw a piece with moveTo and lineTo of a pen, from one time to another: a line through its samples, or an area from
// the minimum to the maximum of each interval and those beside it, so that it is as wide as a line where it is steep, and
// drawn faster than a line to and fro. It ends where samples are missing.
// x, y: functions from time and value to the place; stepped: whether a value holds until the next sample;
// half: of the width of a line, by which the area is higher
export function trace(pen, piece, begin, end, x, y, stepped, half) {
  const { time, low, high, size, step } = piece, width = size * step, gap = size > 1 ? 1.5 * width : 2.5 * step;
  const [first, last] = visible(piece, begin, end), known = (i) => low[i] <= high[i];
  for (let from = first, to; from < last; from = to) {
    to = from + 1;
    if (!known(from)) continue;
    while (to < last && known(to) && time[to] - time[to - 1] < gap) to += 1;
    if (size > 1) {
      const top = (i) => y(Math.max(high[Math.max(from, i - 1)], high[i], high[Math.min(to - 1, i + 1)])) - half;
      const bottom = (i) => y(Math.min(low[Math.max(from, i - 1)], low[i], low[Math.min(to - 1, i + 1)])) + half;
      pen.moveTo(x(time[from]), top(from));
      for (let i = from; i < to; i += 1) pen.lineTo(x(time[i] + width / 2), top(i));
      pen.lineTo(x(time[to - 1] + width), top(to - 1));
      pen.lineTo(x(time[to - 1] + width), bottom(to - 1));
      for (let i = to - 1; i >= from; i -= 1) pen.lineTo(x(time[i] + width / 2), bottom(i));
      pen.lineTo(x(time[from]), bottom(from));
      pen.closePath();
    } else {
      pen.moveTo(x(time[from]), y(low[from]));
      for (let i = from; i < to; i += 1) {
        if (stepped && i > from) pen.lineTo(x(time[i]), y(low[i - 1]));
        pen.lineTo(x(time[i]), y(low[i]));   // at the first one a dot, with round ends
      }
    }
  }
}
