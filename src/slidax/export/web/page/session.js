/* The choices A and B, their runs, and their URL. */

import { fromAddress, toAddress } from "./address.js";
import { Runner } from "./runner.js";
import { scenarioOf } from "./scenario.js";

const OF_LAW = "scheme";

export class Session {
  /* - `playground`: the settings to choose from.
     - `workerText`: source text of the workers.
     - `listeners`: {changed(), finished(side, result), failed(side, reason), faults(lines)}. */
  constructor(playground, workerText, listeners) {
    this.playground = playground;
    this.listeners = listeners;
    this.runners = { A: new Runner(workerText), B: new Runner(workerText) };
    this.results = { A: null, B: null };
    this.asked = { A: 0, B: 0 };
    this.same = false;
    this.timing = { input: 0, drawn: 0 };
    this.follow = () => this.readAddress();
    globalThis.addEventListener("popstate", this.follow);
    globalThis.addEventListener("hashchange", this.follow);
  }

  stop() {
    globalThis.removeEventListener("popstate", this.follow);
    globalThis.removeEventListener("hashchange", this.follow);
    Object.values(this.runners).forEach(runner => runner.stop());
  }

  readAddress() {
    if (location.hash === this.written && this.a) return;
    const { a, b, faults } = fromAddress(this.playground, location.hash);
    this.written = location.hash;
    this.same = Boolean(b) && b.scheme !== a.scheme && sameWorld(a, b);
    this.listeners.faults(faults);
    this.put(a, b, null);
  }

  /* Sets the choices, and starts the runs of those that changed.
     - `stands`: true to add a step to the browser's history; false and null leave the URL unchanged. */
  put(a, b, stands) {
    const began = performance.now();
    const [oldA, oldB] = [this.a, this.b];
    this.a = a;
    this.b = b && this.same ? this.inWorldOf(a, b) : b;
    if (!this.b) this.results.B = null;
    this.timing.input = began;
    this.listeners.changed();
    if (stands !== null) this.write(stands);
    if (!equal(oldA, this.a)) this.start("A");
    if (this.b && !equal(oldB, this.b)) this.start("B");
    else if (!this.b && oldB) this.listeners.finished("B", null);
  }

  /* B with all values of A that are not part of the law. */
  inWorldOf(a, b) {
    let made = this.playground.withScheme(a, b.scheme);
    for (const [path, value] of Object.entries(b.values)) {
      if (path.startsWith(`${OF_LAW}.`)) made = this.playground.withValue(made, path, value);
    }
    return made;
  }

  write(stands) {
    const hash = toAddress(this.playground, this.a, this.b);
    if (!stands || hash === this.written) return;
    this.written = hash;
    try {
      history.pushState(null, "", hash);
    } catch {
      location.hash = hash;
    }
  }

  get address() {
    return location.href.split("#")[0] + toAddress(this.playground, this.a, this.b);
  }

  described(side) {
    const chosen = side === "A" ? this.a : this.b;
    const setting = this.playground.setting(chosen);
    const choices = Object.fromEntries(setting.choices.map(choice =>
      [choice.path, choice.values[this.playground.choiceIndex(chosen, choice.path)]]));
    return { arm: chosen.arm, scheme: chosen.scheme, choices, values: { ...chosen.values } };
  }

  async start(side) {
    const chosen = side === "A" ? this.a : this.b;
    const ticket = ++this.asked[side];
    const began = this.timing.input;
    try {
      const program = this.playground.program(chosen);
      if (!program) throw new Error("this page has no program for that choice");
      const result = program.engine === "server"
        ? await globalThis.slidaxStudio.run({ side, ...this.described(side), scenario: scenarioOf(this.playground, chosen) })
        : await this.runners[side].run(program, await this.playground.inputs(chosen));
      if (!result || (side === "B" && !this.b) || this.of(side)?.arm !== chosen.arm) return;
      if (ticket < (this.shown?.[side] ?? 0)) return;
      this.shown = { ...this.shown, [side]: ticket };
      this.results[side] = { ...result, chosen, asked: this.lasting(chosen) };
      this.listeners.finished(side, this.results[side]);
      if (side === "A" && ticket === this.asked.A) this.timing = { ...this.timing, ran: result.milliseconds, drawn: performance.now() - began };
    } catch (error) {
      if (ticket === this.asked[side]) this.listeners.failed(side, error.message);
    }
  }

  of(side) {
    return side === "A" ? this.a : this.b;
  }

  lasting(chosen) {
    return scenarioOf(this.playground, chosen)?.simulation?.t1 ?? null;
  }

  /* True if the displayed results belong to the current choices. */
  get settled() {
    const done = side => !this.of(side) || (this.results[side] && equal(this.results[side].chosen, this.of(side)));
    return Boolean(this.a) && done("A") && done("B");
  }
}

function equal(a, b) {
  return Boolean(a) && Boolean(b) && JSON.stringify(sorted(a)) === JSON.stringify(sorted(b));
}

function sorted({ arm, scheme, choices, values }) {
  return [arm, scheme, Object.entries(choices).sort(), Object.entries(values).sort()];
}

function sameWorld(a, b) {
  const world = chosen => JSON.stringify([Object.entries(chosen.choices).sort(),
    Object.entries(chosen.values).filter(([path]) => !path.startsWith(`${OF_LAW}.`)).sort()]);
  return world(a) === world(b);
}
