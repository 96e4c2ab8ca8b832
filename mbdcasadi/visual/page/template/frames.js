// --- poses of frames; valueOf(column) is what is known of a moment ----------------------------------------------
// Pose of a frame: its place, cosine and sine of its angle, and its length.
function poseOf(number, valueOf) {
  const frame = DATA.frames[number], values = frame.c.map(valueOf);
  let x, y;
  if (frame.a) {
    const base = poseOf(frame.a[0], valueOf);
    x = base[0] + base[2] * frame.a[1] - base[3] * frame.a[2];
    y = base[1] + base[3] * frame.a[1] + base[2] * frame.a[2];
  } else { x = values.shift(); y = values.shift(); }
  if (frame.v === undefined) return [x, y, Math.cos(values[0]), Math.sin(values[0]), values[1]];
  const size = Math.hypot(values[0], values[1]), along = size > 0 ? [values[0] / size, values[1] / size] : [1, 0];
  return [x, y, along[0], along[1], frame.v ? frame.v * size : 1];
}
// Columns at the time that is shown, and poses from them.
const shownValue = index => valueAt(index, state.time);
const shownPose = number => poseOf(number, shownValue);
