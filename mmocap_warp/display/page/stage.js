// Draws in WebGL 2: the skin, bent by its joints on the GPU; lines; and pictures in the world.
const SKIN = `#version 300 es
layout(location = 0) in vec3 rest;
layout(location = 1) in vec3 outward;
layout(location = 2) in uvec4 influence;
layout(location = 3) in vec4 weight;
uniform mat4 world_to_clip;
uniform highp sampler2D joints; // of each, what takes the body's rest into the world: three rows of a matrix
out vec3 normal;
void main() {
  mat3x4 blend = mat3x4(0.0);
  for (int i = 0; i < 4; i++) {
    if (weight[i] == 0.0) continue;
    int joint = int(influence[i]);
    for (int row = 0; row < 3; row++) blend[row] += weight[i] * texelFetch(joints, ivec2(row, joint), 0);
  }
  normal = vec4(outward, 0.0) * blend;
  vec3 place = vec4(rest, 1.0) * blend / (weight.x + weight.y + weight.z + weight.w);
  gl_Position = world_to_clip * vec4(place, 1.0);
}`;
const SHADE = `#version 300 es
precision highp float;
in vec3 normal;
uniform vec3 light;
uniform vec4 colour;
out vec4 shown;
void main() {
  float facing = dot(normalize(normal), light);
  shown = vec4(colour.rgb * (0.62 + 0.38 * facing) * colour.a, colour.a);
}`;
const LINE = `#version 300 es
layout(location = 0) in vec2 corner; // along the line, across it
layout(location = 1) in vec3 start;
layout(location = 2) in vec3 end;
layout(location = 3) in vec4 colour;
layout(location = 4) in float width;
uniform mat4 world_to_clip;
uniform vec2 size;
out vec4 tint;
void main() {
  const float near = 0.05;
  vec4 a = world_to_clip * vec4(start, 1.0), b = world_to_clip * vec4(end, 1.0);
  tint = colour;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // nowhere
  if (a.w < near && b.w < near) return;
  if (a.w < near) a = mix(a, b, (near - a.w) / (b.w - a.w));
  else if (b.w < near) b = mix(b, a, (near - b.w) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * size;
  vec2 across = length(along) > 1e-6 ? normalize(vec2(-along.y, along.x)) : vec2(0.0, 1.0);
  gl_Position = corner.x < 0.5 ? a : b;
  gl_Position.xy += across * corner.y * width / size * gl_Position.w;
}`;
const TINT = `#version 300 es
precision highp float;
in vec4 tint;
out vec4 shown;
void main() { shown = vec4(tint.rgb * tint.a, tint.a); }`;
const PICTURE = `#version 300 es
uniform mat4 world_to_clip;
uniform vec3 corners[4];
out vec2 at;
void main() {
  at = vec2(gl_VertexID == 1 || gl_VertexID == 2, gl_VertexID > 1);
  gl_Position = world_to_clip * vec4(corners[gl_VertexID], 1.0);
}`;
const PRINT = `#version 300 es
precision highp float;
in vec2 at;
uniform sampler2D picture;
uniform vec4 mask; // its colour; of an image none
out vec4 shown;
void main() {
  vec4 seen = texture(picture, at);
  shown = mask.a > 0.0 ? vec4(mask.rgb, 1.0) * mask.a * seen.r : vec4(seen.rgb, 1.0);
}`;

