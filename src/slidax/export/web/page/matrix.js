/* 4x4 matrices by columns, as WebGL takes them. */

export function identity() {
  return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
}

export function times(a, b) {
  const made = new Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[4 * k + row] * b[4 * column + k];
      made[4 * column + row] = sum;
    }
  }
  return made;
}

export function point(matrix, [x, y, z]) {
  return [0, 1, 2].map(row => matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row]);
}

/* Matrix of a frame, from its position and its quaternion with the real part first. */
export function placed([x, y, z, w, i, j, k]) {
  return [
    1 - 2 * (j * j + k * k), 2 * (i * j + w * k), 2 * (i * k - w * j), 0,
    2 * (i * j - w * k), 1 - 2 * (i * i + k * k), 2 * (j * k + w * i), 0,
    2 * (i * k + w * j), 2 * (j * k - w * i), 1 - 2 * (i * i + j * j), 0,
    x, y, z, 1,
  ];
}

export function turned([x, y, z], angle) {
  const size = Math.hypot(x, y, z) || 1;
  const s = Math.sin(angle / 2) / size;
  return placed([0, 0, 0, Math.cos(angle / 2), x * s, y * s, z * s]);
}

export function moved(x, y, z) {
  return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1];
}

/* Rotation that maps a direction to the z axis. */
export function upright([x, y, z]) {
  const size = Math.hypot(x, y, z) || 1;
  const cosine = z / size;
  if (cosine > 1 - 1e-12) return identity();
  if (cosine < -1 + 1e-12) return turned([1, 0, 0], Math.PI);
  return turned([y, -x, 0], Math.acos(cosine));
}

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function unit(a) {
  const size = Math.hypot(...a) || 1;
  return a.map(x => x / size);
}

export function minus(a, b) {
  return a.map((x, k) => x - b[k]);
}

/* View matrix: from the world to a camera at `eye` that looks at `target`, with z up. */
export function looking(eye, target) {
  const back = unit(minus(eye, target));
  const right = unit(cross([0, 0, 1], back));
  const above = cross(back, right);
  const shift = axis => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
  return [
    right[0], above[0], back[0], 0, right[1], above[1], back[1], 0, right[2], above[2], back[2], 0,
    shift(right), shift(above), shift(back), 1,
  ];
}

export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}
