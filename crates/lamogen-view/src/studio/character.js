// A character of the user's own: its mesh, moved by its bones and lit, drawn with WebGL 2 over the ground and the shadows of the stage.

/** The bones of a row of the texture that holds their matrices; a bone takes three texels. */
const BONES_PER_ROW = 256;
const VERTEX_BYTES = 40;

const VERTEX_SHADER = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec2 place;
layout(location = 3) in uvec4 bones;
layout(location = 4) in vec4 weights;
layout(location = 5) in vec4 vertexColour;
uniform highp sampler2D matrices;
uniform vec3 focus, right, up, back;
uniform float distance;
// The middle of the view and the size of a metre at the distance of one metre, in units of the canvas from -1 to 1.
uniform vec4 projection;
out vec3 worldNormal;
out vec3 toCamera;
out vec2 texturePlace;
out vec4 tint;

void main() {
  vec3 world = vec3(0), turned = vec3(0);
  for (int i = 0; i < 4; i++) {
    int bone = int(bones[i]);
    ivec2 at = ivec2((bone % ${BONES_PER_ROW}) * 3, bone / ${BONES_PER_ROW});
    vec4 a = texelFetch(matrices, at, 0), b = texelFetch(matrices, at + ivec2(1, 0), 0), c = texelFetch(matrices, at + ivec2(2, 0), 0);
    vec4 p = vec4(position, 1);
    world += weights[i] * vec3(dot(a, p), dot(b, p), dot(c, p));
    turned += weights[i] * vec3(dot(a.xyz, normal.xyz), dot(b.xyz, normal.xyz), dot(c.xyz, normal.xyz));
  }
  world /= dot(weights, vec4(1));
  vec3 from = world - focus;
  float depth = distance - dot(from, back);
  gl_Position = vec4(projection.xy * depth + projection.zw * vec2(dot(from, right), dot(from, up)), 1.001 * depth - 0.1, depth);
  worldNormal = turned;
  toCamera = focus + back * distance - world;
  texturePlace = place;
  tint = vertexColour;
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
in vec3 worldNormal;
in vec3 toCamera;
in vec2 texturePlace;
in vec4 tint;
uniform vec4 colour;
uniform sampler2D image;
uniform vec3 light;
uniform float cutoff, greyness;
uniform bool isTranslucent;
out vec4 result;

void main() {
  vec4 base = colour * tint * texture(image, texturePlace);
  if (base.a < cutoff) discard;
  // Of a material without translucency, opacity says only where nothing is drawn.
  if (!isTranslucent) base.a = 1.0;
  vec3 normal = normalize(worldNormal + vec3(1e-9));
  if (dot(normal, toCamera) < 0.0) normal = -normal;
  float bright = max(dot(normal, light), 0.0);
  float shade = 0.58 + 0.5 * bright + 0.08 * pow(bright, 14.0);
  vec3 grey = vec3(dot(base.rgb, vec3(0.3, 0.59, 0.11)) * 0.6 + 0.2);
  vec3 lit = mix(base.rgb, grey, greyness) * shade;
  result = vec4(min(lit, vec3(1)) * base.a, base.a);
}`;

const bytesOf = (text) => new Uint8Array(decode(text).buffer);

/** The poses of a character's bones in a motion. */
class BoneTrack {
  constructor({ frames, frames_per_second: rate, scale, poses }) {
    const numbers = decodeFloats(poses);
    Object.assign(this, { frames, rate, scale, numbers, width: numbers.length / frames });
  }

  /** Calls `moved(bone, position, rotation)` for every bone at a time. */
  at(time, moved) {
    const { numbers, width, frames } = this;
    const place = Math.min(Math.max(time * this.rate, 0), frames - 1);
    const frame = Math.min(Math.floor(place), Math.max(frames - 2, 0));
    const t = place - frame;
    const [a, b] = [frame * width, Math.min(frame + 1, frames - 1) * width];
    for (let bone = 0; 7 * bone < width; bone++) {
      const [from, to] = [a + 7 * bone, b + 7 * bone];
      const between = (i, sign = 1) => numbers[from + i] * (1 - t) + sign * numbers[to + i] * t;
      let along = 0;
      for (let i = 3; i < 7; i++) along += numbers[from + i] * numbers[to + i];
      const sign = along < 0 ? -1 : 1;
      const turn = [between(3, sign), between(4, sign), between(5, sign), between(6, sign)];
      const length = Math.hypot(...turn) || 1;
      moved(bone, [between(0), between(1), between(2)], turn.map((x) => x / length));
    }
  }
}

/** Draws the mesh of a character. `canvas` lies over that of the stage. */
class CharacterPainter {
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed });
    this.mesh = null;
    this.gl = canvas.getContext("webgl2", { alpha: true, antialias: true, premultipliedAlpha: true });
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.program = null;
      changed();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.build();
      changed();
    });
  }

  /** Whether there is a mesh that can be drawn. */
  get isReady() {
    return Boolean(this.gl && this.mesh && this.program);
  }

  /** Takes the mesh of an answer of the server, or null for none. */
  load(mesh) {
    this.mesh = mesh;
    this.binds = mesh && decodeFloats(mesh.binds);
    if (mesh && this.gl) this.build();
    this.changed();
  }

  /** Makes what is drawn from the mesh. */
  build() {
    const { gl, mesh } = this;
    if (!mesh || gl.isContextLost()) return;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      this.program = null;
      return;
    }
    this.forget();
    this.program = program;
    this.places = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.buffers = [gl.ARRAY_BUFFER, gl.ELEMENT_ARRAY_BUFFER].map((kind, i) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(kind, buffer);
      gl.bufferData(kind, bytesOf(i === 0 ? mesh.vertices : mesh.indices), gl.STATIC_DRAW);
      return buffer;
    });
    for (let i = 0; i < 6; i++) gl.enableVertexAttribArray(i);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, VERTEX_BYTES, 0);
    gl.vertexAttribPointer(1, 4, gl.BYTE, true, VERTEX_BYTES, 12);
    gl.vertexAttribPointer(2, 2, gl.FLOAT, false, VERTEX_BYTES, 16);
    gl.vertexAttribIPointer(3, 4, gl.UNSIGNED_SHORT, VERTEX_BYTES, 24);
    gl.vertexAttribPointer(4, 4, gl.UNSIGNED_BYTE, true, VERTEX_BYTES, 32);
    gl.vertexAttribPointer(5, 4, gl.UNSIGNED_BYTE, true, VERTEX_BYTES, 36);
    const rows = Math.ceil(mesh.bones.length / BONES_PER_ROW);
    this.matrices = { texture: gl.createTexture(), rows, numbers: new Float32Array(rows * BONES_PER_ROW * 12) };
    gl.bindTexture(gl.TEXTURE_2D, this.matrices.texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    this.white = this.image([255, 255, 255, 255]);
    this.images = mesh.images.map(() => this.white);
    mesh.images.forEach((image, i) => this.loadImage(image, i, program));
  }

  /** Frees what the last mesh took. */
  forget() {
    const { gl } = this;
    if (!this.array) return;
    gl.deleteProgram(this.program);
    gl.deleteVertexArray(this.array);
    this.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    for (const texture of new Set([this.matrices.texture, this.white, ...this.images])) gl.deleteTexture(texture);
  }

  /** Makes a texture of one colour. */
  image(colour) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(colour));
    return texture;
  }

  async loadImage({ type, bytes }, i, program) {
    const { gl } = this;
    let picture;
    try {
      picture = await createImageBitmap(new Blob([bytesOf(bytes)], { type }), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    } catch {
      // A picture that the browser cannot read leaves the colour of the material.
      return;
    }
    if (this.program !== program || Math.max(picture.width, picture.height) > gl.getParameter(gl.MAX_TEXTURE_SIZE)) return;
    const texture = this.image([255, 255, 255, 255]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    this.images[i] = texture;
    this.changed();
  }

  /** Clears the canvas and gives it a size in pixels. */
  clear(width, height) {
    const { gl, canvas } = this;
    if (!gl) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.disable(gl.SCISSOR_TEST);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** Writes the matrices of all bones at a time into their texture. */
  pose(track, time) {
    const { gl, binds, matrices } = this;
    const { scale } = track;
    track.at(time, (bone, position, [x, y, z, w]) => {
      const turn = [
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
      ];
      for (let row = 0; row < 3; row++) {
        for (let column = 0; column < 4; column++) {
          const from = 16 * bone + 4 * column;
          const sum = turn[3 * row] * binds[from] + turn[3 * row + 1] * binds[from + 1] + turn[3 * row + 2] * binds[from + 2];
          matrices.numbers[12 * bone + 4 * row + column] = scale * sum + (column === 3 ? position[row] : 0);
        }
      }
    });
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, matrices.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 3 * BONES_PER_ROW, matrices.rows, 0, gl.RGBA, gl.FLOAT, matrices.numbers);
  }

  /** Draws the character in a cell of the canvas, as a lens sees it. `greyness` from 0 to 1 takes its colours away. */
  draw(track, time, lens, cell, ratio, greyness) {
    const { gl, mesh, canvas, places } = this;
    const [width, height] = [canvas.width / ratio, canvas.height / ratio];
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(Math.round(cell.x * ratio), Math.round((height - cell.y - cell.height) * ratio), Math.round(cell.width * ratio), Math.round(cell.height * ratio));
    gl.useProgram(this.program);
    gl.bindVertexArray(this.array);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.pose(track, time);
    gl.uniform1i(places.matrices, 0);
    gl.uniform1i(places.image, 1);
    for (const name of ["focus", "right", "up", "back"]) gl.uniform3fv(places[name], lens[name]);
    gl.uniform1f(places.distance, lens.distance);
    gl.uniform4f(places.projection, (2 * lens.middle[0]) / width - 1, 1 - (2 * lens.middle[1]) / height, (2 * lens.focal) / width, (2 * lens.focal) / height);
    // A part of the light moves with the camera, so that no side is ever black.
    const fill = add(add(times(lens.right, -0.3), times(lens.up, 0.2)), times(lens.back, 0.7));
    gl.uniform3fv(places.light, unit(add(times(LIGHT, 0.6), fill)));
    gl.uniform1f(places.greyness, greyness);
    const materials = mesh.groups.map(({ material }) => mesh.materials[material] ?? { colour: [0.8, 0.8, 0.8, 1], image: null, cutoff: null, translucent: false });
    for (const isTranslucent of [false, true]) {
      if (isTranslucent) gl.enable(gl.BLEND);
      else gl.disable(gl.BLEND);
      mesh.groups.forEach(({ start, count }, i) => {
        const { colour, image, cutoff, translucent } = materials[i];
        if (translucent !== isTranslucent) return;
        const [red, green, blue] = colour.map((x) => x ** (1 / 2.2));
        gl.uniform4f(places.colour, red, green, blue, colour[3]);
        gl.uniform1i(places.isTranslucent, isTranslucent ? 1 : 0);
        gl.uniform1f(places.cutoff, cutoff ?? (isTranslucent ? 0.02 : -1));
        gl.activeTexture(gl.TEXTURE1);
        gl.bindTexture(gl.TEXTURE_2D, this.images[image] ?? this.white);
        gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * start);
      });
    }
    gl.disable(gl.BLEND);
  }
}

/** Shows a character that was dropped: what it is, and whether the motion is shown on it. */
function showCharacter(parent, { name, answer, isShown }, canDraw, { toggle, remove }) {
  parent.replaceChildren();
  parent.hidden = false;
  const { mesh, mesh_problem: problem, scheme, notices } = answer;
  append(parent, "p", "", `${name}: ${mesh ? `${mesh.triangle_count} triangles, ` : ""}${mesh?.bones.length ?? "no"} bones, a skeleton as ${scheme}`);
  for (const notice of notices) append(parent, "p", "note", `${name}: ${notice}`);
  if (problem) append(parent, "p", "note", `It cannot be drawn here, but GLB is kept on it. ${problem}`);
  else if (!canDraw) append(parent, "p", "note", "This browser has no WebGL 2: the figure stands for the character.");
  appendFileButtons(parent, name, { text: "Put the motion on it", isPressed: isShown, press: toggle, remove });
}
