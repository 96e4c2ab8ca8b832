// --- plots that move along -----------------------------------------------------------------
const MARGIN = { left: 56, right: 10, top: 24, bottom: 22 };
const plots = [];
function addPlot(plot) {
  const canvas = document.createElement("canvas");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "plot of " + plot.label + " over time");
  canvas.title = plot.label;
  document.getElementById("plots").appendChild(canvas);
  const lines = plot.lines.map(line => { return { name: line.name, column: line.column, d: line.d }; });
  const added = { canvas: canvas, still: document.createElement("canvas"), stillFor: null, label: plot.label, lines: lines,
                  low: 0, high: 1, span: timeSpan(), measured: null, width: 0, height: 0 };
  for (const kind of ["pointerdown", "pointermove"]) canvas.addEventListener(kind, event => { scrub(added, event); });
  plots.push(added);
}
DATA.plots.forEach(addPlot);
function dropPlot(label) {
  const number = plots.findIndex(one => one.label === label);
  if (number < 0) return false;
  plots.splice(number, 1)[0].canvas.remove();
  return true;
}

// The time that a plot spans, and the values of its lines over it.
function measure(plot) {
  if (plot.measured === revision()) return;
  plot.measured = revision();
  plot.span = timeSpan();
  let low = Infinity, high = -Infinity;
  for (const line of plot.lines) {
    for (const point of pointsOf(line.column)) {
      if (point[0] < plot.span[0] || !isFinite(point[1])) continue;
      low = Math.min(low, point[1]);
      high = Math.max(high, point[1]);
    }
  }
  if (!(low <= high)) low = high = 0;
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (high - low < 1e-9 * Math.max(size, 1e-3)) { const room = size > 1e-9 ? 0.1 * size : 1; low -= room; high += room; }
  const room = 0.06 * (high - low);
  plot.low = low - room;
  plot.high = high + room;
}

function fitPlots() {
  for (const plot of plots) {
    const ratio = window.devicePixelRatio || 1, holder = plot.canvas.parentElement;
    plot.width = holder.clientWidth;
    plot.height = window.innerWidth <= 760 ? 130 : Math.max(110, Math.min(210, (pixels.height - 8 * (plots.length - 1)) / plots.length));
    plot.canvas.style.height = plot.height + "px";
    plot.canvas.width = Math.round(plot.width * ratio);
    plot.canvas.height = Math.round(plot.height * ratio);
  }
}

function across(plot, time) {
  return MARGIN.left + (time - plot.span[0]) / (plot.span[1] - plot.span[0]) * (plot.width - MARGIN.left - MARGIN.right);
}

function heightOf(plot, value) {
  const bottom = plot.height - MARGIN.bottom;
  return bottom - (value - plot.low) / (plot.high - plot.low) * (bottom - MARGIN.top);
}

// Axes and lines, which stay while the time goes on: drawn once, with every knot, so that no peak is missing.
function drawStill(draw, plot, theme, series) {
  drawAxes(draw, plot, theme);
  plot.lines.forEach((line, number) => {
    draw.strokeStyle = series[number % series.length];
    draw.lineWidth = 1.7;
    draw.lineJoin = "round";
    draw.beginPath();
    let begun = false;
    pointsOf(line.column).forEach(point => {
      if (point[0] < plot.span[0] || !isFinite(point[1])) { begun = false; return; }
      const x = across(plot, point[0]), y = heightOf(plot, point[1]);
      if (begun) draw.lineTo(x, y); else draw.moveTo(x, y);
      begun = true;
    });
    draw.stroke();
  });
}

