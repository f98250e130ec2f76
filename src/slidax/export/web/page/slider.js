/* A number with a slider and an input field. */

import { element } from "./dom.js";
import { rounded, shownNumber, withUnit } from "./numbers.js";

const STEPS = 1000;
let sliderCount = 0;

/* Functions from a value to its place between low and high, 0 to 1, and back; logarithmic if the scale is "log" and the
   range has no 0. */
export function scaleOf({ low, high, scale }) {
  const logarithmic = scale === "log" && low > 0;
  const [bent, straight] = logarithmic ? [Math.log, Math.exp] : [x => x, x => x];
  const [a, b] = [bent(low), bent(high)];
  return {
    share: value => Math.min(1, Math.max(0, (bent(Math.max(value, logarithmic ? low * 1e-9 : -Infinity)) - a) / (b - a || 1))),
    value: share => (share <= 0 ? low : share >= 1 ? high : rounded(straight(a + share * (b - a)))),
  };
}

/* - `tunable`: entry of the manifest, with low, high, scale and unit.
   - `label`, `described`: accessible name, and id of the element that describes the number.
   - `input`, `commit`: called with a number while the slider moves, and when it is released.
   Returns {row, put}: an element with both fields, and a function that displays another value. */
export function numberSlider(tunable, { label, described, input, commit }) {
  const scale = scaleOf(tunable);
  const name = `number-${++sliderCount}`;
  const bar = element("input.bar", {
    type: "range", min: 0, max: STEPS, step: 1, "aria-label": label, "aria-describedby": described,
    on: {
      input: () => told(scale.value(bar.value / STEPS), input),
      change: () => told(scale.value(bar.value / STEPS), commit),
    },
  });
  const box = element("input.box", {
    type: "number", step: "any", inputmode: "decimal", id: name, "aria-label": `${label}, value`,
    "aria-describedby": described,
    on: { change: typed, keydown: event => event.key === "Enter" && typed() },
  });

  function told(value, listener) {
    put(value);
    listener(value);
  }

  function typed() {
    const value = box.valueAsNumber;
    if (!Number.isFinite(value) || value < tunable.low || value > tunable.high) {
      box.setAttribute("aria-invalid", "true");
      box.setCustomValidity(`A number from ${shownNumber(tunable.low)} to ${withUnit(tunable.high, tunable.unit)}.`);
      box.reportValidity();
      return;
    }
    told(value, input);
    commit(value);
  }

  function put(value) {
    box.removeAttribute("aria-invalid");
    box.setCustomValidity("");
    bar.value = Math.round(scale.share(value) * STEPS);
    bar.style.setProperty("--share", scale.share(value));
    bar.setAttribute("aria-valuetext", withUnit(value, tunable.unit));
    if (box.valueAsNumber !== value) box.value = value;
    box.classList.toggle("long", box.value.length > 8);
  }

  return { row: element("div.slider", {}, bar, box), put };
}
