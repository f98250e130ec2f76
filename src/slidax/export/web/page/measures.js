/* Tables of metrics: of a run, of two runs in comparison, and of each joint. */

import { element, tableOf } from "./dom.js";
import { shownNumber } from "./numbers.js";

/* Key, title, unit ("q" for that of the joint, "tau" for that of its torque), and true if the smallest value is worst. */
const MEASURES = [
  ["settling_time.1e-2", "settled to |e| ≤ 1e-2", "s"],
  ["settling_time.1e-3", "settled to |e| ≤ 1e-3", "s"],
  ["settling_time.1e-4", "settled to |e| ≤ 1e-4", "s"],
  ["steady_error", "steady error", "q"],
  ["rms_error", "error, rms", "q"],
  ["iae", "integral of |e|", "q s"],
  ["envelope_margin", "envelope margin", "of its width", true],
  ["tolerance_margin", "margin in the tolerance band", "of its width", true],
  ["envelope_violations", "samples outside", ""],
  ["peak_torque", "peak torque", "tau"],
  ["initial_torque", "initial torque", "tau"],
  ["max_torque_step", "torque step, max", "tau"],
  ["steady_torque_step", "torque step, steady", "tau"],
  ["steady_torque_step_rms", "torque step, steady, rms", "tau"],
  ["torque_energy", "torque energy", "tau² s"],
  ["torque_travel", "torque travel", "tau"],
];

function known(results) {
  const has = key => results.some(result => result.metrics?.[key]?.length);
  const listed = MEASURES.filter(([key]) => has(key));
  const settling = Object.keys(results[0].metrics ?? {}).filter(key => key.startsWith("settling_time."));
  return listed.length ? listed : settling.map(key => [key, key, "s"]);
}

function worst(values, least) {
  if (!values?.length) return NaN;
  const numbers = Array.from(values);
  if (numbers.some(value => !Number.isFinite(value))) return NaN;
  return least ? Math.min(...numbers) : Math.max(...numbers);
}

function unitText(unit, units) {
  const angle = units.every(one => one === units[0]) ? units[0] : "rad or m";
  const torque = { rad: "N m", m: "N" }[angle] ?? "N m or N";
  if (unit === "q") return angle;
  if (unit === "q s") return `${angle} s`;
  return unit.replace("tau²", torque.includes(" ") ? `(${torque})²` : `${torque}²`).replace("tau", torque);
}

/* - `results`: results of A, and of B if there is one.
   - `titles`: titles of the results. */
export function showMeasures(place, results, titles, joints, units) {
  const list = known(results);
  if (!list.length) {
    place.replaceChildren(element("p.small", { text: "This program has no metrics, only curves." }));
    return;
  }
  const name = ([, title, unit]) => (unit ? `${title} [${unitText(unit, units)}]` : title);
  const rows = list.map(measure => [name(measure), ...results.map(result => shownNumber(worst(result.metrics?.[measure[0]], measure[3]), 3))]);
  const wide = tableOf("Value of the worst joint; “–” means never, or not known", ["measure", ...titles], rows);
  const open = place.querySelector("details")?.open ?? false;
  const each = element("details", { open }, element("summary", { text: "Each joint" }), results.map((result, k) => tableOf(
    titles[k], ["measure", ...joints],
    list.filter(([key]) => result.metrics?.[key]?.length > 1)
      .map(measure => [name(measure), ...Array.from(result.metrics[measure[0]], value => shownNumber(value, 3))]))));
  place.replaceChildren(wide, each);
}
