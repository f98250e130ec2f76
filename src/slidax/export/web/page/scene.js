/* The arm in three dimensions: A is solid, B translucent; with the path of the tip and its reference path. */

import { Kinematics, tipPath } from "./kinematics.js";
import { looking, minus, moved, perspective, placed, point, times } from "./matrix.js";
import { Painter } from "./paint.js";
import { colourOf, colourParts } from "./theme.js";
import { ballRadius, solidOf } from "./solids.js";

const START = { turn: -0.9, rise: 0.38, far: 1 };
const ANGLE = 0.6;

export class Scene {
  /* - `solid`, `flat`: two canvases, one above the other: the lower for WebGL, the upper for lines. */
  constructor(solid, flat) {
    this.solid = solid;
    this.flat = flat;
    this.camera = { ...START };
    this.meshes = [];
    try {
      this.painter = new Painter(solid);
    } catch {
      this.painter = null;
    }
    solid.addEventListener("webglcontextlost", event => event.preventDefault());
    solid.addEventListener("webglcontextrestored", () => {
      this.painter = new Painter(solid);
      this.meshes = [];
      if (this.arm) this.show(this.arm);
    });
  }

  show(arm) {
    this.arm = arm;
    this.kinematics = new Kinematics(arm);
    this.meshes.forEach(({ mesh }) => mesh && this.painter?.forget(mesh));
    this.meshes = arm.shapes.map(shape => ({ shape, at: placed(shape.at), mesh: this.painter?.upload(solidOf(shape)) }));
    this.runs = [];
  }

  /* - `runs`: [{q, wanted, rows}], first A, then B if there is one: joint positions, those of the reference (may be null),
       and the number of samples. */
  runsAre(runs) {
    this.runs = runs.map(run => ({
      ...run,
      path: tipPath(this.kinematics, run.q, run.rows),
      should: run.wanted ? tipPath(this.kinematics, run.wanted, run.rows) : [],
    }));
    this.findRoom();
  }

  /* Determines the space that the arm needs in all poses of the runs, and the height of the ground. */
  findRoom() {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    const n = this.kinematics.joints;
    for (const { q, rows } of this.runs) {
      const every = Math.max(1, Math.floor(rows / 40));
      for (let row = 0; row < rows; row += every) {
        if (!Number.isFinite(q[row * n])) break;
        const poses = this.kinematics.poses(q, row * n);
        for (const { shape, at } of this.meshes) {
          const centre = point(times(this.kinematics.frame(poses, shape.link), at), [0, 0, 0]);
          const r = shape.link < 0 ? 0 : 0.8 * ballRadius(shape);
          centre.forEach((x, k) => {
            low[k] = Math.min(low[k], x - r);
            high[k] = Math.max(high[k], x + r);
          });
        }
      }
    }
    if (!Number.isFinite(low[0])) return;
    const tall = high[2] - low[2];
    this.ground = low[2] < -0.06 * tall ? low[2] - 0.02 * tall : Math.min(low[2], 0);
    low[2] = this.ground;
    this.centre = low.map((x, k) => (x + high[k]) / 2);
    this.size = Math.hypot(...minus(high, low)) / 2;
  }

  turn(dx, dy) {
    this.camera.turn -= dx;
    this.camera.rise = Math.min(1.5, Math.max(-0.25, this.camera.rise + dy));
  }

  zoom(factor) {
    this.camera.far = Math.min(3, Math.max(0.35, this.camera.far * factor));
  }

  reset() {
    this.camera = { ...START };
  }

  fit() {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
    const { clientWidth, clientHeight } = this.flat;
    for (const canvas of [this.solid, this.flat]) {
      const [w, h] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
      if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    }
    return ratio;
  }

  /* - `rows`: index of the displayed sample of each run. */
  draw(rows) {
    if (!this.runs?.length || !this.centre || !this.flat.clientWidth) return;
    const ratio = this.fit();
    const aspect = this.flat.width / this.flat.height;
    const { turn, rise, far } = this.camera;
    const distance = (far * this.size * 0.97) / Math.sin(ANGLE / 2) / Math.min(1, aspect * 0.98);
    const [c, s] = [Math.cos(rise), Math.sin(rise)];
    const eye = this.centre.map((x, k) => x + distance * [c * Math.cos(turn), c * Math.sin(turn), s][k]);
    const view = looking(eye, this.centre);
    const projection = perspective(ANGLE, aspect, distance / 30, distance * 4);
    const poses = this.runs.map((run, k) => this.kinematics.poses(run.q, rows[k] * this.kinematics.joints));
    if (this.painter) this.drawSolids(view, projection, poses);
    this.drawLines(times(projection, view), poses, ratio);
  }

