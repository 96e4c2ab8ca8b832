// --- values over time ------------------------------------------------------------------
// A column is a constant, or whole numbers at the knots of its group, times a size; far from the origin they count from
// another one. Between knots it is a polynomial of degree five through the six knots about a time, which follows the
// motion to the tolerance of the page.
const POINTS = 6, LARGEST_WEIGHTS = 64, SMOOTH = 8;

async function inflated(text) {
  if (typeof DecompressionStream === "undefined") {
    document.getElementById("scene").textContent = "This page needs a browser of 2023 or later.";
  }
  const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Weights of knots, at places from a time, in the polynomial through them.
function weightsOf(places, count, weights) {
  for (let j = 0; j < count; j++) {
    let weight = 1;
    for (let k = 0; k < count; k++) if (k !== j) weight = weight * (places[k] / (places[k] - places[j]));
    weights[j] = weight;
  }
}

// Groups, with the times of their knots, the pieces between jumps, and their values.
async function unpackedGroups() {
  const clock = new Float64Array((await inflated(DATA.clock)).buffer), masks = await inflated(DATA.masks);
  const bytes = await inflated(DATA.words), total = bytes.length / 4, across = Math.ceil(DATA.times / 8);
  let next = 0;
  return DATA.groups.map((shape, number) => {
    const t = new Float64Array(shape.n), first = new Int32Array(shape.n), last = new Int32Array(shape.n);
    let knots = 0;
    for (let k = 0; k < DATA.times; k++) if (masks[number * across + (k >> 3)] >> (k & 7) & 1) t[knots++] = clock[k];
    for (let k = 0; k < shape.n; k++) first[k] = k > 0 && t[k] - t[k - 1] > DATA.resolution ? first[k - 1] : k;
    for (let k = shape.n - 1; k >= 0; k--) last[k] = k + 1 < shape.n && t[k + 1] - t[k] > DATA.resolution ? last[k + 1] : k;
    const group = { t: t, first: first, last: last, columns: [], time: NaN, start: 0, count: 0, weights: new Float64Array(POINTS) };
    const whole = [];
    for (let c = 0; c < shape.k; c++) whole.push(new Float64Array(shape.n));
    const places = new Float64Array(POINTS), weights = new Float64Array(POINTS);
    for (let k = 0; k < shape.n; k++) {
      // as many of the knots before it as do not throw the sum far off
      let points = Math.min(k - first[k], POINTS);
      for (; points > 1; points--) {
        let size = 0;
        for (let j = 0; j < points; j++) places[j] = t[k - points + j] - t[k];
        weightsOf(places, points, weights);
        for (let j = 0; j < points; j++) size = size + Math.abs(weights[j]);
        if (size <= LARGEST_WEIGHTS) break;
      }
      for (let c = 0; c < shape.k; c++) {
        const at = next + c * shape.n + k;
        const word = bytes[at] + 256 * (bytes[total + at] + 256 * (bytes[2 * total + at] + 256 * bytes[3 * total + at]));
        let sum = points > 1 ? 0 : k > 0 ? whole[c][k - 1] : 0;
        if (points > 1) {
          for (let j = 0; j < points; j++) sum = sum + weights[j] * whole[c][k - points + j];
          sum = Math.floor(sum + 0.5);
        }
        whole[c][k] = sum + (word % 2 ? -(word + 1) / 2 : word / 2);
      }
    }
    next += shape.n * shape.k;
    group.columns = whole;
    return group;
  });
}
const GROUPS = await unpackedGroups();
const COLUMNS = (() => {
  const counts = GROUPS.map(() => 0);
  return DATA.columns.map(column => {
    if (column.c !== undefined) return { constant: column.c };
    const values = GROUPS[column.g].columns[counts[column.g]++];
    if (column.o) for (let k = 0; k < values.length; k++) values[k] += column.o;
    return { group: GROUPS[column.g], values: values, size: column.q };
  });
})();

// Knots about a time and their weights, kept until another time is asked for.
function locate(group, time) {
  if (group.time === time) return;
  const t = group.t;
  let low = 0, high = t.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle; else high = middle;
  }
  let first = group.first[low], last = group.last[low];
  if (t[low + 1] - t[low] <= DATA.resolution) { first = low; last = low + 1; }  // within a jump
  const start = Math.max(first, Math.min(low - (POINTS / 2 - 1), last - (POINTS - 1)));
  const places = [];
  for (let k = start; k <= Math.min(last, start + POINTS - 1); k++) places.push(t[k] - time);
  group.time = time;
  group.start = start;
  group.count = places.length;
  const exact = places.indexOf(0);
  if (exact < 0) weightsOf(places, places.length, group.weights);
  else for (let k = 0; k < places.length; k++) group.weights[k] = k === exact ? 1 : 0;
}

function valueAt(index, time) {
  const column = COLUMNS[index];
  if (column.group === undefined) return column.constant;
  const group = column.group;
  locate(group, Math.min(Math.max(time, DATA.t0), DATA.t1));
  let sum = 0;
  for (let k = 0; k < group.count; k++) sum += group.weights[k] * column.values[group.start + k];
  return column.size * sum;
}

// Times at which columns are drawn: their knots, and some between them.
function timesOf(indices) {
  const times = new Set([DATA.t0, DATA.t1]);
  for (const index of indices) {
    const group = COLUMNS[index].group;
    if (group === undefined) continue;
    group.t.forEach((time, k) => {
      times.add(time);
      const next = group.t[k + 1];
      if (next - time > DATA.resolution) for (let k = 1; k < SMOOTH; k++) times.add(time + k / SMOOTH * (next - time));
    });
  }
  return Array.from(times).sort((a, b) => a - b);
}

// Columns that a frame depends on.
function columnsOf(number) {
  const frame = DATA.frames[number];
  return frame.a ? frame.c.concat(columnsOf(frame.a[0])) : frame.c;
}

function timeOf(k) { return DATA.t0 + (DATA.t1 - DATA.t0) * k / (DATA.count - 1); }

function frameOf(time) { return (time - DATA.t0) / (DATA.t1 - DATA.t0) * (DATA.count - 1); }

// --- what the drawing and the plots read ---------------------------------------------------
function timeSpan() { return [DATA.t0, DATA.t1]; }
function revision() { return 0; }                            // the motion does not change
function wholeBox() { return DATA.box.slice(); }
const drawnPoints = new Map();
function pointsOf(index) {
  if (!drawnPoints.has(index)) drawnPoints.set(index, timesOf([index]).map(time => [time, valueAt(index, time)]));
  return drawnPoints.get(index);
}
// Points of a column over another one, or over time, with their times.
function series(x, index) {
  if (x === null) { const points = pointsOf(index); return { points: points, times: points.map(point => point[0]) }; }
  const times = timesOf([x, index]);
  return { points: times.map(time => [valueAt(x, time), valueAt(index, time)]), times: times };
}
const drawnPaths = DATA.traces.map(frame => {
  const times = timesOf(columnsOf(frame));
  const after = time => { const k = times.findIndex(one => one > time); return k < 0 ? times.length : k; };
  return { frame: frame, whole: [], points: times.map(time => poseOf(frame, index => valueAt(index, time))), past: after };
});
function paths() { return drawnPaths; }
// Everything that is read or plotted, as a table over the times of the frames.
function table() {
  const columns = quantities();
  const rows = Array.from({ length: DATA.count }, (_, k) => {
    const time = timeOf(k);
    return [time, ...columns.map(column => valueAt(column[1], time))];
  });
  return { names: columns.map(column => column[0]), rows: rows };
}
