/* The sliders of a setting in groups, and the select fields for quantities that need another program. */

import { element } from "./dom.js";
import { capitalised, shownNumber, withUnit } from "./numbers.js";
import { listed, sameNumbers } from "./playground.js";
import { numberSlider } from "./slider.js";

/* Groups that are open at the start, in addition to the first one: new users understand them. */
const OPENED = ["World", "True arm", "Disturbance"];

let tunableCount = 0;

export class Tunables {
  /* - `place`: the element that holds the fields.
     - `listeners`: {moved(path, value, stands), chosen(path, index)}. */
  constructor(place, listeners) {
    this.place = place;
    this.listeners = listeners;
    /* The explanation has a fixed place: between the sliders, it would move them while the user touches them. */
    const explain = event => {
      const meaning = event.target.closest(".tunable")?.querySelector(".meaning");
      if (meaning) this.told.textContent = `${meaning.parentElement.getAttribute("aria-label")}: ${meaning.textContent}`;
    };
    this.told = element("p.told", { "aria-hidden": "true", text: "Touch a slider to read its meaning." });
    place.after(this.told);
    place.addEventListener("focusin", explain);
    place.addEventListener("pointerover", explain);
  }

  /* Displays a choice; the fields are created again only for another setting. */
  show(playground, chosen) {
    const setting = playground.setting(chosen);
    if (this.setting !== setting) {
      this.setting = setting;
      this.shown = [];
      const groups = new Map();
      for (const tunable of setting.tunables) groups.set(tunable.group, [...(groups.get(tunable.group) ?? []), tunable]);
      const joints = playground.jointNames(chosen.arm);
      const plain = tunable => ({ ...tunable, unit: playground.unitOf(chosen.arm, tunable.unit), title: capitalised(tunable.title) });
      this.place.replaceChildren(
        ...(setting.choices.length ? [element("div.choices", {}, setting.choices.map(choice => this.select(choice)))] : []),
        ...[...groups].map(([title, tunables], k) => element("details.group", { open: k === 0 || OPENED.includes(title) },
          element("summary", { text: title }), tunables.map(tunable => this.tunable(plain(tunable), joints)))));
    }
    for (const put of this.shown) put(playground, chosen);
  }

  select(choice) {
    const id = `choice-${++tunableCount}`;
    const exact = value => value === 0 && choice.path === "sensor.resolution";
    const text = value => exact(value) ? "exact" : typeof value === "number" ? withUnit(value, choice.unit) : String(value);
    const option = (value, k) => element("option", { value: k, text: text(value) });
    const made = element("select", { id, on: { change: () => this.listeners.chosen(choice.path, Number(made.value)) } }, choice.values.map(option));
    this.shown.push((playground, chosen) => { made.value = playground.choiceIndex(chosen, choice.path); });
    return element("div.choice", {}, element("label", { for: id, text: capitalised(choice.title) }), made);
  }

  tunable(tunable, joints) {
    const meaning = `meaning-${++tunableCount}`;
    const several = tunable.inputs[1] > 1 && (tunable.each || Array.isArray(tunable.default));
    const names = tunable.each ? joints : Array.from({ length: tunable.inputs[1] }, (_, k) => String(k + 1));
    let value = tunable.default;
    const moved = (next, stands) => {
      value = next;
      this.listeners.moved(tunable.path, next, stands);
    };
    /* One slider for all joints keeps the ratios of their values. */
    const together = number => {
      if (!Array.isArray(value)) return number;
      const [first] = value;
      const scaled = value.map(one => (first ? (one * number) / first : number));
      return scaled.map(one => Math.min(tunable.high, Math.max(tunable.low, Number(one.toPrecision(12)))));
    };
    const all = numberSlider(tunable, {
      label: tunable.title, described: meaning,
      input: number => moved(together(number), false), commit: number => moved(together(number), true),
    });
    const reset = element("button.reset", {
      type: "button", "aria-label": `Reset ${tunable.title}`, title: `Back to ${defaultText(tunable)}`, text: "↺",
      on: { click: () => moved(tunable.default, true) },
    });
    const each = several ? this.perJoint(tunable, names, meaning, () => value, moved) : null;
    const allowed = tunable.range ? `Allowed: ${tunable.range}. ` : "";
    const range = `${allowed}The slider goes from ${shownNumber(tunable.low)} to ${withUnit(tunable.high, tunable.unit)}; ${defaultText(tunable)} by default.`;
    const text = `${tunable.meaning ? `${tunable.meaning} ` : ""}`.replace(/([^.!?\s])\s*$/, "$1. ") + range;
    const made = element("div.tunable", { "data-path": tunable.path, role: "group", "aria-label": tunable.title },
      element("div.name", { title: text }, element("span", { text: tunable.title }),
        tunable.unit ? element("span.unit", { text: tunable.unit }) : null, reset),
      tunable.each || !several ? all.row : null, element("p.meaning.unseen", { id: meaning, text }), each?.made);
    this.shown.push((playground, chosen) => {
      value = playground.value(chosen, tunable.path);
      all.put(Array.isArray(value) ? value[0] : value);
      each?.put(value);
      const same = sameNumbers(value, tunable.default);
      reset.disabled = same;
      made.classList.toggle("moved", !same);
    });
    return made;
  }

  perJoint(tunable, joints, meaning, value, moved) {
    const count = tunable.inputs[1];
    const at = (k, number) => listed(value(), count).map((one, other) => (other === k ? number : one));
    const sliders = Array.from({ length: count }, (_, k) => numberSlider(tunable, {
      label: `${tunable.title}, ${joints[k] ?? k + 1}`, described: meaning,
      input: number => moved(at(k, number), false), commit: number => moved(at(k, number), true),
    }));
    const rows = sliders.map(({ row }, k) => element("div.joint", {}, element("span", { text: joints[k] ?? String(k + 1) }), row));
    return {
      made: element("details.each", { open: !tunable.each }, element("summary", { text: tunable.each ? "each joint" : "each number" }), rows),
      put: now => listed(now, count).forEach((number, k) => sliders[k].put(number)),
    };
  }
}

function defaultText(tunable) {
  const values = Array.isArray(tunable.default) ? tunable.default : [tunable.default];
  const different = values.some(value => value !== values[0]);
  return different ? values.map(value => shownNumber(value)).join(", ") : shownNumber(values[0]);
}
