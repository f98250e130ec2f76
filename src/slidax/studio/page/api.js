/* What the studio's server is asked, with the token that only its own page has. */
"use strict";

globalThis.studioParts = {};

(() => {
  const KEY = "slidax-studio-token";
  const SLOT = Math.random().toString(36).slice(2);

  /* The token comes in the address once, and does not stay there. */
  const given = /(?:^#|&)token=([\w-]+)/.exec(location.hash);
  if (given) {
    localStorage.setItem(KEY, given[1]);
    history.replaceState(null, "", location.pathname);
  }

  class Refused extends Error {
    constructor(status, { where = "", message = "no reason was given" } = {}, exists = false) {
      super(where ? `${where}: ${message}` : message);
      this.status = status;
      this.exists = exists;
    }
  }

  async function asked(method, path, { json, body, headers = {} } = {}) {
    const all = { "x-slidax-token": localStorage.getItem(KEY) ?? "", ...headers };
    if (json !== undefined) all["content-type"] = "application/json";
    let answer;
    try {
      answer = await fetch(path, { method, headers: all, body: json === undefined ? body : JSON.stringify(json) });
    } catch {
      throw new Refused(0, { message: "the studio does not answer: was it ended?" });
    }
    if (answer.ok) return answer;
    const said = await answer.json().catch(() => ({}));
    throw new Refused(answer.status, said.error, said.exists);
  }

  async function values(method, path, options) {
    return (await asked(method, path, options)).json();
  }

  /* A run: its head is JSON, its numbers are bytes, so that thousands of rows cost no reading. */
  async function run(question, side = "") {
    const answer = await asked("POST", "/api/run", { json: question, headers: { "x-slidax-slot": side ? SLOT + side : "" } });
    const bytes = await answer.arrayBuffer();
    const length = Number(new DataView(bytes).getBigUint64(0, true));
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, length)));
    let at = 8 + length;
    const signals = {};
    for (const { name, width } of head.signals) {
      const count = head.rows * width;
      signals[name] = new Float64Array(bytes.slice(at, at + 8 * count));
      at += 8 * count;
    }
    const { t, ...others } = signals;
    return { ...head, t, signals: others };
  }

  /* An element in one expression: its classes after dots, listeners under `on`. */
  function element(tag, given = {}, ...children) {
    const [name, ...classes] = tag.split(".");
    const made = document.createElement(name);
    if (classes.length) made.className = classes.join(" ");
    for (const [key, value] of Object.entries(given)) {
      if (value === false || value === null || value === undefined) continue;
      if (key === "on") for (const [event, listener] of Object.entries(value)) made.addEventListener(event, listener);
      else if (key === "text") made.textContent = value;
      else if (key === "value") made.value = value;
      else made.setAttribute(key, value === true ? "" : value);
    }
    made.append(...children.flat().filter(child => child !== null && child !== undefined && child !== false));
    return made;
  }

  /* A button that cannot be pressed again while it works, and says what went wrong on a line. */
  function button(text, line, action, kind = "button") {
    const made = element(`button.${kind.split(" ").join(".")}`, { type: "button", text });
    made.addEventListener("click", async () => {
      made.disabled = true;
      try {
        await action();
      } catch (error) {
        line(error.message, "bad");
      } finally {
        made.disabled = false;
      }
    });
    return made;
  }

  /* A line that says what came of something, also to those who do not see it. */
  function lineOf() {
    const place = element("p.studio-line", { role: "status" });
    const say = (text, tone = "") => {
      place.textContent = text;
      place.dataset.tone = tone;
    };
    return [place, say];
  }

  Object.assign(studioParts, { asked, values, run, element, button, lineOf, Refused });
})();
