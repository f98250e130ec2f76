/* The page: connects the user's input with sessions, pictures and tables. */

import { byId, element } from "./dom.js";
import { Tunables } from "./tunables.js";
import { certificateLights, outcomeOf, runLights } from "./lights.js";
import { showMeasures } from "./measures.js";
import { shownNumber } from "./numbers.js";
import { Pictures } from "./pictures.js";
import { Playground } from "./playground.js";
import { projectInC, scenarioOf, scenarioText } from "./scenario.js";
import { Session } from "./session.js";
import { followTheme } from "./theme.js";

class Page {
  constructor() {
    this.pictures = new Pictures();
    this.tunables = new Tunables(byId("tunables"), {
      moved: (path, value, stands) => this.put(this.playground.withValue(this.session.a, path, value), stands),
      chosen: (path, index) => this.put(this.playground.withChoice(this.session.a, path, index), true),
    });
    followTheme(byId("theme"), () => this.pictures.redraw());
    byId("scheme").addEventListener("change", () => this.put(this.playground.withScheme(this.session.a, byId("scheme").value), true));
    byId("reset").addEventListener("click", () => this.put(this.playground.start(this.session.a.arm, this.session.a.scheme), true));
    byId("same").addEventListener("change", () => {
      this.session.same = byId("same").checked;
      this.session.put(this.session.a, this.session.b, true);
    });
    this.besides();
    this.takes();
  }

  besides() {
    const beside = (b, same) => {
      this.session.same = same;
      this.session.put(this.session.a, b, true);
    };
    const under = kind => () => beside(this.playground.withScheme(this.session.a, this.playground.schemeOf(this.session.a.arm, kind)), true);
    byId("keep").addEventListener("click", () => {
      beside(this.session.a, false);
      this.say("This run is kept as B; the sliders change A.");
    });
    byId("printed").addEventListener("click", under("printed"));
    byId("rival").addEventListener("click", under("rival"));
    byId("swap").addEventListener("click", () => this.session.put(this.session.b, this.session.a, true));
    byId("drop").addEventListener("click", () => {
      beside(null, false);
      byId("keep").focus();
    });
  }

