// --- how numbers are written, and units ------------------------------------------------------------------------
// A number with three digits that count, or fewer where they are not known, and a true minus sign.
function written(value, decimals) {
  const size = Math.abs(value), known = decimals === undefined ? 12 : decimals;
  if (!(size < Infinity)) return "\u2013";
  if (size < 0.5 * Math.pow(10, -known)) return "0";
  const power = Math.floor(Math.log10(size * (1 + 1e-12))), places = Math.min(2 - power, known);
  let text;
  if (size >= 1e6 || size < 1e-4) text = value.toExponential(Math.min(Math.max(places + power, 0), 2)).replace("e+", "e");
  else text = value.toFixed(Math.max(places, 0));
  return text.replace("-", "\u2212");
}

// Round distances for ticks: 1, 2 or 5 times a power of ten.
function roundStep(least) {
  const power = Math.pow(10, Math.floor(Math.log10(least)));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= least * (1 - 1e-9)) return factor * power;
  return 10 * power;
}
// A multiple of a step, with the decimals of the step.
function tick(value, step) {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  if (decimals > 5 || Math.abs(value) >= 1e6) return written(value);
  return (Math.abs(value) < 1e-9 * step ? 0 : value).toFixed(decimals).replace("-", "\u2212");
}

// A label "angle, rad" as its name and its unit.
function parted(label) {
  const comma = label.lastIndexOf(", ");
  return comma < 0 ? [label, ""] : [label.slice(0, comma), label.slice(comma + 2)];
}
const PREFIXED = /^(N|W|J|Pa|Hz|V|A|N m|N\/m|N s\/m|N m\/rad|N m s|N s)$/;
// A unit as it is shown: its name, and how many of it are one of the page's. Units of loads and powers take the prefix
// that fits a size; angles and lengths are switched.
function unitFor(unit, size) {
  if (state.degrees && /^rad\b/.test(unit)) return { name: unit.replace(/^rad/, "\u00b0"), factor: 180 / Math.PI };
  if (state.millimetres && /^m(\/s.*)?$/.test(unit)) return { name: "m" + unit, factor: 1000 };
  if (PREFIXED.test(unit)) {
    for (const [prefix, factor] of [["G", 1e-9], ["M", 1e-6], ["k", 1e-3]]) if (size * factor >= 1) return { name: prefix + unit, factor: factor };
  }
  return { name: unit, factor: 1 };
}
// A value with its unit; what is known of it are so many decimals in the page's unit.
function measured(value, unit, decimals) {
  const shown = unitFor(unit, Math.abs(value));
  const known = decimals === undefined ? undefined : decimals - Math.round(Math.log10(shown.factor));
  return written(value * shown.factor, known) + (shown.name ? " " + shown.name : "");
}