function drawPlots(time, dark) {
  const theme = dark ? DATA.dark : DATA.light, series = dark ? DATA.seriesDark : DATA.seriesLight;
  for (const plot of plots) {
    const draw = plot.canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
    measure(plot);
    const wanted = [plot.measured, dark, ratio, plot.canvas.width, plot.canvas.height].join();
    if (!DATA.live && plot.stillFor !== wanted) {
      const still = plot.still.getContext("2d");
      plot.still.width = plot.canvas.width;
      plot.still.height = plot.canvas.height;
      still.setTransform(ratio, 0, 0, ratio, 0, 0);
      drawStill(still, plot, theme, series);
      plot.stillFor = wanted;
    }
    draw.setTransform(1, 0, 0, 1, 0, 0);
    draw.clearRect(0, 0, plot.canvas.width, plot.canvas.height);
    if (!DATA.live && plot.still.width && plot.still.height) draw.drawImage(plot.still, 0, 0);
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (DATA.live) drawStill(draw, plot, theme, series);      // the lines of a mechanism that runs change every time
    draw.font = "12px system-ui, sans-serif";
    let left = MARGIN.left + plot.wide + 12;
    plot.lines.forEach((line, number) => {
      const value = valueAt(line.column, time), text = (line.name ? line.name + " " : "") + written(value, line.d);
      draw.fillStyle = series[number % series.length];
      draw.fillText(text, left, 14);
      left += draw.measureText(text).width + 12;
      draw.beginPath(); draw.arc(across(plot, time), heightOf(plot, value), 3.5, 0, 7); draw.fill();
    });
    draw.strokeStyle = theme.motion;
    draw.lineWidth = 1.2;
    draw.beginPath();
    draw.moveTo(across(plot, time), MARGIN.top);
    draw.lineTo(across(plot, time), plot.height - MARGIN.bottom);
    draw.stroke();
  }
}

// Label of a plot, shortened where the values after it would not have room.
function fitted(draw, plot) {
  const values = plot.lines.reduce((sum, line) => sum + 12 + draw.measureText(line.name + " \u22120.00000").width, 0);
  const room = Math.max(plot.width - MARGIN.left - values, 90);
  let text = plot.label;
  while (text && draw.measureText(text + "\u2026").width > room) text = text.slice(0, -1);
  return draw.measureText(plot.label).width <= room ? plot.label : text.trimEnd() + "\u2026";
}

function drawAxes(draw, plot, theme) {
  const bottom = plot.height - MARGIN.bottom;
  draw.font = "11px system-ui, sans-serif";
  draw.strokeStyle = theme.soil;
  draw.fillStyle = theme.muted;
  draw.lineWidth = 1;
  const step = roundStep((plot.high - plot.low) * 28 / (bottom - MARGIN.top));
  draw.textAlign = "right";
  for (let value = Math.ceil(plot.low / step) * step; value <= plot.high; value += step) {
    draw.beginPath(); draw.moveTo(MARGIN.left, heightOf(plot, value)); draw.lineTo(plot.width - MARGIN.right, heightOf(plot, value)); draw.stroke();
    draw.fillText(written(Math.abs(value) < 1e-9 * step ? 0 : value), MARGIN.left - 5, heightOf(plot, value) + 4);
  }
  draw.textAlign = "center";
  const pace = roundStep((plot.span[1] - plot.span[0]) * 60 / Math.max(plot.width - MARGIN.left - MARGIN.right, 1));
  for (let time = Math.ceil(plot.span[0] / pace - 1e-9) * pace; time <= plot.span[1] + 1e-9 * pace; time += pace) {
    const last = time + pace > plot.span[1] + 1e-9 * pace;
    draw.fillText(written(Math.abs(time) < 1e-9 * pace ? 0 : time) + (last ? " s" : ""), Math.min(across(plot, time), plot.width - 18), plot.height - 7);
  }
  draw.textAlign = "left";
  draw.font = "600 12px system-ui, sans-serif";
  draw.fillStyle = theme.ink;
  const label = fitted(draw, plot);
  draw.fillText(label, MARGIN.left, 14);
  plot.wide = draw.measureText(label).width;
  draw.font = "12px system-ui, sans-serif";
}
