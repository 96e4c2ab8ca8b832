// --- plots that move along: over time, or over any other quantity ---------------------------------------------------
const MARGIN = { left: 56, right: 10, top: 24, bottom: 22 };
const plots = [];
// All that can be read, as [label, column, decimals]; lines of plots first.
function quantities() {
  const named = DATA.plots.flatMap(plot => plot.lines.map(line => [lineName(plot, line), line.column, line.d]));
  for (const item of DATA.items) for (const reading of item.readings) named.push([item.name + ": " + reading.label, reading.column, reading.d]);
  return named;
}
function lineName(plot, line) {
  const [name, unit] = parted(plot.label);
  return line.name ? name + " " + line.name + (unit ? ", " + unit : "") : plot.label;
}
function addPlot(plot) {
  const holder = document.createElement("div"), canvas = document.createElement("canvas"), over = document.createElement("select");
  holder.className = "plot";
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "plot of " + plot.label);
  canvas.title = plot.label;
  over.title = "what it is plotted over";
  over.add(new Option("over time", ""));
  quantities().forEach(([label], k) => { over.add(new Option(parted(label)[0], String(k))); });
  holder.append(canvas, over);
  document.getElementById("plots").appendChild(holder);
  const added = { holder: holder, canvas: canvas, still: document.createElement("canvas"), stillFor: null, label: plot.label, unit: parted(plot.label)[1],
                  lines: plot.lines, x: null, xLabel: "time, s", low: 0, high: 1, span: timeSpan(), measured: null, width: 0, height: 0, wide: 0 };
  over.addEventListener("change", () => { plotOver(added, over.value === "" ? null : Number(over.value)); show(); });
  added.select = over;
  for (const kind of ["pointerdown", "pointermove"]) canvas.addEventListener(kind, event => { scrub(added, event); });
  plots.push(added);
}
// Plot over the quantity of a number, or over time.
function plotOver(plot, number) {
  const [label, column] = number === null ? ["time, s", null] : quantities()[number];
  Object.assign(plot, { x: column, xLabel: label, measured: null, stillFor: null });
  plot.select.value = number === null ? "" : String(number);
}
function dropPlot(label) {
  const number = plots.findIndex(one => one.label === label);
  if (number < 0) return false;
  plots.splice(number, 1)[0].holder.remove();
  return true;
}

// The values that a plot spans, with those of the moment, and the units in which they are shown.
function measure(plot) {
  const now = [plot.x === null ? state.time : shownValue(plot.x), plot.lines.map(line => shownValue(line.column))];
  const key = [revision(), state.degrees, state.millimetres, DATA.live ? state.time : 0].join();
  if (plot.measured === key) return;
  plot.measured = key;
  let low = Math.min(...now[1]), high = Math.max(...now[1]), left = now[0], right = now[0];
  const span = timeSpan();
  plot.series = plot.lines.map(line => series(plot.x, line.column, plot.x === null ? span[0] : -Infinity));
  for (const { points } of plot.series) {
    for (const point of points) {
      if (!isFinite(point[0] + point[1])) continue;
      low = Math.min(low, point[1]); high = Math.max(high, point[1]);
      left = Math.min(left, point[0]); right = Math.max(right, point[0]);
    }
  }
  [plot.low, plot.high] = widened(low, high, 0.06);
  plot.span = plot.x === null ? span : widened(left, right, 0.02);
  plot.yUnit = unitFor(plot.unit, Math.max(Math.abs(low), Math.abs(high)));
  plot.xUnit = unitFor(parted(plot.xLabel)[1], Math.max(Math.abs(left), Math.abs(right)));
}
function widened(low, high, share) {
  if (!(low <= high)) low = high = 0;
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (high - low < 1e-9 * Math.max(size, 1e-3)) { const room = size > 1e-9 ? 0.1 * size : 1; low -= room; high += room; }
  const room = share * (high - low);
  return [low - room, high + room];
}

function fitPlots() {
  const ratio = window.devicePixelRatio || 1;
  for (const plot of plots) {
    plot.width = plot.holder.clientWidth;
    plot.height = plot.holder.clientHeight;
    plot.canvas.width = Math.round(plot.width * ratio);
    plot.canvas.height = Math.round(plot.height * ratio);
  }
}

function across(plot, x) {
  return MARGIN.left + (x - plot.span[0]) / (plot.span[1] - plot.span[0]) * (plot.width - MARGIN.left - MARGIN.right);
}

function heightOf(plot, value) {
  const bottom = plot.height - MARGIN.bottom;
  return bottom - (value - plot.low) / (plot.high - plot.low) * (bottom - MARGIN.top);
}

// Axes and lines, which stay while the time goes on: drawn once, with every knot, so that no peak is missing.
function drawStill(draw, plot, theme, colours) {
  drawAxes(draw, plot, theme);
  plot.series.forEach(({ points, strokes }, number) => {
    draw.strokeStyle = colours[number % colours.length];
    draw.lineWidth = 1.7;
    draw.lineJoin = "round";
    draw.beginPath();
    let begun = false;
    points.forEach((point, k) => {
      if (!isFinite(point[0] + point[1])) { begun = false; return; }
      const x = across(plot, point[0]), y = heightOf(plot, point[1]);
      if (begun && !(strokes && strokes[k] !== strokes[k - 1])) draw.lineTo(x, y); else draw.moveTo(x, y);
      begun = true;
    });
    draw.stroke();
  });
}

