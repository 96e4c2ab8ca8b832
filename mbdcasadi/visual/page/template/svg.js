// --- the drawing as SVG: a pen with the methods of a canvas that the drawing uses -----------------------------------
class SvgPen {
  constructor(width, height) { this.width = width; this.height = height; this.parts = []; this.path = ""; this.dash = []; this.globalAlpha = 1; }
  setTransform() { }                                          // pixels of the screen are those of the picture
  setLineDash(dash) { this.dash = dash; }
  beginPath() { this.path = ""; }
  at(letter, x, y) { this.path += letter + x.toFixed(2) + " " + y.toFixed(2); }
  moveTo(x, y) { this.at("M", x, y); }
  lineTo(x, y) { this.at("L", x, y); }
  closePath() { this.path += "Z"; }
  arc(x, y, r) { this.at("M", x - r, y); this.path += `a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`; }
  fill() { this.parts.push(`<path d="${this.path}" fill="${this.fillStyle}" fill-rule="nonzero" opacity="${this.globalAlpha}"/>`); }
  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(" ")}"` : "";
    this.parts.push(`<path d="${this.path}" fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}" stroke-linecap="round" stroke-linejoin="round"${dash} opacity="${this.globalAlpha}"/>`);
  }
  fillRect(x, y, width, height) { this.parts.push(`<rect x="${x}" y="${y}" width="${width}" height="${height}" fill="${this.fillStyle}"/>`); }
  text(words, x, y, paint) {
    const anchor = { center: "middle", right: "end" }[this.textAlign] || "start", base = this.textBaseline === "middle" ? ' dominant-baseline="central"' : "";
    const size = /([\d.]+)px/.exec(this.font)[1], slant = this.font.startsWith("italic") ? ' font-style="italic"' : "";
    const escaped = words.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
    this.parts.push(`<text x="${x.toFixed(2)}" y="${y.toFixed(2)}" font-family="system-ui, sans-serif" font-size="${size}"${slant} text-anchor="${anchor}"${base} ${paint}>${escaped}</text>`);
  }
  fillText(words, x, y) { this.text(words, x, y, `fill="${this.fillStyle}"`); }
  strokeText(words, x, y) { this.text(words, x, y, `fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}"`); }
  toString() {
    const inside = `<clipPath id="frame"><rect width="${this.width}" height="${this.height}"/></clipPath>`;
    const space = element("play").firstElementChild.namespaceURI;
    return `<svg xmlns="${space}" width="${this.width}" height="${this.height}" viewBox="0 0 ${this.width} ${this.height}">${inside}<g clip-path="url(#frame)">${this.parts.join("\n")}</g></svg>\n`;
  }
}

function drawnAsSvg() {
  const svg = new SvgPen(pixels.width, pixels.height);
  pen = svg;
  try { drawStage(state.time, state); } finally { pen = canvasPen; }
  return svg.toString();
}
