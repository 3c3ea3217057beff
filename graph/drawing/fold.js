// Folding. What a folded subsystem no longer needs is taken out of both axes: x and y are sent through maps that never turn back, so that
// nothing which lay apart comes to lie together, level lines stay level, and no second layout is needed.

const GAP_MINIMUM = 18;               // px that stay between two heights or places that anything visible stands at

const EDGE = 12;                // px at the edges of a frame: its round corners, and where its title begins

const within = (path, frame) => path === frame || path.startsWith(frame + "/");

function isHidden(subsystem, folded) {
  return [...folded].some((frame) => within(subsystem, frame));
}

// {x, y}: functions from where things lie in the drawing to where they lie now. need: {path: {width, height}} of a frame when it is folded.
function squeeze(drawing, folded, need) {
  const seen = (thing) => !isHidden(thing.subsystem, folded);
  const boxes = drawing.boxes.filter(seen);
  const frames = drawing.frames.filter(seen);
  const lines = drawing.lines.filter(seen);
  const shut = frames.filter((frame) => folded.has(frame.path));

  function axis(from, size, index, head) {
    const fixed = boxes.map((box) => [box[from], box[from] + box[size]]);
    for (const frame of frames) {
      const start = frame[from], end = frame[from] + frame[size];
      fixed.push([start, start + head], [end - EDGE, end]);
    }
    const loose = shut.map((frame) => [frame[from], frame[from] + frame[size], need[frame.path][size]]);
    const marks = [0, drawing[size], ...fixed.flat(), ...frames.flatMap((frame) => [frame[from], frame[from] + frame[size]])];
    for (const line of lines) marks.push(...line.points.map((point) => point[index]));
    const places = [...new Set(marks)].sort((a, b) => a - b);
    const lengths = places.slice(1).map((end, i) => end - places[i]);
    const covers = (i) => ([start, end]) => start <= places[i] && places[i + 1] <= end;
    const gives = lengths.map((_, i) => loose.some(covers(i)) && !fixed.some(covers(i)));
    const kept = lengths.map((length, i) => (gives[i] ? Math.min(length, GAP_MINIMUM) : length));
    for (const [start, end, needed] of loose) {
      const own = kept.map((_, i) => i).filter((i) => covers(i)([start, end]));
      const missing = needed - own.reduce((sum, i) => sum + kept[i], 0);
      const widest = own.filter((i) => gives[i]).sort((a, b) => lengths[b] - lengths[a])[0];
      if (missing > 0 && widest !== undefined) kept[widest] += missing;
    }
    const moved = [places[0]];
    kept.forEach((length) => moved.push(moved[moved.length - 1] + length));
    return (value) => {
      let low = 0, high = places.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (places[middle] <= value) low = middle; else high = middle;
      }
      const share = (value - places[low]) / (places[high] - places[low] || 1);
      return moved[low] + share * (moved[high] - moved[low]);
    };
  }

  return { x: axis("x", "width", 0, EDGE), y: axis("y", "height", 1, drawing.head) };
}

// A path's `d` with every coordinate sent through the maps. Commands M L Q H V Z, all absolute.
function mapPath(d, map) {
  return d.replace(/([MLQHV])([^MLQHVZ]*)/g, (_, command, text) => {
    const numbers = text.trim().split(/[\s,]+/).map(Number);
    const upright = (i) => command === "V" || (command !== "H" && i % 2 === 1);
    return command + numbers.map((value, i) => +(upright(i) ? map.y(value) : map.x(value)).toFixed(2)).join(" ");
  });
}