  takes() {
    byId("copy").addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(this.session.address);
        this.taken("The link is copied.");
      } catch {
        this.session.write(true);
        this.taken("The browser does not let this page copy: the link stands in the address bar.");
      }
    });
    byId("scenario").addEventListener("click", () => {
      save(`${this.fileName}.yaml`, new Blob([this.scenarioText()], { type: "application/yaml" }));
      this.taken(`${this.fileName}.yaml: slidax run ${this.fileName}.yaml`);
    });
    byId("c").addEventListener("click", async () => {
      const made = await projectInC(this.playground, this.session.a);
      save(`${this.fileName}-c.zip`, made.archive);
      this.taken(made.left.length
        ? `This C code has the defaults of: ${made.left.join(", ")}. READ-ME.txt says how to export the law with your values.`
        : `${this.fileName}-c.zip has the law with these numbers, and the scenario.`);
    });
    for (const button of document.querySelectorAll("[data-csv]")) {
      button.addEventListener("click", () =>
        save(`${this.fileName}-${button.dataset.csv}.csv`, new Blob([this.pictures.csv(button.dataset.csv)], { type: "text/csv" })));
    }
  }

  get fileName() {
    return `${this.session.a.arm}-${this.session.a.scheme}`.replace(/[^A-Za-z0-9_.-]+/g, "-");
  }

  /* Shows a playground, from its manifest. */
  load(manifest) {
    const playground = new Playground(manifest);
    this.session?.stop();
    this.manifest = manifest;
    this.playground = playground;
    this.session = new Session(this.playground, byId("worker-program").textContent, {
      changed: () => this.changed(),
      finished: (side, result) => this.finished(side, result),
      failed: (side, reason) => this.failed(side, reason),
      faults: lines => this.fault(lines.length ? `A part of the link is invalid: ${lines.join("; ")}. The default is used instead.` : ""),
    });
    document.title = manifest.title;
    document.querySelector("h1").textContent = manifest.title;
    byId("made").textContent = `Made by ${manifest.made_by}. Nothing that you do here leaves this page.`;
    byId("arms").replaceChildren(element("legend", { text: "Arm" }), ...manifest.arms.map(arm => element("label", {},
      element("input", { type: "radio", name: "arm", value: arm.id, on: { change: () => this.select(arm.id) } }), element("span", { text: arm.title }))));
    this.session.readAddress();
  }

  put(a, stands) {
    this.session.put(a, this.session.b, stands);
  }

  select(arm, scheme) {
    const schemes = this.playground.settingsOf(arm).map(setting => setting.scheme);
    const kept = [scheme, this.session.a.scheme, this.playground.schemeOf(arm, "ours")].find(one => schemes.includes(one));
    this.session.same = false;
    this.session.put(this.playground.start(arm, kept ?? schemes[0]), null, true);
  }

  /* Updates the page for another choice; the results of its run come later. */
  changed() {
    const { a, b } = this.session;
    const setting = this.playground.setting(a);
    this.pictures.armIs(this.playground.arm(a.arm), this.playground.jointNames(a.arm), this.playground.units(a.arm));
    for (const radio of document.querySelectorAll("[name=arm]")) radio.checked = radio.value === a.arm;
    const schemes = this.playground.settingsOf(a.arm);
    if (this.offered !== schemes[0]) {
      this.offered = schemes[0];
      byId("scheme").replaceChildren(...schemes.map(one => element("option", { value: one.scheme, text: one.title })));
    }
    byId("scheme").value = a.scheme;
    byId("note").textContent = setting.note ?? "";
    byId("note").hidden = !setting.note;
    const offered = kind => {
      const scheme = this.playground.schemeOf(a.arm, kind);
      return scheme && scheme !== a.scheme;
    };
    byId("printed").hidden = !offered("printed");
    byId("rival").hidden = !offered("rival");
    byId("swap").hidden = byId("drop").hidden = byId("same-box").hidden = !b;
    byId("same").checked = this.session.same;
    byId("c").disabled = !setting.c_files;
    byId("c").title = setting.c_files ? "" : "The page does not have the C code of this setting: run slidax export c with the scenario.";
    byId("reset").disabled = !Object.keys(a.values).length && !Object.keys(a.choices).length;
    this.tunables.show(this.playground, a);
    byId("certificates").replaceChildren(...certificateLights(this.playground, a));
    if (!byId("certificates").children.length) byId("certificates").append(element("li.light", { text: "There are none for this law." }));
    const served = this.playground.program(a)?.engine === "server";
    byId("lead-where").textContent = served
      ? "Move any slider: the studio on this machine computes the whole run again."
      : "Move any slider: your browser computes the whole run again, with the exported code of the law.";
    document.body.toggleAttribute("data-runs", true);
  }

  titles() {
    const { a, b } = this.session;
    const name = (side, chosen) => {
      const moved = Object.keys(chosen.values).length + Object.keys(chosen.choices).length;
      return `${side}: ${this.playground.setting(chosen).title}${moved ? `, ${moved} moved` : ""}`;
    };
    return b ? [name("A", a), name("B", b)] : [this.playground.setting(a).title];
  }

  finished(side) {
    const results = this.shownResults();
    if (!results.length) return;
    const titles = this.titles();
    const joints = this.playground.jointNames(this.session.a.arm);
    this.pictures.key(titles);
    this.pictures.show(results);
    byId("outcomes").replaceChildren(...results.map((result, k) => outcomeItem(result, titles.length > 1 ? titles[k] : "", joints.length)));
    byId("seen").replaceChildren(...runLights(results[0], joints.length));
    showMeasures(byId("numbers"), results, titles.length > 1 ? titles : ["this run"], joints, this.playground.units(this.session.a.arm));
    if (!this.session.settled) return;
    document.body.toggleAttribute("data-runs", false);
    clearTimeout(this.told);
    this.told = setTimeout(() => this.say(results.map((result, k) => `${titles[k]}: ${outcomeOf(result, joints.length)[1]}`).join(" ")), 600);
    this.first();
    if (side === "A") globalThis.slidaxStudio?.changed?.(this);
  }

  /* Results of A, and of B if there is one already. */
  shownResults() {
    const { A, B } = this.session.results;
    const arm = this.session.a.arm;
    return [A, this.session.b ? B : null].filter((result, k) => result?.chosen.arm === arm && (k === 0 || A));
  }

  first() {
    if (this.ready) return;
    this.ready = true;
    performance.mark("first picture");
    globalThis.slidaxStudio?.ready?.(this);
  }

  failed(side, reason) {
    document.body.toggleAttribute("data-runs", false);
    this.fault(`${side} could not be run: ${reason}.`);
  }

  fault(text) {
    byId("fault").textContent = text;
    byId("fault").hidden = !text;
  }

  say(text) {
    byId("said").textContent = text;
  }

  taken(text) {
    byId("taken").textContent = text;
    this.say(text);
  }

  /* State of A, for a studio and for tests. */
  state() {
    return this.session.described("A");
  }

  set(path, value) {
    const choice = this.playground.choice(this.session.a, path);
    if (choice) this.put(this.playground.withChoice(this.session.a, path, choice.values.indexOf(value)), true);
    else this.put(this.playground.withValue(this.session.a, path, value), true);
  }

  scenario() {
    return scenarioOf(this.playground, this.session.a);
  }

  scenarioText() {
    return scenarioText(this.playground, this.session.a);
  }

  result(side) {
    return this.session.results[side];
  }
}

function outcomeItem(result, title, joints) {
  const [state, words] = outcomeOf(result, joints);
  const sign = { good: "✓", warn: "!", bad: "✗" }[state];
  return element("li", { "data-state": state }, element("span.sign", { "aria-hidden": "true", text: sign }),
    element("span", {}, title ? element("b", { text: `${title}. ` }) : null, words,
      element("span.small", { text: ` ${shownNumber(result.t.at(-1) ?? 0, 3)} s of motion, computed in ${shownNumber(result.milliseconds, 2)} ms.` })));
}

function save(name, blob) {
  const link = element("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const page = new Page();
globalThis.slidaxPage = page;
try {
  page.load(JSON.parse(byId("playground").textContent));
} catch (error) {
  page.fault(`This playground cannot be shown: ${error.message}.`);
}
