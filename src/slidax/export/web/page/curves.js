/* Curves, bands and axes of the charts, from the results of runs. */

import { decadeAxis, extent, linearAxis } from "./axes.js";

const LOOK = [{ name: "--a", dash: [] }, { name: "--b", dash: [6, 3] }];

export function curve(result, signal, joint = 0) {
  const y = result.signals[signal];
  if (!y || !result.t.length) return null;
  const stride = y.length / result.t.length;
  if (joint >= stride && stride !== 1) return null;
  return { t: result.t, y, offset: stride === 1 ? 0 : joint, stride, rows: result.t.length };
}

/* Curves of the lower and upper bound of a joint's error; null for a run without an envelope or tolerance band. */
export function boundsOf(result, joint) {
  const [low, high] = [curve(result, "lower", joint), curve(result, "upper", joint)];
  if (low && high) return { low, high };
  const radius = curve(result, "rho", joint);
  if (!radius) return null;
  return { low: { ...radius, y: radius.y.map(value => -value) }, high: radius };
}

/* Chart rows of the errors.
   - `results`: results of A, and of B if there is one.
   - `view`: "whole", "end" or "decades". */
export function errorRows(results, names, units, view) {
  return names.map((title, joint) => {
    const errors = results.map(result => curve(result, "e", joint));
    const bounds = results.map(result => boundsOf(result, joint));
    const same = bounds[1] && bounds[0] && sameCurve(bounds[0].high, bounds[1].high) && sameCurve(bounds[0].low, bounds[1].low);
    const bands = [];
    if (bounds[0]) bands.push({ ...bounds[0], fill: "--band", edge: "--edge", dash: [] });
    if (bounds[1] && !same) bands.push({ ...bounds[1], fill: bounds[0] ? null : "--band", edge: "--b", dash: [2, 3] });
    const lines = errors.map((found, k) => ({ curve: found, ...LOOK[k] })).filter(line => line.curve);
    return { title, unit: units[joint], axis: errorAxis(bounds, lines, view), bands, lines, levels: [] };
  });
}

function errorAxis(bounds, lines, view) {
  const curves = bounds.flatMap(bound => (bound ? [bound.low, bound.high] : []));
  if (!curves.length) curves.push(...lines.map(line => line.curve));
  const at = share => curves.map(one => extent(one, Math.floor(share * (one.rows - 1)))).filter(Boolean);
  const room = (found, grown) => {
    const [low, high] = [Math.min(...found.map(one => one[0])), Math.max(...found.map(one => one[1]))];
    const margin = grown * (high - low || 1);
    return [low - margin, high + margin];
  };
  const whole = at(0);
  if (!whole.length) return linearAxis(-1, 1);
  if (view === "end") return linearAxis(...room(at(0.9), 0.25));
  const [low, high] = room(whole, 0.03);
  if (view === "whole") return linearAxis(low, high);
  const last = at(0.99).flat().map(Math.abs);
  return decadeAxis(low * 1.2, high * 1.2, Math.max(Math.max(...last) / 30, 1e-12));
}

export function torqueRows(results, names, units, limits) {
  return names.map((title, joint) => {
    const lines = results.map((result, k) => ({ curve: curve(result, "tau", joint), ...LOOK[k] })).filter(line => line.curve);
    const limit = limits?.[joint];
    const found = lines.map(line => extent(line.curve)).filter(Boolean);
    let low = Math.min(...found.map(one => one[0]), 0);
    let high = Math.max(...found.map(one => one[1]), 0);
    const levels = Number.isFinite(limit) ? [limit, -limit] : [];
    if (levels.length && Math.max(high, -low) > 0.35 * limit) [low, high] = [Math.min(low, -limit), Math.max(high, limit)];
    const margin = 0.06 * (high - low || 1);
    const unit = units[joint] === "m" ? "N" : "N m";
    return { title, unit, axis: linearAxis(low - margin, high + margin), bands: [], lines, levels };
  });
}

function sameCurve(a, b) {
  if (a.rows !== b.rows) return false;
  for (let row = 0; row < a.rows; row += 7) if (a.y[a.offset + row * a.stride] !== b.y[b.offset + row * b.stride]) return false;
  return true;
}

/* Error relative to its bound at each sample, for the joint nearest to its bound: 0 without an error, 1 at the bound. */
export function nearness(result, joints) {
  const found = new Float64Array(result.t.length);
  let known = false;
  for (let joint = 0; joint < joints; joint++) {
    const bounds = boundsOf(result, joint);
    const error = curve(result, "e", joint);
    if (!bounds || !error) continue;
    known = true;
    for (let row = 0; row < found.length; row++) {
      const e = error.y[error.offset + row * error.stride];
      const bound = e < 0 ? bounds.low : bounds.high;
      const share = e / bound.y[bound.offset + row * bound.stride];
      if (share > found[row] || Number.isNaN(share)) found[row] = Number.isNaN(share) ? Infinity : share;
    }
  }
  return known ? found : null;
}

/* First time at which a joint was at or outside a bound: {time, joint from 1}; null if never, undefined without an
   envelope. */
export function firstOutside(result, joints) {
  let first = null;
  let known = false;
  for (let joint = 0; joint < joints; joint++) {
    const bounds = boundsOf(result, joint);
    const error = curve(result, "e", joint);
    if (!bounds || !error) continue;
    known = true;
    for (let row = 0; row < (first?.row ?? error.rows); row++) {
      const at = one => one.y[one.offset + row * one.stride];
      if (!(at(error) > at(bounds.low) && at(error) < at(bounds.high))) {
        first = { row, time: result.t[row], joint: joint + 1 };
        break;
      }
    }
  }
  return known ? first : undefined;
}
