/* The pictures of a run: the arm, the charts, their tables, and the distance from the envelope. */

import { Chart, rowAt } from "./chart.js";
import { errorRows, nearness, torqueRows } from "./curves.js";
import { byId, element, tableOf } from "./dom.js";
import { shownNumber } from "./numbers.js";
import { Player } from "./player.js";
import { columnsText, thinnedRows } from "./scenario.js";
import { Scene } from "./scene.js";
import { colourOf } from "./theme.js";

export class Pictures {
  constructor() {
    this.scene = new Scene(byId("solid"), byId("flat"));
    this.player = new Player(
      { button: byId("play"), bar: byId("time"), clock: byId("clock"), speed: byId("speed") }, t => this.at(t));
    const seek = t => {
      this.player.play(false);
      this.player.seek(t);
    };
    this.charts = { errors: new Chart(byId("errors").querySelector(".chart"), seek),
      torques: new Chart(byId("torques").querySelector(".chart"), seek) };
    this.rows = { errors: [], torques: [] };
    this.axis = byId("axis");
    this.axis.addEventListener("change", () => this.drawCharts());
    for (const name of Object.keys(this.charts)) {
      byId(name).querySelector("details.data").addEventListener("toggle", () => this.fillTable(name));
    }
    this.followCamera(byId("solid"));
    new ResizeObserver(() => this.redraw()).observe(document.querySelector(".view"));
  }

  followCamera(canvas) {
    const pointers = new Map();
    canvas.addEventListener("pointerdown", event => {
      pointers.set(event.pointerId, event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", event => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      pointers.set(event.pointerId, event);
      if (pointers.size === 1) this.scene.turn((event.clientX - before.clientX) / 140, (event.clientY - before.clientY) / 140);
      else {
        const [other] = [...pointers.values()].filter(one => one.pointerId !== event.pointerId);
        const far = one => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1;
        this.scene.zoom(far(before) / far(event));
      }
      this.at(this.player.t);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      this.scene.zoom(Math.exp(event.deltaY / 500));
      this.at(this.player.t);
    }, { passive: false });
    const keys = {
      ArrowLeft: () => this.scene.turn(-0.12, 0), ArrowRight: () => this.scene.turn(0.12, 0),
      ArrowUp: () => this.scene.turn(0, 0.1), ArrowDown: () => this.scene.turn(0, -0.1),
      "+": () => this.scene.zoom(0.9), "=": () => this.scene.zoom(0.9), "-": () => this.scene.zoom(1.1), 0: () => this.scene.reset(),
    };
    canvas.addEventListener("keydown", event => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
      this.at(this.player.t);
    });
  }

  /* - `arm`: entry of the manifest.
     - `names`, `units`: names and units of its joints. */
  armIs(arm, names, units) {
    if (this.arm === arm) return;
    Object.assign(this, { arm, names, units });
    this.results = [];
    this.scene.show(arm);
    this.player.t = 0;
  }

  /* - `results`: results of A, and of B if there is one. */
  show(results) {
    this.results = results;
    this.scene.runsAre(results.map(result => ({
      q: result.signals.q, rows: result.t.length,
      wanted: result.signals.e && result === results[0] ? result.signals.q.map((x, k) => x - result.signals.e[k]) : null,
    })));
    this.player.lasts(Math.max(...results.map(result => result.t.at(-1) ?? 0), 1e-9));
    this.drawCharts();
    this.at(Math.min(this.player.t, this.player.end));
  }

  drawCharts() {
    const results = this.results ?? [];
    if (!results.length) return;
    const few = this.names.length <= 3;
    const height = few ? 134 - 12 * this.names.length : 58;
    this.rows.errors = errorRows(results, this.names, this.units, this.axis.value);
    this.rows.torques = torqueRows(results, this.names, this.units, this.arm.limits?.torque);
    for (const [name, chart] of Object.entries(this.charts)) {
      chart.show(this.rows[name], this.player.end, height);
      chart.drawCursor(this.player.t);
      this.fillTable(name);
      this.describe(name);
    }
    this.drawNearness();
  }

  describe(name) {
    const canvas = byId(name).querySelector("canvas.curves");
    const what = name === "errors" ? "Error" : "Torque";
    const parts = this.rows[name].map(row => {
      const curve = row.lines[0]?.curve;
      if (!curve) return `${row.title}: not known`;
      const last = curve.y[curve.offset + (curve.rows - 1) * curve.stride];
      return `${row.title} ends at ${shownNumber(last, 3)} ${row.unit}`;
    });
    canvas.setAttribute("aria-label", `${what} of ${this.names.length} joints over ${shownNumber(this.player.end)} seconds; the table below has the numbers. ${parts.join("; ")}.`);
  }

  fillTable(name) {
    const details = byId(name).querySelector("details.data");
    if (!details.open || !this.rows[name].length) return;
    const [head, body] = thinnedRows(this.rows[name]);
    const caption = `${name === "errors" ? "Errors" : "Torques"}, thinned to ${body.length} times; the CSV has every sample`;
    details.lastElementChild.replaceChildren(tableOf(caption, head, body));
  }

  csv(name) {
    return columnsText(this.rows[name]);
  }

  drawNearness() {
    const canvas = byId("near");
    const ratio = globalThis.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = canvas;
    [canvas.width, canvas.height] = [clientWidth * ratio, clientHeight * ratio].map(Math.round);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const found = this.results.map(result => nearness(result, this.names.length));
    canvas.hidden = !found[0];
    const top = 3, floor = clientHeight - 2;
    const y = share => floor - Math.min(1.15, share) * (floor - top) / 1.15;
    pen.strokeStyle = colourOf("--edge");
    pen.beginPath();
    pen.moveTo(0, y(1));
    pen.lineTo(clientWidth, y(1));
    pen.stroke();
    [...found.keys()].reverse().forEach(k => {
      if (!found[k]) return;
      pen.beginPath();
      const every = Math.max(1, Math.floor(found[k].length / clientWidth / 2));
      for (let row = 0; row < found[k].length; row += every) {
        let high = 0;
        for (let one = row; one < Math.min(row + every, found[k].length); one++) high = Math.max(high, found[k][one]);
        pen.lineTo((this.results[k].t[row] / this.player.end) * clientWidth, y(high));
      }
      pen.strokeStyle = colourOf(k ? "--b" : "--a");
      pen.setLineDash(k ? [4, 2] : []);
      pen.lineWidth = 1.3;
      pen.stroke();
    });
    const most = found[0] ? found[0].reduce((a, b) => Math.max(a, b), 0) : NaN;
    canvas.setAttribute("aria-label", `Error relative to the bound of its envelope, for the joint nearest to its bound: at most ${shownNumber(most, 2)}.`);
    canvas.title = "Error relative to the bound of its envelope over time, for the joint nearest to its bound; the line is the bound.";
  }

  at(t) {
    if (!this.results?.length) return;
    this.scene.draw(this.results.map(result => rowAt(result.t, t)));
    for (const chart of Object.values(this.charts)) chart.drawCursor(t);
  }

  redraw() {
    this.drawCharts();
    if (this.player) this.at(Math.min(this.player.t, this.player.end));
  }

  key(titles) {
    const entries = [["--a", "", titles[0]], ...(titles[1] ? [["--b", "dashed", titles[1]]] : []), ["--soft", "dotted", "reference path of the tip"]];
    byId("scene-key").replaceChildren(...entries.map(([colour, dash, text]) => element("span", {},
      element("i", { class: dash, style: `color: var(${colour})` }), text)));
  }
}
