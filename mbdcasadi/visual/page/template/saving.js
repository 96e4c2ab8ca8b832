// --- files: the drawing as PNG, SVG or GIF, and what is read as a table --------------------------------------------
function download(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type: type }));
  link.download = (DATA.title || "mechanism").replace(/[^\w-]+/g, "_") + name;
  link.click();
  URL.revokeObjectURL(link.href);
}
function commaSeparated() {
  const data = table(), quoted = name => '"' + name.replaceAll('"', '""') + '"';
  return [["t, s", ...data.names].map(quoted).join(","), ...data.rows.map(row => row.join(","))].join("\r\n") + "\r\n";
}

// A GIF of what the slider spans, in the colours that it shows most.
const GIF_FRAMES = 240, GIF_WIDTH = 640, GIF_PACE = 5;        // frames at most, pixels, hundredths of a second for a frame
const GIF_LOOKS = 12;                                         // frames in which colours are counted
function* animated(most) {
  const share = shareOfSlider(), span = timeSpanOfSlider(), seconds = (span[1] - span[0]) / (DATA.speed * state.factor);
  const count = Math.max(1, Math.min(most, Math.round(100 * seconds / GIF_PACE)));
  const small = document.createElement("canvas"), scale = Math.min(1, GIF_WIDTH / pixels.width);
  small.width = Math.round(pixels.width * scale); small.height = Math.round(pixels.height * scale);
  const brush = small.getContext("2d", { willReadFrequently: true });
  try {
    for (let k = 0; k < count; k++) {
      slideTo(count > 1 ? k / (count - 1) : share);
      drawStage(state.time, state);
      brush.drawImage(stage, 0, 0, small.width, small.height);
      yield brush.getImageData(0, 0, small.width, small.height);
    }
  } finally { slideTo(share); }
}
// Colours of the pixels of an image as numbers; shades of smoothed edges are told apart by eights.
function shades(image) {
  const pixel = image.data, colours = new Uint32Array(pixel.length / 4), coarse = x => Math.min(255, (x + 4) >> 3 << 3);
  for (let i = 0; i < colours.length; i++) colours[i] = coarse(pixel[4 * i]) << 16 | coarse(pixel[4 * i + 1]) << 8 | coarse(pixel[4 * i + 2]);
  return colours;
}
// Compressed numbers of colours, in blocks (LZW).
function compressed(indices) {
  const bytes = [8], block = [], table = new Map();
  let bits = 0, filled = 0, width = 9, next = 258, prefix = indices[0];
  const flush = () => { if (block.length) bytes.push(block.length, ...block.splice(0)); };
  const write = code => {
    bits |= code << filled; filled += width;
    while (filled >= 8) { block.push(bits & 255); bits >>= 8; filled -= 8; if (block.length === 255) flush(); }
  };
  write(256);
  for (let i = 1; i < indices.length; i++) {
    const key = prefix * 256 + indices[i], known = table.get(key);
    if (known !== undefined) { prefix = known; continue; }
    write(prefix);
    if (next < 4096) { table.set(key, next); if (next++ === 1 << width) width++; }
    else { write(256); table.clear(); width = 9; next = 258; }
    prefix = indices[i];
  }
  write(prefix); write(257);
  if (filled) block.push(bits & 255);
  flush();
  bytes.push(0);
  return bytes;
}
function drawnAsGif() {
  const counts = new Map(), numbers = new Map(), parts = [], word = n => [n & 255, n >> 8];
  for (const image of animated(GIF_LOOKS)) for (const colour of shades(image)) counts.set(colour, (counts.get(colour) || 0) + 1);
  const palette = Array.from(counts.keys()).sort((a, b) => counts.get(b) - counts.get(a)).slice(0, 256);
  palette.forEach((colour, k) => { numbers.set(colour, k); });
  const apart = (a, b) => [16, 8, 0].reduce((sum, shift) => { const d = (a >> shift & 255) - (b >> shift & 255); return sum + d * d; }, 0);
  const nearest = colour => {
    if (!numbers.has(colour)) numbers.set(colour, palette.reduce((best, one, k) => apart(one, colour) < apart(palette[best], colour) ? k : best, 0));
    return numbers.get(colour);
  };
  let size = null;
  for (const image of animated(GIF_FRAMES)) {
    size = [...word(image.width), ...word(image.height)];
    parts.push(new Uint8Array([0x21, 0xf9, 4, 0, ...word(GIF_PACE), 0, 0, 0x2c, 0, 0, 0, 0, ...size, 0]), new Uint8Array(compressed(Uint8Array.from(shades(image), nearest))));
  }
  const colours = Array.from({ length: 256 }, (_, k) => palette[k] || 0).flatMap(rgb => [rgb >> 16, rgb >> 8 & 255, rgb & 255]);
  const letters = text => Array.from(text, letter => letter.charCodeAt(0));
  const head = [...letters("GIF89a"), ...size, 0xf7, 0, 0, ...colours, 0x21, 0xff, 11, ...letters("NETSCAPE2.0"), 3, 1, 0, 0, 0];
  return new Blob([new Uint8Array(head), ...parts, new Uint8Array([0x3b])]);
}