  drawSolids(view, projection, poses) {
    const painter = this.painter;
    const tones = ["--link", "--joint", "--a"].map(colourParts);
    const ghost = colourParts("--b");
    const parts = (k, colours) => this.meshes.map(({ shape, at, mesh }) => ({
      mesh, colour: colours[shape.tone] ?? colours[0],
      model: times(this.kinematics.frame(poses[k], shape.link), at),
    }));
    const ours = parts(0, tones);
    painter.begin(view, projection);
    painter.drawGround(this.ground, 2.2 * this.size, roundCell(this.size), colourParts("--grid"));
    const flat = [1, 0, 0, 0, 0, 1, 0, 0, -0.35, -0.2, 0, 0, 0.35 * this.ground, 0.2 * this.ground, this.ground + 1e-4, 1];
    painter.drawShadow(ours, flat, times, colourParts("--shadow"));
    painter.drawSolids([...this.stand(tones[1]), ...ours]);
    if (poses[1]) painter.drawGhost(parts(1, [ghost, ghost, ghost]), 0.42);
  }

  /* A column under a base that is above the ground; none if the base is near the ground. */
  stand(colour) {
    if (this.ground > -0.15 * this.size) return [];
    const key = `${this.ground} ${this.size}`;
    if (this.standKey !== key) {
      this.standKey = key;
      const r = 0.028 * this.size;
      const first = this.kinematics.links[0];
      const axis = first ? point(times(this.kinematics.root, placed([0, 0, 0, ...first.origin.slice(3)])), first.axis) : [0, 0, 1];
      const beside = Math.abs(axis[2]) < 0.5 ? axis.map(x => x * 0.16 * this.size * (axis[1] > 0 ? 1 : -1)) : [0, 0, -2 * r];
      const length = beside[2] - this.ground;
      const column = { kind: "cylinder", size: [r, length] };
      this.column = [{ mesh: this.painter.upload(solidOf(column)), model: moved(beside[0], beside[1], this.ground + length / 2) }];
      if (Math.abs(axis[2]) < 0.5) {
        const pin = { kind: "capsule", size: [r, 0.16 * this.size] };
        const half = beside.map(x => x / 2);
        const lying = placed([...half, Math.SQRT1_2, ...[-axis[1], axis[0], 0].map(x => x * Math.SQRT1_2)]);
        this.column.push({ mesh: this.painter.upload(solidOf(pin)), model: lying });
      }
    }
    return this.column.map(part => ({ ...part, colour }));
  }

  drawLines(matrix, poses, ratio) {
    const pen = this.flat.getContext("2d");
    const { width, height } = this.flat;
    pen.clearRect(0, 0, width, height);
    const seen = at => {
      const w = matrix[3] * at[0] + matrix[7] * at[1] + matrix[11] * at[2] + matrix[15];
      const [x, y] = point(matrix, at);
      return w > 0 ? [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height] : null;
    };
    const line = (points, colour, wide, dash) => {
      pen.beginPath();
      points.map(seen).forEach((at, k) => at && (k ? pen.lineTo(...at) : pen.moveTo(...at)));
      pen.strokeStyle = colour;
      pen.lineWidth = wide * ratio;
      pen.setLineDash(dash.map(x => x * ratio));
      pen.stroke();
    };
    pen.lineJoin = pen.lineCap = "round";
    pen.globalAlpha = 0.85;
    if (this.runs[0].should.length) line(this.runs[0].should, colourOf("--soft"), 1.2, [4, 5]);
    if (this.runs[1]) line(this.runs[1].path, colourOf("--b"), 1.6, [6, 4]);
    line(this.runs[0].path, colourOf("--a"), 1.6, []);
    pen.globalAlpha = 1;
    if (this.painter) return;
    poses.forEach((frames, k) => {
      const bones = [[0, 0, 0], ...frames.map(frame => point(frame, [0, 0, 0])), this.kinematics.tipOf(frames)];
      line(bones, colourOf(k ? "--b" : "--ink"), k ? 3 : 5, k ? [8, 5] : []);
    });
  }
}

function roundCell(size) {
  const power = 10 ** Math.floor(Math.log10(size / 2));
  return [1, 2, 5].map(factor => factor * power).filter(cell => cell <= size / 2).pop() ?? power;
}
