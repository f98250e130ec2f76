/* Simple solids as triangles: {points, normals, triangles}. Their long axis is z, their centre the origin. */

const AROUND = 28;

/* A surface of revolution.
   - `outline`: points from below to above, each [radius, height, and the same two parts of the outward normal]. */
function revolved(outline) {
  const points = [], normals = [], triangles = [];
  outline.forEach(([r, z, nr, nz]) => {
    for (let k = 0; k <= AROUND; k++) {
      const angle = (2 * Math.PI * k) / AROUND;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      points.push(r * c, r * s, z);
      normals.push(nr * c, nr * s, nz);
    }
  });
  const wide = AROUND + 1;
  for (let ring = 0; ring + 1 < outline.length; ring++) {
    for (let k = 0; k < AROUND; k++) {
      const a = ring * wide + k;
      triangles.push(a, a + 1, a + wide, a + 1, a + wide + 1, a + wide);
    }
  }
  return { points, normals, triangles };
}

function cylinder([radius, length]) {
  const h = length / 2;
  const bevel = Math.min(0.12 * radius, 0.2 * h);
  const d = Math.SQRT1_2;
  return revolved([
    [0, -h, 0, -1], [radius - bevel, -h, 0, -1], [radius - bevel, -h, d, -d], [radius, -h + bevel, d, -d],
    [radius, -h + bevel, 1, 0], [radius, h - bevel, 1, 0],
    [radius, h - bevel, d, d], [radius - bevel, h, d, d], [radius - bevel, h, 0, 1], [0, h, 0, 1],
  ]);
}

function capsule([radius, length]) {
  const outline = [];
  const steps = 8;
  for (const [end, from] of [[-length / 2, -90], [length / 2, 0]]) {
    for (let k = 0; k <= steps; k++) {
      const angle = ((from + (90 * k) / steps) * Math.PI) / 180;
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      outline.push([radius * c, end + radius * s, c, s]);
    }
  }
  return revolved(outline);
}

function box(size) {
  const points = [], normals = [], triangles = [];
  for (let axis = 0; axis < 3; axis++) {
    for (const side of [-1, 1]) {
      const first = points.length / 3;
      for (const [u, v] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        const corner = [0, 0, 0];
        corner[axis] = side;
        corner[(axis + 1) % 3] = u;
        corner[(axis + 2) % 3] = v;
        points.push(...corner.map((x, k) => (x * size[k]) / 2));
        normals.push(...[0, 1, 2].map(k => (k === axis ? side : 0)));
      }
      triangles.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
  }
  return { points, normals, triangles };
}

export function solidOf(shape) {
  if (shape.kind === "sphere") return capsule([shape.size[0], 0]);
  return { capsule, cylinder, box }[shape.kind](shape.size);
}

/* Radius of the smallest ball around a shape, approximately. */
export function ballRadius(shape) {
  const [a, b = 0, c = 0] = shape.size;
  if (shape.kind === "box") return Math.hypot(a, b, c) / 2;
  if (shape.kind === "sphere") return a;
  return shape.kind === "capsule" ? a + b / 2 : Math.hypot(a, b / 2);
}
