// --- poses of frames and how numbers are written; valueAt(column, time) is what the page knows ------------
// Pose of a frame: its place, cosine and sine of its angle, and its length.
function poseOf(number, time) {
  const frame = DATA.frames[number], values = frame.c.map(index => valueAt(index, time));
  let x, y;
  if (frame.a) {
    const base = poseOf(frame.a[0], time);
    x = base[0] + base[2] * frame.a[1] - base[3] * frame.a[2];
    y = base[1] + base[3] * frame.a[1] + base[2] * frame.a[2];
  } else { x = values.shift(); y = values.shift(); }
  if (frame.v === undefined) return [x, y, Math.cos(values[0]), Math.sin(values[0]), values[1]];
  const size = Math.hypot(values[0], values[1]), along = size > 0 ? [values[0] / size, values[1] / size] : [1, 0];
  return [x, y, along[0], along[1], frame.v ? frame.v * size : 1];
}

// A number with four digits, or fewer where they are not known, and a true minus sign.
function written(value, decimals) {
  const size = Math.abs(value), known = decimals === undefined ? 12 : decimals;
  if (size < 0.5 * Math.pow(10, -known)) return "0";
  const power = Math.floor(Math.log10(size)), places = Math.min(3 - power, known);
  let text;
  if (size >= 1e5 || size < 1e-4) text = value.toExponential(Math.min(Math.max(places + power, 0), 3));
  else if (places >= 0) text = String(Number(value.toFixed(places)));
  else text = String(Math.round(value / Math.pow(10, -places)) * Math.pow(10, -places));
  return text.replace("-", "\u2212");
}
