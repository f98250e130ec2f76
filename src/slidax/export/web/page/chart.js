/* A chart with one row per joint over a common time axis. One canvas has the curves, one above it the cursor. */

import { shownNumber } from "./numbers.js";
import { colourOf } from "./theme.js";

const LEFT = 46, RIGHT = 8, TOP = 6, BOTTOM = 22, GAP = 8, VALUE = 62;

export class Chart {
  /* - `place`: the element that holds both canvases.
     - `seek`: called with a time when the user points at it. */
  constructor(place, seek) {
    this.curves = place.querySelector("canvas.curves");
    this.over = place.querySelector("canvas.over");
    this.rows = [];
    this.end = 1;
    const point = event => {
      const box = this.over.getBoundingClientRect();
      const share = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      if (share > -0.05 && share < 1.05) seek(Math.min(1, Math.max(0, share)) * this.end);
    };
    this.over.addEventListener("pointerdown", event => {
      point(event);
      this.over.setPointerCapture(event.pointerId);
      this.over.onpointermove = point;
    });
    for (const name of ["pointerup", "pointercancel"]) {
      this.over.addEventListener(name, () => { this.over.onpointermove = null; });
    }
  }

  /* - `rows`: [{title, unit, axis, bands: [{low, high}], lines: [{curve, name, dash}], levels: [numbers]}], where a
         curve is {t, y, offset, stride, rows}.
     - `end`: the last time [s]. */
  show(rows, end, rowHeight) {
    this.rows = rows;
    this.end = end;
    this.rowHeight = rowHeight;
    const height = TOP + BOTTOM + rows.length * rowHeight + (rows.length - 1) * GAP;
    this.curves.parentElement.style.height = `${height}px`;
    this.draw();
  }

