// --- values over time ------------------------------------------------------------------
// A column is a constant, or quantised to 16 bits (32, where that is too coarse) between a least and a largest value.
// Words are kept as differences from frame to frame, low bytes before high ones, deflated.
async function unpacked(text) {
  if (typeof DecompressionStream === "undefined") {
    document.getElementById("scene").textContent = "This page needs a browser of 2023 or later.";
  }
  const packed = Uint8Array.from(atob(text), function (letter) { return letter.charCodeAt(0); });
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer()), half = bytes.length / 2;
  const words = new Uint16Array(half);
  for (let k = 0; k < half; k++) {
    words[k] = (bytes[k] | (bytes[half + k] << 8)) + (k % DATA.count ? words[k - 1] : 0);
  }
  return words;
}
const WORDS = await unpacked(DATA.words);

function sampleAt(column, k) {
  if (column.c !== undefined) return column.c;
  const high = WORDS[column.at + k];
  if (column.low === undefined) return column.o + column.s * high;
  return column.o + column.s * (65536 * high + WORDS[column.low + k]);
}

// Value of a column at a time, on a straight line between two frames.
function valueAt(index, time) {
  const column = DATA.columns[index];
  if (column.c !== undefined) return column.c;
  const place = Math.min(Math.max(frameOf(time), 0), DATA.count - 1);
  const k = Math.min(Math.floor(place), DATA.count - 2);
  const first = sampleAt(column, k);
  return first + (place - k) * (sampleAt(column, k + 1) - first);
}

// Pose of a frame: place and angle on a cubic through four frames, so that what is pinned stays together in a fast
// motion; lengths, which are those of forces and may jump, on a straight line.
function smoothAt(index, time) {
  const column = DATA.columns[index];
  if (column.c !== undefined) return column.c;
  const last = DATA.count - 1, place = Math.min(Math.max(frameOf(time), 0), last);
  const k = Math.min(Math.floor(place), last - 1), s = place - k;
  const b = sampleAt(column, k), c = sampleAt(column, k + 1);
  const a = k > 0 ? sampleAt(column, k - 1) : last > 1 ? 3 * b - 3 * c + sampleAt(column, k + 2) : 2 * b - c;
  const d = k + 2 <= last ? sampleAt(column, k + 2) : last > 1 ? 3 * c - 3 * b + a : 2 * c - b;
  return b + 0.5 * s * (c - a + s * (2 * a - 5 * b + 4 * c - d + s * (3 * (b - c) + d - a)));
}

// A value over time, where what is smaller than a step of the quantisation counts as zero.
function numberAt(index, time) {
  const value = valueAt(index, time);
  return Math.abs(value) < (DATA.columns[index].s || 0) ? 0 : value;
}

function timeOf(k) { return DATA.t0 + (DATA.t1 - DATA.t0) * k / (DATA.count - 1); }

function frameOf(time) { return (time - DATA.t0) / (DATA.t1 - DATA.t0) * (DATA.count - 1); }

function poseOf(frame, time) {
  return DATA.frames[frame].map(function (index, j) { return j < 3 ? smoothAt(index, time) : valueAt(index, time); });
}

// Numbers with four digits that mean something, and a true minus sign.
function written(value) {
  if (Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-4 ? value.toExponential(3) : String(Number(value.toPrecision(4)));
  return text.replace("-", "\u2212");
}
