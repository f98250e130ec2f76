/* WebGL drawing for the three-dimensional picture: solids with soft light, translucent solids, their shadow, and the
   ground. */

const SOLID_VERTEX = `#version 300 es
uniform mat4 model, view, projection;
in vec3 place, normal;
out vec3 n, seen;
void main() {
  vec4 at = view * model * vec4(place, 1.0);
  n = mat3(view * model) * normal;
  seen = at.xyz;
  gl_Position = projection * at;
}`;
const SOLID_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 colour;
uniform vec3 sun;
uniform float plain;
in vec3 n, seen;
out vec4 made;
void main() {
  vec3 m = normalize(n), eye = normalize(-seen);
  if (dot(m, eye) < 0.0) m = -m;
  float day = 0.5 + 0.5 * dot(m, sun);
  float shine = pow(max(dot(m, normalize(sun + eye)), 0.0), 40.0);
  float rim = pow(1.0 - max(dot(m, eye), 0.0), 3.0);
  vec3 lit = colour.rgb * (0.38 + 0.72 * day * day) + vec3(0.20 * shine + 0.08 * rim);
  made = vec4(mix(lit, colour.rgb, plain), colour.a);
}`;
const GROUND_VERTEX = `#version 300 es
uniform mat4 view, projection;
uniform float level, size;
in vec3 place;
out vec2 at;
void main() {
  at = place.xy * size;
  gl_Position = projection * view * vec4(at, level, 1.0);
}`;
const GROUND_FRAGMENT = `#version 300 es
precision highp float;
uniform vec4 colour;
uniform float size, cell;
in vec2 at;
out vec4 made;
void main() {
  vec2 p = at / cell, w = fwidth(p) * 1.2;
  vec2 d = abs(fract(p - 0.5) - 0.5);
  float line = max(1.0 - smoothstep(0.0, w.x, d.x), 1.0 - smoothstep(0.0, w.y, d.y));
  float far = 1.0 - smoothstep(0.45, 1.0, length(at) / size);
  made = vec4(colour.rgb, colour.a * (0.1 + 0.9 * line) * far);
}`;

export class Painter {
  /* Throws Error if WebGL is not available. */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, stencil: true, premultipliedAlpha: false });
    if (!gl) throw new Error("no WebGL");
    this.gl = gl;
    this.canvas = canvas;
    this.solid = programOf(gl, SOLID_VERTEX, SOLID_FRAGMENT);
    this.ground = programOf(gl, GROUND_VERTEX, GROUND_FRAGMENT);
    this.floor = this.upload({
      points: [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], normals: new Array(12).fill(0), triangles: [0, 1, 2, 0, 2, 3],
    });
  }

  upload({ points, normals, triangles }) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    const buffers = [];
    gl.bindVertexArray(array);
    [points, normals].forEach((data, slot) => {
      buffers.push(gl.createBuffer());
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[slot]);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.STATIC_DRAW);
      gl.enableVertexAttribArray(slot);
      gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 0, 0);
    });
    buffers.push(gl.createBuffer());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[2]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(triangles), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { array, buffers, count: triangles.length };
  }

  forget({ array, buffers }) {
    buffers.forEach(buffer => this.gl.deleteBuffer(buffer));
    this.gl.deleteVertexArray(array);
  }

  begin(view, projection) {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clearStencil(0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.view = view;
    this.projection = projection;
    for (const program of [this.solid, this.ground]) {
      gl.useProgram(program.made);
      gl.uniformMatrix4fv(program.at.view, false, view);
      gl.uniformMatrix4fv(program.at.projection, false, projection);
    }
    gl.useProgram(this.solid.made);
    gl.uniform3f(this.solid.at.sun, 0.26, 0.72, 0.64);
  }

  drawGround(level, size, cell, colour) {
    const gl = this.gl;
    gl.useProgram(this.ground.made);
    gl.uniform1f(this.ground.at.level, level);
    gl.uniform1f(this.ground.at.size, size);
    gl.uniform1f(this.ground.at.cell, cell);
    gl.uniform4fv(this.ground.at.colour, colour);
    gl.depthMask(false);
    gl.bindVertexArray(this.floor.array);
    gl.drawElements(gl.TRIANGLES, this.floor.count, gl.UNSIGNED_SHORT, 0);
    gl.depthMask(true);
  }

  /* - `parts`: [{mesh, model, colour}]. */
  drawSolids(parts) {
    for (const part of parts) this.drawOne(part, part.colour, 0);
  }

  /* Draws translucent solids, but only their nearest faces, so that their inside is not visible. */
  drawGhost(parts, alpha) {
    const gl = this.gl;
    /* Slightly farther from the camera, so that a solid at the same place hides the ghost. */
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 8);
    gl.colorMask(false, false, false, false);
    this.drawSolids(parts);
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.EQUAL);
    for (const part of parts) this.drawOne(part, [...part.colour.slice(0, 3), alpha], 0);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /* Draws the shadow on the ground, which darkens each place only once.
     - `flat`: matrix that projects the world onto the ground. */
  drawShadow(parts, flat, times, colour) {
    const gl = this.gl;
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    for (const part of parts) this.drawOne({ ...part, model: times(flat, part.model) }, colour, 1);
    gl.depthMask(true);
    gl.disable(gl.STENCIL_TEST);
  }

  drawOne({ mesh, model }, colour, plain) {
    const gl = this.gl;
    gl.useProgram(this.solid.made);
    gl.uniformMatrix4fv(this.solid.at.model, false, model);
    gl.uniform4fv(this.solid.at.colour, colour);
    gl.uniform1f(this.solid.at.plain, plain);
    gl.bindVertexArray(mesh.array);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_SHORT, 0);
  }
}

function programOf(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "place");
  gl.bindAttribLocation(made, 1, "normal");
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error("no WebGL: its programs do not link");
  const at = {};
  for (let k = 0; k < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); k++) {
    const { name } = gl.getActiveUniform(made, k);
    at[name] = gl.getUniformLocation(made, name);
  }
  return { made, at };
}