  fit(canvas) {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 3);
    const { clientWidth, clientHeight } = canvas;
    const [w, h] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, clientWidth, clientHeight);
    pen.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    return [pen, clientWidth, clientHeight];
  }

  draw() {
    const [pen, width] = this.fit(this.curves);
    if (width < LEFT + RIGHT + 10) return;
    this.left = LEFT;
    this.wide = width - LEFT - RIGHT;
    this.rows.forEach((row, k) => this.drawRow(pen, row, TOP + k * (this.rowHeight + GAP)));
    this.drawTimes(pen);
  }

  across(t) {
    return this.left + (t / this.end) * this.wide;
  }

  drawRow(pen, row, top) {
    const height = this.rowHeight;
    const y = value => top + (1 - row.axis.place(value)) * height;
    pen.save();
    pen.beginPath();
    pen.rect(this.left, top, this.wide, height);
    pen.clip();
    for (const band of row.bands) this.drawBand(pen, band, y);
    pen.lineWidth = 1;
    pen.strokeStyle = colourOf("--line");
    for (const tick of row.axis.ticks(height < 80 ? 2 : 4)) this.stroke(pen, [[this.left, y(tick)], [this.left + this.wide, y(tick)]]);
    for (const [k, level] of row.levels.entries()) {
      pen.strokeStyle = colourOf("--limit");
      pen.setLineDash([7, 3, 2, 3]);
      this.stroke(pen, [[this.left, y(level)], [this.left + this.wide, y(level)]]);
      pen.setLineDash([]);
      if (k === 0) row.levelAt = y(level);
    }
    [...row.lines].reverse().forEach(line => this.drawLine(pen, line, y));
    pen.restore();
    pen.strokeStyle = colourOf("--line");
    pen.strokeRect(this.left + 0.5, top + 0.5, this.wide - 1, height - 1);
    pen.fillStyle = colourOf("--soft");
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    let last = Infinity;
    for (const tick of row.axis.ticks(height < 80 ? 2 : 4)) {
      const at = y(tick);
      if (at < top - 1 || at > top + height + 1 || Math.abs(last - at) < 12) continue;
      last = at;
      pen.fillText(shownNumber(tick), this.left - 5, Math.min(top + height - 5, Math.max(top + 6, at)));
    }
  }

  stroke(pen, points) {
    pen.beginPath();
    points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  }

  /* Range of a curve in each column of the picture: [x, low, high], over its finite values. */
  columns({ t, y, offset, stride, rows }) {
    const found = [];
    const perColumn = Math.max(1, Math.floor(rows / (2 * this.wide)));
    for (let row = 0; row < rows; row += perColumn) {
      let low = Infinity, high = -Infinity;
      const stop = Math.min(rows, row + perColumn);
      for (let k = row; k < stop; k++) {
        const value = y[offset + k * stride];
        if (Number.isFinite(value)) {
          if (value < low) low = value;
          if (value > high) high = value;
        }
      }
      if (low <= high) found.push([this.across(t[row]), low, high]);
    }
    return found;
  }

  drawBand(pen, { low, high, fill, edge, dash }, y) {
    const [below, above] = [low, high].map(curve => this.columns(curve));
    if (fill) {
      pen.beginPath();
      above.forEach(([x, , value], k) => (k ? pen.lineTo(x, y(value)) : pen.moveTo(x, y(value))));
      below.toReversed().forEach(([x, value]) => pen.lineTo(x, y(value)));
      pen.fillStyle = colourOf(fill);
      pen.fill();
    }
    pen.strokeStyle = colourOf(edge);
    pen.lineWidth = 1;
    pen.setLineDash(dash);
    this.stroke(pen, above.map(([x, , value]) => [x, y(value)]));
    this.stroke(pen, below.map(([x, value]) => [x, y(value)]));
    pen.setLineDash([]);
  }

  drawLine(pen, { curve, name, dash }, y) {
    const points = [];
    for (const [x, low, high] of this.columns(curve)) {
      points.push([x, y(low)]);
      if (high !== low) points.push([x, y(high)]);
    }
    pen.strokeStyle = colourOf(name);
    pen.lineWidth = 1.5;
    pen.lineJoin = "round";
    pen.setLineDash(dash);
    this.stroke(pen, points);
    pen.setLineDash([]);
    if (curve.t[curve.rows - 1] < this.end - 1e-9 && points.length) {
      const [x, at] = points[points.length - 1];
      pen.lineWidth = 2;
      this.stroke(pen, [[x - 4, at - 4], [x + 4, at + 4]]);
      this.stroke(pen, [[x - 4, at + 4], [x + 4, at - 4]]);
    }
  }

  drawTimes(pen) {
    const bottom = TOP + this.rows.length * this.rowHeight + (this.rows.length - 1) * GAP;
    pen.fillStyle = colourOf("--soft");
    pen.textBaseline = "top";
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find(size => (size / this.end) * this.wide > 44) ?? this.end;
    for (let t = 0; t <= this.end + 1e-9; t += step) {
      const last = t + step > this.end + 1e-9;
      pen.textAlign = t === 0 ? "left" : last ? "right" : "center";
      pen.fillText(`${shownNumber(t)}${last ? " s" : ""}`, this.across(t) + (last ? RIGHT : 0), bottom + 6);
    }
  }

  /* Draws a line at the time t, and the values there. */
  drawCursor(t) {
    const [pen, width] = this.fit(this.over);
    if (!this.rows.length || width < LEFT + RIGHT + 10) return;
    const x = this.across(Math.min(t, this.end));
    pen.strokeStyle = colourOf("--ink");
    pen.globalAlpha = 0.55;
    this.stroke(pen, [[x, TOP], [x, TOP + this.rows.length * (this.rowHeight + GAP) - GAP]]);
    pen.globalAlpha = 1;
    this.rows.forEach((row, k) => this.drawValues(pen, row, TOP + k * (this.rowHeight + GAP), t, x));
  }

  drawValues(pen, row, top, t, x) {
    pen.textBaseline = "top";
    let right = this.left + this.wide - 5;
    /* The text is at the bottom of the row if the curve ends high, else at its top. */
    const ended = row.lines[0]?.curve;
    const last = ended ? row.axis.place(ended.y[ended.offset + (ended.rows - 1) * ended.stride]) : 0;
    const text = last > 0.55 ? top + this.rowHeight - 16 : top + 4;
    for (const { curve, name } of row.lines.toReversed()) {
      const value = curve.y[curve.offset + rowAt(curve.t, t) * curve.stride];
      if (Number.isFinite(value) && t <= curve.t[curve.rows - 1] + 1e-9) {
        const at = top + (1 - row.axis.place(value)) * this.rowHeight;
        if (at >= top && at <= top + this.rowHeight) {
          pen.fillStyle = colourOf(name);
          pen.beginPath();
          pen.arc(x, at, 3, 0, 2 * Math.PI);
          pen.fill();
        }
      }
      this.tag(pen, shownNumber(value, 3), right, text, name);
      right -= VALUE;
    }
    this.tag(pen, `${row.title} [${row.unit}]`, right, text, "--ink");
  }

  /* Draws a text that ends at `right`, on a background; on the right, where an envelope is narrow. */
  tag(pen, text, right, top, name) {
    const wide = pen.measureText(text).width;
    pen.textAlign = "right";
    pen.fillStyle = colourOf("--veil");
    pen.fillRect(right - wide - 2, top - 1, wide + 4, 14);
    pen.fillStyle = colourOf(name);
    pen.fillText(text, right, top);
  }
}

/* Index of the last sample at or before a time. */
export function rowAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t + 1e-12) low = middle;
    else high = middle - 1;
  }
  return low;
}
