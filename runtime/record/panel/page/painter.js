// Drawing in slices. The page replies to the run between two of them, so that no amount of drawing makes it a lost page.

const BUDGET = 8;           // ms of a slice, after which it begins no further part

export class Painter {
  // parts(): what is to be drawn, as functions
  constructor(parts) { this.parts = parts; this.waiting = []; this.wanted = this.busy = false; }

  // Draw what is new. What comes during a round is drawn by the next one: rounds are left out, but no newest value.
  due() {
    this.wanted = true;
    if (this.busy) return;
    this.busy = true;
    requestAnimationFrame(() => this.slice());
  }

  async slice() {
    const began = performance.now();
    if (!this.waiting.length) {
      this.wanted = false;
      this.waiting = this.parts();
    }
    setTimeout(() => setTimeout(() => this.rested(), performance.now() - began));   // after its painting, as long a rest
    while (this.waiting.length && performance.now() < began + BUDGET) {
      this.waiting.shift()();
      await null;             // uPlot draws in a microtask
    }
  }

  rested() {
    this.busy = false;
    if (this.waiting.length || this.wanted) this.due();
  }
}
