/* The settings of a playground, and the program and inputs for a user's choice.

   A choice is {arm, scheme, choices: {path: index}, values: {path: number or one per joint}}. Its choices and values have
   only entries that differ from the default. */

import { unpackedNumbers } from "./packed.js";

export class Playground {
  constructor(manifest) {
    if (manifest?.format !== 1) throw new Error(`this page reads playgrounds of format 1, not ${manifest?.format}`);
    this.manifest = manifest;
    this.constants = new Map();
  }

  get first() {
    return this.start(this.manifest.first.arm, this.manifest.first.scheme);
  }

  start(arm, scheme) {
    return { arm, scheme, choices: {}, values: {} };
  }

  arm(id) {
    return this.manifest.arms.find(arm => arm.id === id);
  }

  settingsOf(arm) {
    return this.manifest.settings.filter(setting => setting.arm === arm);
  }

  setting(chosen) {
    return this.manifest.settings.find(setting => setting.arm === chosen.arm && setting.scheme === chosen.scheme);
  }

  tunable(chosen, path) {
    return this.setting(chosen).tunables.find(tunable => tunable.path === path);
  }

  choice(chosen, path) {
    return this.setting(chosen).choices.find(choice => choice.path === path);
  }

  /* The arm's scheme of a kind, "ours", "printed" or "rival"; undefined if there is none. */
  schemeOf(arm, kind) {
    const settings = this.settingsOf(arm);
    const named = settings.find(setting => setting.kind === kind);
    if (named || settings.some(setting => setting.kind)) return named?.scheme;
    const ours = this.manifest.first.scheme;
    if (kind === "ours") return settings.find(setting => setting.scheme === ours)?.scheme;
    if (kind === "printed") return settings.find(setting => setting.printed && setting.scheme !== ours)?.scheme;
    return settings.find(setting => !setting.printed && setting.scheme !== ours)?.scheme;
  }

  value(chosen, path) {
    return chosen.values[path] ?? this.tunable(chosen, path).default;
  }

  choiceIndex(chosen, path) {
    return chosen.choices[path] ?? this.choice(chosen, path).default;
  }

  /* The choice with another value; a value that is the default is not stored. */
  withValue(chosen, path, value) {
    // The event may come from a slider of a setting that has been replaced.
    if (!this.tunable(chosen, path)) return chosen;
    const values = { ...chosen.values };
    if (sameNumbers(value, this.tunable(chosen, path).default)) delete values[path];
    else values[path] = value;
    return { ...chosen, values };
  }

  withChoice(chosen, path, index) {
    if (!this.choice(chosen, path)) return chosen;
    const choices = { ...chosen.choices };
    if (index === this.choice(chosen, path).default) delete choices[path];
    else choices[path] = index;
    return { ...chosen, choices };
  }

  /* The choice with another scheme; values and choices outside the scheme are kept if the new setting has them. */
  withScheme(chosen, scheme) {
    let made = this.start(chosen.arm, scheme);
    for (const [path, value] of Object.entries(chosen.values)) {
      const tunable = this.tunable(made, path);
      if (tunable && !path.startsWith("scheme.") && fits(tunable, value)) made = this.withValue(made, path, value);
    }
    for (const [path, index] of Object.entries(chosen.choices)) {
      const value = this.choice(chosen, path).values[index];
      const found = this.choice(made, path)?.values.findIndex(other => other === value) ?? -1;
      if (found >= 0) made = this.withChoice(made, path, found);
    }
    return made;
  }

  variant(chosen) {
    const setting = this.setting(chosen);
    const at = setting.choices.map(choice => this.choiceIndex(chosen, choice.path));
    return setting.variants.find(one => one.at.every((index, k) => index === at[k]));
  }

  program(chosen) {
    const variant = this.variant(chosen);
    return variant && this.manifest.programs.find(program => program.id === variant.program);
  }

  async inputs(chosen) {
    const packed = this.variant(chosen)?.constants ?? this.setting(chosen).constants;
    if (!packed) return new Float64Array(0);
    if (!this.constants.has(packed)) this.constants.set(packed, unpackedNumbers(packed));
    const inputs = Float64Array.from(await this.constants.get(packed));
    for (const [path, value] of Object.entries(chosen.values)) {
      const [start, count] = this.tunable(chosen, path).inputs;
      for (let k = 0; k < count; k++) inputs[start + k] = Array.isArray(value) ? value[k] : value;
    }
    return inputs;
  }

  /* Units of the joint positions, in the order of the joints. */
  units(arm) {
    return this.jointLinks(arm).map(link => (link.type === "prismatic" ? "m" : "rad"));
  }

  /* A unit for this arm: "rad or m" becomes "rad" if all joints are revolute. */
  unitOf(arm, unit) {
    const parts = (unit ?? "").split(" or ");
    const units = this.units(arm);
    if (parts.length !== 2 || !units.every(one => one === units[0])) return unit ?? "";
    return parts[units[0] === "rad" ? 0 : 1];
  }

  jointNames(arm) {
    return this.jointLinks(arm).map((link, k) => link.name ?? `joint ${k + 1}`);
  }

  jointLinks(arm) {
    return this.arm(arm).kinematics.filter(link => link.joint !== null && !link.follows).sort((a, b) => a.joint - b.joint);
  }
}

export function listed(value, count) {
  return Array.isArray(value) ? [...value] : new Array(count).fill(value);
}

export function sameNumbers(a, b) {
  const count = Math.max(Array.isArray(a) ? a.length : 1, Array.isArray(b) ? b.length : 1);
  const [left, right] = [listed(a, count), listed(b, count)];
  return left.length === right.length && left.every((x, k) => x === right[k]);
}

/* True if a tunable accepts a value: numbers in its range, one for all joints or one per joint. */
export function fits(tunable, value) {
  const numbers = Array.isArray(value) ? value : [value];
  const known = Array.isArray(tunable.default) ? tunable.default : [tunable.default];
  if (Array.isArray(value) && value.length !== (tunable.inputs ? tunable.inputs[1] : known.length)) return false;
  return numbers.every((x, k) => Number.isFinite(x)
    && ((x >= tunable.low && x <= tunable.high) || x === known[Math.min(k, known.length - 1)]));
}