function drawPlots(time, dark) {
  const theme = dark ? DATA.dark : DATA.light, colours = dark ? DATA.seriesDark : DATA.seriesLight;
  for (const plot of plots) {
    const draw = plot.canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
    measure(plot);
    const wanted = [plot.measured, dark, ratio, plot.canvas.width, plot.canvas.height].join();
    if (!DATA.live && plot.stillFor !== wanted) {
      const still = plot.still.getContext("2d");
      plot.still.width = plot.canvas.width;
      plot.still.height = plot.canvas.height;
      still.setTransform(ratio, 0, 0, ratio, 0, 0);
      drawStill(still, plot, theme, colours);
      plot.stillFor = wanted;
    }
    draw.setTransform(1, 0, 0, 1, 0, 0);
    draw.clearRect(0, 0, plot.canvas.width, plot.canvas.height);
    if (!DATA.live && plot.still.width && plot.still.height) draw.drawImage(plot.still, 0, 0);
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (DATA.live) drawStill(draw, plot, theme, colours);     // the lines of a mechanism that runs change every time
    draw.font = "12px system-ui, sans-serif";
    const x = across(plot, plot.x === null ? time : shownValue(plot.x));
    let left = MARGIN.left + plot.wide + 12;
    plot.lines.forEach((line, number) => {
      const value = shownValue(line.column), factor = plot.yUnit.factor;
      const text = (line.name ? line.name + " " : "") + written(value * factor, line.d - Math.round(Math.log10(factor)));
      draw.fillStyle = colours[number % colours.length];
      draw.fillText(text, left, 14);
      left += draw.measureText(text).width + 12;
      draw.beginPath(); draw.arc(x, heightOf(plot, value), 3.5, 0, 7); draw.fill();
    });
    draw.strokeStyle = theme.motion;
    draw.lineWidth = 1.2;
    draw.beginPath();
    draw.moveTo(x, MARGIN.top);
    draw.lineTo(x, plot.height - MARGIN.bottom);
    draw.stroke();
  }
}

// A label in the units that are shown, shortened before its component if what follows would not have room.
function fitted(draw, label, unit, room) {
  const name = parted(label)[0], [whole, component] = parted(name), end = (component ? ", " + component : "") + (unit.name ? ", " + unit.name : "");
  let begin = whole;
  while (begin && draw.measureText(begin + (begin === whole ? "" : "\u2026") + end).width > room) begin = begin.slice(0, -1);
  return begin === whole ? whole + end : begin.trimEnd() + "\u2026" + end;
}

function drawAxes(draw, plot, theme) {
  const bottom = plot.height - MARGIN.bottom, right = plot.width - MARGIN.right;
  draw.font = "11px system-ui, sans-serif";
  draw.strokeStyle = theme.soil;
  draw.fillStyle = theme.muted;
  draw.lineWidth = 1;
  const y = plot.yUnit.factor, step = roundStep((plot.high - plot.low) * y * Math.max(28 / Math.max(bottom - MARGIN.top, 1), 1 / 8));
  draw.textAlign = "right";
  for (let value = Math.ceil(plot.low * y / step) * step; value <= plot.high * y; value += step) {
    const at = heightOf(plot, value / y);
    draw.beginPath(); draw.moveTo(MARGIN.left, at); draw.lineTo(right, at); draw.stroke();
    draw.fillText(tick(value, step), MARGIN.left - 5, at + 4);
  }
  draw.textAlign = "center";
  const x = plot.xUnit.factor, pace = roundStep((plot.span[1] - plot.span[0]) * x * 60 / Math.max(right - MARGIN.left, 1)), end = plot.span[1] * x + 1e-9 * pace;
  for (let value = Math.ceil(plot.span[0] * x / pace - 1e-9) * pace; value <= end; value += pace) {
    const text = tick(value, pace) + (value + pace > end ? " " + plot.xUnit.name : ""), half = draw.measureText(text).width / 2 + 1;
    draw.fillText(text, Math.min(across(plot, value / x), plot.width - half), plot.height - 7);
  }
  draw.textAlign = "left";
  draw.font = "600 12px system-ui, sans-serif";
  draw.fillStyle = theme.ink;
  const values = plot.lines.reduce((sum, line) => sum + 12 + draw.measureText(line.name + " \u22120.0000").width, 0);
  const label = fitted(draw, plot.label, plot.yUnit, Math.max(right - MARGIN.left - plot.select.offsetWidth - values, 70));
  draw.fillText(label, MARGIN.left, 14);
  plot.wide = draw.measureText(label).width;
  draw.font = "12px system-ui, sans-serif";
}

// A plot is pointed at: the page goes to that moment.
function scrub(plot, event) {
  if (!event.buttons) return;
  setPlaying(false);
  const corner = plot.canvas.getBoundingClientRect(), x = event.clientX - corner.left, y = event.clientY - corner.top;
  if (plot.x === null) {
    seek(plot.span[0] + (x - MARGIN.left) / (plot.width - MARGIN.left - MARGIN.right) * (plot.span[1] - plot.span[0]));
    return;
  }
  let nearest = Infinity, time = state.time;
  for (const { points, times } of plot.series) points.forEach((point, k) => {
    const apart = Math.hypot(across(plot, point[0]) - x, heightOf(plot, point[1]) - y);
    if (apart < nearest) { nearest = apart; time = times[k]; }
  });
  seek(time);
}
DATA.plots.forEach(addPlot);
