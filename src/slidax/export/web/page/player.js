/* The player, which sets the displayed time: playing, paused, or at a time that the user chooses. */

import { wantsStillness } from "./theme.js";

export class Player {
  /* - `parts`: the elements {button, bar, clock, speed}.
     - `show`: called with the time whenever it changes. */
  constructor({ button, bar, clock, speed }, show) {
    Object.assign(this, { button, bar, clock, speed, show });
    this.t = 0;
    this.end = 1;
    this.runs = !wantsStillness();
    this.told = 0;
    button.addEventListener("click", () => this.play(!this.runs));
    bar.addEventListener("input", () => {
      const t = Number(bar.value);
      this.play(false);
      this.seek(t);
    });
    document.addEventListener("keydown", event => {
      if (event.key !== " " || event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.target.closest?.("button, input, select, summary, a, textarea")) return;
      event.preventDefault();
      this.play(!this.runs);
    });
    this.play(this.runs);
    requestAnimationFrame(now => this.tick(now));
  }

  play(runs) {
    this.runs = runs;
    if (runs && this.t >= this.end) this.t = 0;
    this.button.setAttribute("aria-label", runs ? "Pause" : "Play");
    this.button.dataset.runs = runs;
    if (!runs) this.tell();
  }

  lasts(end) {
    this.end = end;
    this.bar.max = end;
    this.bar.step = end / 1000;
    this.seek(Math.min(this.t, end));
  }

  seek(t) {
    this.t = t;
    this.tell();
    this.show(t);
  }

  tell() {
    this.bar.value = this.t;
    this.bar.setAttribute("aria-valuetext", `${this.t.toFixed(2)} seconds`);
    this.clock.textContent = `${this.t.toFixed(2)} s`;
  }

  tick(now) {
    const passed = Math.min(0.1, (now - (this.before ?? now)) / 1000);
    this.before = now;
    if (this.runs && !document.hidden) {
      this.t += passed * Number(this.speed.value);
      if (this.t > this.end + 0.6) this.t = 0;
      const shown = Math.min(this.t, this.end);
      /* Screen readers need no sixty updates per second. */
      if (now - this.told > 100) {
        this.told = now;
        this.bar.value = shown;
        this.bar.setAttribute("aria-valuetext", `${shown.toFixed(2)} seconds`);
      }
      this.clock.textContent = `${shown.toFixed(2)} s`;
      this.show(shown);
    }
    requestAnimationFrame(later => this.tick(later));
  }
}
