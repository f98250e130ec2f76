/* The page's state in the URL fragment, short and readable:

     #v=1&arm=panda&scheme=cftsmppc&scheme.surface.k1=0.7&simulation.period=0.002&b:scheme=pd

   All other values have their defaults. The prefix "b:" marks the values of run B, with which run A is compared. */

import { exactNumber } from "./numbers.js";
import { fits } from "./playground.js";

const ADDRESS_VERSION = "1";

export function toAddress(playground, a, b) {
  const parts = [["v", ADDRESS_VERSION], ...partsOf(playground, a, "")];
  if (b) parts.push(...partsOf(playground, b, "b:"));
  return "#" + parts.map(([key, value]) => `${encoded(key)}=${encoded(value)}`).join("&");
}

function partsOf(playground, chosen, prefix) {
  const numbers = value => (Array.isArray(value) ? value : [value]).map(exactNumber).join(",");
  const choice = ([path, index]) => [prefix + path, String(playground.choice(chosen, path).values[index])];
  return [
    [`${prefix}arm`, chosen.arm],
    [`${prefix}scheme`, chosen.scheme],
    ...Object.entries(chosen.choices).map(choice),
    ...Object.entries(chosen.values).map(([path, value]) => [prefix + path, numbers(value)]),
  ].filter(([key]) => key !== "b:arm");
}

function encoded(text) {
  return encodeURIComponent(text).replace(/%(2C|3A|2F)/g, found => decodeURIComponent(found));
}

/* Reads a URL fragment: {a, b, faults}. Each invalid part gives a line in `faults`; its default is used instead. */
export function fromAddress(playground, hash) {
  const faults = [];
  const text = hash.replace(/^#/, "");
  if (!text) return { a: playground.first, b: null, faults };
  const given = new Map(text.split("&").map(part => {
    const [key, ...rest] = part.split("=");
    return [decoded(key, faults), decoded(rest.join("="), faults)];
  }));
  if (given.get("v") !== ADDRESS_VERSION) {
    const version = given.get("v");
    faults.push(version ? `it is of version ${version}, and this page reads ${ADDRESS_VERSION}` : "it has no version");
    return { a: playground.first, b: null, faults };
  }
  given.delete("v");
  const split = prefix => new Map([...given].filter(([key]) => key.startsWith("b:") === (prefix === "b:"))
    .map(([key, value]) => [key.slice(prefix.length), value]));
  const a = chosenFrom(playground, split(""), playground.first, faults);
  const others = split("b:");
  if (!others.size) return { a, b: null, faults };
  return { a, b: chosenFrom(playground, others.set("arm", a.arm), a, faults), faults };
}

function chosenFrom(playground, given, otherwise, faults) {
  const arm = given.get("arm") ?? otherwise.arm;
  if (!playground.arm(arm)) {
    faults.push(`there is no arm "${clipped(arm)}"`);
    return playground.first;
  }
  const schemes = playground.settingsOf(arm).map(setting => setting.scheme);
  let scheme = given.get("scheme") ?? (schemes.includes(otherwise.scheme) ? otherwise.scheme : schemes[0]);
  if (!schemes.includes(scheme)) {
    faults.push(`there is no scheme "${clipped(scheme)}" for ${playground.arm(arm).title}`);
    scheme = schemes.includes(playground.first.scheme) ? playground.first.scheme : schemes[0];
  }
  let made = playground.start(arm, scheme);
  for (const [path, text] of given) {
    if (path === "arm" || path === "scheme") continue;
    const choice = playground.choice(made, path);
    if (choice) {
      const index = choice.values.findIndex(value => String(value) === text);
      if (index >= 0) made = playground.withChoice(made, path, index);
      else faults.push(`${path} has no value "${clipped(text)}"`);
      continue;
    }
    const tunable = playground.tunable(made, path);
    const numbers = text.trim() === "" ? [NaN] : text.split(",").map(Number);
    const value = numbers.length === 1 ? numbers[0] : numbers;
    if (!tunable) faults.push(`this scheme has no "${clipped(path)}"`);
    else if (!fits(tunable, value)) faults.push(`${path} cannot be "${clipped(text)}": its range is ${tunable.low} to ${tunable.high}`);
    else made = playground.withValue(made, path, value);
  }
  return made;
}

function decoded(text, faults) {
  try {
    return decodeURIComponent(text);
  } catch {
    faults.push(`"${clipped(text)}" is not valid text`);
    return "";
  }
}

function clipped(text) {
  return text.length > 40 ? text.slice(0, 39) + "…" : text;
}
