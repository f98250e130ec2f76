/* Axes: they map numbers to places in a chart, from 0 to 1. */

import { ticksBetween } from "./numbers.js";

/* A linear axis. */
export function linearAxis(low, high) {
  const span = high - low || 1;
  return { low, high, place: y => (y - low) / span, ticks: count => ticksBetween(low, high, count) };
}

/* An axis that is about linear within ±`near`, and logarithmic beyond. */
export function decadeAxis(low, high, near) {
  const bent = y => Math.sign(y) * Math.log10(1 + Math.abs(y) / near);
  const [a, b] = [bent(low), bent(high)];
  const ticks = () => {
    const made = [0];
    for (let size = 10 ** Math.ceil(Math.log10(near * 3)); size <= Math.max(-low, high); size *= 10) {
      if (size <= high) made.push(Number(size.toPrecision(3)));
      if (-size >= low) made.push(-Number(size.toPrecision(3)));
    }
    return made.sort((x, y) => x - y);
  };
  return { low, high, place: y => (bent(y) - a) / (b - a), ticks };
}

/* [least, greatest] finite value of a signal from the sample `from` on; null if there is none. */
export function extent({ y, offset, stride, rows }, from = 0) {
  let low = Infinity, high = -Infinity;
  for (let row = from; row < rows; row++) {
    const value = y[offset + row * stride];
    if (value < low && value > -Infinity) low = value;
    if (value > high && value < Infinity) high = value;
  }
  return low <= high ? [low, high] : null;
}
