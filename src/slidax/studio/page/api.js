/* Requests to the studio's server, with the token that only its own page has. */
"use strict";

globalThis.studioParts = {};

(() => {
  const KEY = "slidax-studio-token";
  const SLOT = Math.random().toString(36).slice(2);

  /* Keep the token, and remove it from the address. */
  const given = /(?:^#|&)token=([\w-]+)/.exec(location.hash);
  if (given) {
    localStorage.setItem(KEY, given[1]);
    history.replaceState(null, "", location.pathname);
  }

  class Refused extends Error {
    constructor(status, { where = "", message = "the server gave no reason" } = {}, exists = false) {
      super(where ? `${where}: ${message}` : message);
      this.status = status;
      this.exists = exists;
    }
  }

  async function request(method, path, { json, body, headers = {} } = {}) {
    const all = { "x-slidax-token": localStorage.getItem(KEY) ?? "", ...headers };
    if (json !== undefined) all["content-type"] = "application/json";
    let answer;
    try {
      answer = await fetch(path, { method, headers: all, body: json === undefined ? body : JSON.stringify(json) });
    } catch {
      throw new Refused(0, { message: "the studio does not answer: is it still running?" });
    }
    if (answer.ok) return answer;
    const body_ = await answer.json().catch(() => ({}));
    throw new Refused(answer.status, body_.error, body_.exists);
  }

  async function values(method, path, options) {
    return (await request(method, path, options)).json();
  }

  /* A run: a JSON head, then the signals as bytes, which need no parsing. */
  async function run(question, side = "") {
    const answer = await request("POST", "/api/run", { json: question, headers: { "x-slidax-slot": side ? SLOT + side : "" } });
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
  function element(tag, attributes = {}, ...children) {
    const [name, ...classes] = tag.split(".");
    const node = document.createElement(name);
    if (classes.length) node.className = classes.join(" ");
    for (const [key, value] of Object.entries(attributes)) {
      if (value === false || value === null || value === undefined) continue;
      if (key === "on") for (const [event, listener] of Object.entries(value)) node.addEventListener(event, listener);
      else if (key === "text") node.textContent = value;
      else if (key === "value") node.value = value;
      else node.setAttribute(key, value === true ? "" : value);
    }
    node.append(...children.flat().filter(child => child !== null && child !== undefined && child !== false));
    return node;
  }

  /* A button that is disabled while it works, and shows errors on a line. */
  function button(text, line, action, kind = "button") {
    const node = element(`button.${kind.split(" ").join(".")}`, { type: "button", text });
    node.addEventListener("click", async () => {
      node.disabled = true;
      try {
        await action();
      } catch (error) {
        line(error.message, "bad");
      } finally {
        node.disabled = false;
      }
    });
    return node;
  }

  /* A status line, which screen readers announce. */
  function lineOf() {
    const place = element("p.studio-line", { role: "status" });
    const say = (text, tone = "") => {
      place.textContent = text;
      place.dataset.tone = tone;
    };
    return [place, say];
  }

  Object.assign(studioParts, { request, values, run, element, button, lineOf, Refused });
})();