class Stage {
  constructor(canvas, ...bodies) {
    const gl = canvas.getContext("webgl2", { antialias: true });
    if (!gl) throw new Error("WebGL 2 is missing");
    this.gl = gl;
    this.skin = this.program(SKIN, SHADE);
    this.line = this.program(LINE, TINT);
    this.picture = this.program(PICTURE, PRINT);
    this.bodies = bodies.map((body) => this.loadBody(body));
    this.loadLines();
    this.bare = gl.createVertexArray();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
  }

  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const name = gl.getActiveUniform(program, i).name.replace("[0]", "");
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  attribute(location, values, size, kind, { whole = false, stride = 0, offset = 0, perInstance = false } = {}) {
    const { gl } = this;
    if (values) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    }
    gl.enableVertexAttribArray(location);
    if (whole) gl.vertexAttribIPointer(location, size, kind, stride, offset);
    else gl.vertexAttribPointer(location, size, kind, kind === gl.UNSIGNED_SHORT, stride, offset);
    if (perInstance) gl.vertexAttribDivisor(location, 1);
  }

  loadBody(body) {
    const { gl } = this;
    const vertex = unpack(body.vertex), triangle = unpack(body.triangle), rest = unpack(body.rest);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    this.attribute(0, vertex, 3, gl.FLOAT);
    this.attribute(1, normals(vertex, triangle), 3, gl.FLOAT);
    this.attribute(2, unpack(body.influence), 4, gl.UNSIGNED_SHORT, { whole: true });
    this.attribute(3, unpack(body.weight), 4, gl.UNSIGNED_SHORT);
    const [fine, coarse] = [triangle, unpack(body.coarse)].map((corners) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
      return { buffer, count: corners.length, kind: corners.BYTES_PER_ELEMENT === 2 ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT };
    });
    return { array, fine, coarse, rest, rows: new Float32Array(12 * body.joints.length), texture: this.texture(gl.NEAREST) };
  }

  loadLines() {
    const { gl } = this;
    this.lines = gl.createVertexArray();
    gl.bindVertexArray(this.lines);
    this.attribute(0, new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]), 2, gl.FLOAT);
    this.lineBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    [3, 3, 4, 1].reduce((offset, size, i) => {
      this.attribute(i + 1, null, size, gl.FLOAT, { stride: 44, offset, perInstance: true });
      return offset + 4 * size;
    }, 0);
  }

  texture(filter) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  // A picture for `pictures` below, from an <img> that is loaded; `texture` is an earlier one to be replaced.
  loadPicture(image, texture) {
    const { gl } = this;
    const target = texture ?? this.texture(gl.LINEAR);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
    return target;
  }

  // Draws into a part of the window, whose left and bottom are given, from now on.
  begin(view, far, corner, colour) {
    const { gl } = this;
    this.clip = view.clip(0.05, far);
    this.size = view.size;
    gl.viewport(...corner, ...view.size);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(...corner, ...view.size);
    gl.clearColor(...colour, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  use({ program, uniforms }, array, depth) {
    const { gl } = this;
    gl.useProgram(program);
    gl.bindVertexArray(array);
    gl.uniformMatrix4fv(uniforms.world_to_clip, false, this.clip);
    (depth ? gl.enable : gl.disable).call(gl, gl.DEPTH_TEST);
    return uniforms;
  }

  // `joints` (joint, 8) as Track.at writes them; `light` is where it comes from; `mesh` is `fine` or `coarse`; of which body.
  drawSkin(joints, light, colour, mesh, which = 0) {
    const { gl } = this, { array, rest, rows, texture, [mesh]: { buffer, kind, count: corners } } = this.bodies[which];
    const count = joints.length / 8;
    for (let j = 0; j < count; j++) {
      const from = rest.subarray(3 * j, 3 * j + 3);
      turning(joints.subarray(8 * j, 8 * j + 4)).forEach((row, i) => {
        rows.set([...row, joints[8 * j + 4 + i] - dot(row, from)], 12 * j + 4 * i);
      });
    }
    const uniforms = this.use(this.skin, array, true);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 3, count, 0, gl.RGBA, gl.FLOAT, rows);
    gl.uniform3fv(uniforms.light, light);
    gl.uniform4fv(uniforms.colour, colour);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    const triangles = () => gl.drawElements(gl.TRIANGLES, corners, kind, 0);
    if (colour[3] < 1) { // the nearest surface alone, not those behind it
      gl.colorMask(false, false, false, false);
      triangles();
      gl.colorMask(true, true, true, true);
    }
    triangles();
  }

  // `segments`: start, end, colour and width [px] of each, 11 numbers.
  drawLines(segments, depth) {
    const { gl } = this;
    const uniforms = this.use(this.line, this.lines, depth);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(segments.flat()), gl.DYNAMIC_DRAW);
    gl.uniform2fv(uniforms.size, this.size);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, segments.length);
  }

  // A picture between four corners of the world; of a mask the foreground alone, in a colour.
  drawPicture(texture, corners, depth, mask = [0, 0, 0, 0]) {
    const { gl } = this;
    const uniforms = this.use(this.picture, this.bare, depth);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform3fv(uniforms.corners, corners.flat());
    gl.uniform4fv(uniforms.mask, mask);
    gl.drawArrays(gl.TRIANGLE_FAN, 0, 4);
  }
}

// The rows of a quaternion's matrix.
function turning([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// Of each vertex, its triangles' normals added up.
function normals(vertex, triangle) {
  const sum = new Float32Array(vertex.length);
  for (let i = 0; i < triangle.length; i += 3) {
    const [a, b, c] = [triangle[i], triangle[i + 1], triangle[i + 2]].map((v) => vertex.subarray(3 * v, 3 * v + 3));
    const ab = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], ac = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    const normal = cross(ab, ac);
    for (let corner = 0; corner < 3; corner++) {
      for (let k = 0; k < 3; k++) sum[3 * triangle[i + corner] + k] += normal[k];
    }
  }
  return sum;
}