element("png").addEventListener("click", () => { drawStage(state.time, state); stage.toBlob(blob => { download(".png", blob, "image/png"); show(); }); });
element("svg").addEventListener("click", () => { download(".svg", drawnAsSvg(), "image/svg+xml"); });
element("gif").addEventListener("click", () => { setPlaying(false); download(".gif", drawnAsGif(), "image/gif"); });
element("csv").addEventListener("click", () => { download(".csv", commaSeparated(), "text/csv"); });

// --- the address holds what is set, so that a link shows it; a page in another one leaves that one's address alone ---
let noted = null;
const FLAGS = ["forces", "velocities", "names", "degrees", "millimetres", "dark"];
function address() {
  const set = FLAGS.map(name => [name, state[name] ? "1" : "0"]), asked = new URLSearchParams(set);
  if (!DATA.live) asked.set("t", String(state.time));
  if (view.held) asked.set("view", [...fromScreen([0, 0]), ...fromScreen([pixels.width, pixels.height])].map(x => x.toPrecision(6)).join());
  for (const plot of plots) asked.append("plot", plot.label + (plot.x === null ? "" : "~" + plot.xLabel));
  for (const [name, value] of addressOfModel()) asked.append(name, value);
  return "#" + asked;
}
function noteAddress() {
  if (framed || state.playing) return;
  clearTimeout(noted);
  noted = setTimeout(() => { window.history.replaceState(null, "", address()); }, 300);
}
function takeAddress() {
  const asked = new URLSearchParams(window.location.hash.slice(1));
  if (framed || !asked.has("forces")) return;
  for (const name of FLAGS) state[name] = asked.get(name) === "1";
  state.loads = state.forces;
  const known = quantities(), shown = asked.getAll("plot").map(text => text.split("~"));
  for (const plot of plots.slice()) if (!shown.some(([label]) => label === plot.label)) dropPlot(plot.label);
  for (const [label, over] of shown) {
    const y = known.find(one => one[0] === label), x = known.findIndex(one => one[0] === over);
    if (!plots.some(one => one.label === label) && y) addPlot({ label: label, lines: [{ name: "", column: y[1], d: y[2] }] });
    const plot = plots.find(one => one.label === label);
    if (plot && x >= 0) plotOver(plot, x);
  }
  takeAddressOfModel(asked);
  const seen = (asked.get("view") || "").split(",").map(Number);
  if (seen.length === 4 && seen.every(isFinite) && seen[0] !== seen[2]) wanted = seen;
}
// The corners that an address asks for, m: top left and bottom right.
let wanted = null;
function lookAtWanted() {
  if (!wanted) return;
  const scale = Math.min(pixels.width / Math.abs(wanted[2] - wanted[0]), pixels.height / Math.abs(wanted[3] - wanted[1]));
  view.zoom = scale / pixels.scale;
  const at = toScreen((wanted[0] + wanted[2]) / 2, (wanted[1] + wanted[3]) / 2);
  view.x += pixels.width / 2 - at[0];
  view.y += pixels.height / 2 - at[1];
  view.held = true;
  wanted = null;
}
element("link").addEventListener("click", async () => {
  const link = window.location.href.split("#")[0] + address();
  try { await navigator.clipboard.writeText(link); tell("the link is on the clipboard"); } catch (error) { tell(link); }
});
