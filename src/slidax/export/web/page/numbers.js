/* Numbers as text, never "NaN". */

/* For a reader: a few digits; "–" if the number is not finite. */
export function shownNumber(x, digits = 4) {
  if (typeof x !== "number" || !Number.isFinite(x)) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  if (size < 1e5 && size >= 1e-3) return String(Number(x.toPrecision(digits)));
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e");
  return `${Number(mantissa)}e${Number(exponent)}`;
}

/* For a program: the shortest text that is read as the same number. */
export function exactNumber(x) {
  if (!Number.isFinite(x)) throw new RangeError("only finite numbers are written");
  return String(Object.is(x, -0) ? "-0.0" : x);
}

export function withUnit(x, unit, digits = 4) {
  const one = x === 1 && unit === "periods" ? "period" : unit;
  return unit ? `${shownNumber(x, digits)} ${one}` : shownNumber(x, digits);
}

/* Rounds to a few digits, for a slider. */
export function rounded(x, digits = 3) {
  return Number(x.toPrecision(digits));
}

/* Round numbers from low to high, about `count` of them. */
export function ticksBetween(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(factor => factor * power).find(size => size >= raw * 0.999);
  const first = Math.ceil(low / step - 1e-9);
  const ticks = [];
  for (let k = first; k * step <= high + 1e-9 * span; k++) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

/* The text with a capital first letter, except for symbols such as k₁. */
export function capitalised(text) {
  return text.replace(/^\p{Ll}(?=\p{L})/u, letter => letter.toUpperCase());
}
