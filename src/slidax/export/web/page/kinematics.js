/* Forward kinematics of an arm. */

import { identity, moved, placed, point, times, turned, upright } from "./matrix.js";

export class Kinematics {
  /* - `arm`: entry of the manifest. */
  constructor(arm) {
    this.links = arm.kinematics.map(link => ({ ...link, frame: placed(link.origin) }));
    this.tip = arm.tip;
    this.root = upright(arm.up ?? [0, 0, 1]);
    this.joints = arm.joints;
  }

  /* Frame of each link in the world, for the joint positions in `q` from `offset` on; non-finite ones count as 0. */
  poses(q, offset = 0) {
    const frames = [];
    for (const link of this.links) {
      let frame = times(link.parent < 0 ? this.root : frames[link.parent], link.frame);
      if (link.joint !== null && link.type !== "fixed") {
        const found = q[offset + link.joint];
        const own = Number.isFinite(found) ? found : 0;
        const value = link.follows ? link.follows.ratio * own + link.follows.offset : own;
        const [x, y, z] = link.axis;
        frame = times(frame, link.type === "prismatic" ? moved(x * value, y * value, z * value) : turned(link.axis, value));
      }
      frames.push(frame);
    }
    return frames;
  }

  frame(poses, link) {
    return link < 0 ? this.root : (poses[link] ?? identity());
  }

  tipOf(poses) {
    return point(this.frame(poses, this.tip.link), this.tip.at);
  }
}

/* Path of the tip in a run, in at most `most` points. */
export function tipPath(kinematics, q, rows, most = 500) {
  const every = Math.max(1, Math.ceil(rows / most));
  const path = [];
  for (let row = 0; row < rows; row += every) {
    const at = row * kinematics.joints;
    if (!Number.isFinite(q[at])) break;
    path.push(kinematics.tipOf(kinematics.poses(q, at)));
  }
  return path;
}
