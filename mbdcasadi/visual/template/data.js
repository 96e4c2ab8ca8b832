// --- values over time ------------------------------------------------------------------
// A column is a constant, or quantised to 16 bits (32, where that is too coarse) between a least and a largest value.
const WORDS = (function () {
  const text = atob(DATA.words);
  const words = new Uint16Array(text.length / 2);
  for (let k = 0; k < words.length; k++) words[k] = text.charCodeAt(2 * k) | (text.charCodeAt(2 * k + 1) << 8);
  return words;
})();

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
  const place = Math.min(Math.max((time - DATA.t0) / (DATA.t1 - DATA.t0), 0), 1) * (DATA.count - 1);
  const k = Math.min(Math.floor(place), DATA.count - 2);
  const first = sampleAt(column, k);
  return first + (place - k) * (sampleAt(column, k + 1) - first);
}

function timeOf(k) { return DATA.t0 + (DATA.t1 - DATA.t0) * k / (DATA.count - 1); }

function frameOf(time) { return (time - DATA.t0) / (DATA.t1 - DATA.t0) * (DATA.count - 1); }

function poseOf(frame, time) { return DATA.frames[frame].map(function (index) { return valueAt(index, time); }); }

// Numbers with four digits that mean something, and a true minus sign.
function written(value) {
  if (Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-4 ? value.toExponential(3) : String(Number(value.toPrecision(4)));
  return text.replace("-", "\u2212");
}
