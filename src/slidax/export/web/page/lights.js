/* Lights for the certificates before a run, and for the outcome of the run. In addition to its colour, each light has a
   sign and a text. */

import { firstOutside } from "./curves.js";
import { element } from "./dom.js";
import { capitalised, shownNumber } from "./numbers.js";

const SIGNS = { good: "✓", bad: "✗", grey: "–" };

function light(state, title, words, details = []) {
  return element("li.light", { "data-state": state }, element("span.sign", { "aria-hidden": "true", text: SIGNS[state] }),
    element("div", {}, element("p", {}, element("b", { text: title }), ` ${words}`), details.map(text => element("p.small", { text }))));
}

/* True if two paths are equal, or one is part of the other. */
function touches(path, read) {
  return path === read || path.startsWith(`${read}.`) || read.startsWith(`${path}.`);
}

export function certificateLights(playground, chosen) {
  const setting = playground.setting(chosen);
  const moved = [...Object.keys(chosen.values), ...Object.keys(chosen.choices)];
  const titles = path => playground.tunable(chosen, path)?.title ?? playground.choice(chosen, path)?.title ?? path;
  return (setting.certificates ?? []).map(({ certificate, title: name, holds, grade, since, statement, margin, reads }) => {
    const title = capitalised(name ?? certificate.replaceAll("_", " "));
    const stale = moved.filter(path => !reads?.length || reads.some(read => touches(path, read)));
    if (stale.length) {
      const names = [...new Set(stale.map(titles))].join(", ");
      return light("grey", title, `is unknown: ${names} changed.`, [`Before the change: ${sentence(statement)}`]);
    }
    const state = holds === true ? "good" : holds === false ? "bad" : "grey";
    const held = since ? `holds from ${shownNumber(since, 3)} s on` : "holds";
    const words = { good: `${held}${grade ? `, grade ${grade}` : ""}.`, bad: "does not hold.", grey: "does not apply." }[state];
    const room = Number.isFinite(margin ?? NaN) ? [`Margin ${shownNumber(100 * margin, 3)} %.`] : [];
    return light(state, title, words, [sentence(statement), ...room]);
  });
}

/* A certificate's statement without the quotes around names. */
function sentence(text) {
  return capitalised(text.replaceAll("`", ""));
}

export function runLights(result, joints) {
  const lights = [];
  if (!result.t.length) return [light("grey", "Inside its envelope", "is unknown: the run did not start.")];
  const first = firstOutside(result, joints);
  if (first === undefined) lights.push(light("grey", "Envelope", "none: there is no guarantee for the error."));
  else if (first) lights.push(light("bad", "Inside its envelope", `no: joint ${first.joint} was outside at ${shownNumber(first.time)} s.`));
  else if (broken(result)) lights.push(light("bad", "Inside its envelope", "until the run ended early."));
  else lights.push(light("good", "Inside its envelope", "in every sample of this run."));
  lights.push(monitorLight(result));
  return lights;
}

function monitorLight(result) {
  const warned = result.signals.assumption_violated;
  const title = "Assumptions, monitored by the law:";
  if (!warned) return light("grey", title, "this scheme has no monitor.");
  const wide = warned.length / result.t.length || 1;
  const found = warned.findIndex(value => value > 0.5);
  if (found < 0) return light("good", title, "no violation was detected.");
  const joint = wide > 1 ? `, at joint ${(found % wide) + 1}` : "";
  return light("bad", title, `a violation was detected, first at ${shownNumber(result.t[Math.floor(found / wide)])} s${joint}.`);
}

export function broken(result) {
  return !["ok", "finished", "recovered"].includes(result.outcome.kind) && !staysOutside(result);
}

/* True if a run left its envelope, but went on to its end. */
function staysOutside(result) {
  return ["left_envelope", "left"].includes(result.outcome.kind) && result.asked && result.t.at(-1) >= result.asked - 1e-9;
}

/* [state, text] of the outcome of a run. */
export function outcomeOf(result, joints) {
  const { kind, message } = result.outcome;
  if (["ok", "finished"].includes(kind)) {
    const first = firstOutside(result, joints);
    const seen = first === null ? "Every joint stayed inside its envelope. "
      : first ? `Joint ${first.joint} was outside the envelope it is judged by, first at ${shownNumber(first.time)} s. ` : "";
    return [first ? "warn" : "good", seen + (message || "The run reached its end.")];
  }
  return [kind === "recovered" ? "warn" : "bad", message || "The run ended early."];
}
