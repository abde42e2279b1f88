// @ts-check
// A small renderer on WebGL2. Each batch keeps what it drew on this side too, so that a lost context comes back with everything in it.
import { SHADERS } from "./gl_shaders.js";

/** @typedef {"lines" | "sprites" | "points" | "voxels" | "meshes" | "floor" | "picture"} Kind */
/** @typedef {{program: WebGLProgram, at: Record<string, WebGLUniformLocation | null>}} Program */
/** @typedef {{name: string, size: number, bytes: boolean, normalised: boolean, offset: number}} Attribute */

/** Packs a colour as it lies in memory. @param {number} r @param {number} g @param {number} b @param {number} a 0..255 */
export const packed = (r, g, b, a) => (r | g << 8 | b << 16 | a << 24) >>> 0;

/** The same colour, more transparent. @param {number} colour @param {number} alpha 0..1 */
export const faded = (colour, alpha) => (colour & 0xffffff | Math.round((colour >>> 24) * alpha) << 24) >>> 0;

/** Instances in one growing array: floats first, then a colour, then four bytes of style. */
class Batch {
  /** @param {number} words of an instance @param {Attribute[]} attributes */
  constructor(words, attributes) {
    this.words = words;
    this.attributes = attributes;
    this.n = 0;
    this.numbers = new Float32Array(words * 256);
    this.bits = new Uint32Array(this.numbers.buffer);
    this.stale = true;
    this.room = 0;
    this.generation = -1;
    /** @type {WebGLVertexArrayObject | null} */ this.array = null;
    /** @type {WebGLBuffer | null} */ this.buffer = null;
  }
  clear() {
    this.n = 0;
    this.stale = true;
  }
  next() {
    const at = this.n++ * this.words;
    if (at + this.words > this.numbers.length) {
      const more = new Float32Array(this.numbers.length * 2);
      more.set(this.numbers);
      this.numbers = more;
      this.bits = new Uint32Array(more.buffer);
    }
    return at;
  }
}

/** Line segments. */
export class Lines extends Batch {
  constructor() {
    super(8, [floats("a_from", 3, 0), floats("a_to", 3, 12), bytes("a_colour", true, 24), bytes("a_style", false, 28)]);
  }
  /**
   * @param {number} ax @param {number} ay @param {number} az @param {number} bx @param {number} by @param {number} bz
   * @param {number} colour @param {number} width in px, to an eighth @param {number} dash in px, 0: none
   */
  add(ax, ay, az, bx, by, bz, colour, width = 1, dash = 0) {
    const at = this.next(), to = this.numbers;
    to[at] = ax; to[at + 1] = ay; to[at + 2] = az; to[at + 3] = bx; to[at + 4] = by; to[at + 5] = bz;
    this.bits[at + 6] = colour;
    this.bits[at + 7] = Math.round(width * 8) | dash << 8;
  }
}

export const FILLED = 0, RING = 1, SQUARE = 2, AROUND = 3;

/** Ellipsoids. */
export class Sprites extends Batch {
  constructor() {
    super(14, [floats("a_centre", 3, 0), floats("a_axis0", 3, 12), floats("a_axis1", 3, 24), floats("a_axis2", 3, 36),
               bytes("a_colour", true, 48), bytes("a_style", false, 52)]);
  }
  /**
   * @param {number} x @param {number} y @param {number} z @param {Float64Array} axes three half axes @param {number} colour
   * @param {number} shape FILLED, RING, SQUARE or AROUND @param {number} least radius in px
   */
  add(x, y, z, axes, colour, shape, least) {
    const at = this.next(), to = this.numbers;
    to[at] = x; to[at + 1] = y; to[at + 2] = z;
    for (let k = 0; k < 9; k++) to[at + 3 + k] = axes[k];
    this.bits[at + 12] = colour;
    this.bits[at + 13] = shape | Math.round(least * 8) << 8;
  }
}

/** Points, cubes or triangles as they came: positions, colours, and of meshes corners of triangles. */
export class Cloud {
  /** @param {"points" | "voxels" | "meshes"} kind */
  constructor(kind) {
    this.kind = kind;
    this.n = 0;
    this.n_corners = 0;
    this.size_m = 0;
    /** @type {Uint8Array} */ this.payload = new Uint8Array(0);
    this.stale = true;
    this.generation = -1;
    /** @type {WebGLVertexArrayObject | null} */ this.array = null;
    /** @type {(WebGLBuffer | null)[]} */ this.buffers = [];
    this.rooms = [0, 0, 0];
    this.model = new Float32Array(16);
  }
  /** @param {number} n @param {Uint8Array} payload @param {number} n_corners */
  set(n, payload, n_corners = 0) {
    const whole = Math.floor(payload.length / 16);
    this.n = Math.min(n, whole);
    this.n_corners = Math.min(n_corners, Math.floor((payload.length - this.n * 16) / 4));
    this.payload = payload;
    this.stale = true;
  }
}

/** The picture of a camera. */
export class Picture {
  constructor() {
    this.width = this.height = this.channels = 0;
    /** @type {Uint8Array | null} */ this.pixels = null;
    this.stale = false;
    this.generation = -1;
    this.shape = "";
    /** @type {WebGLTexture | null} */ this.texture = null;
  }
  /** @param {number} width @param {number} height @param {number} channels @param {Uint8Array} pixels */
  set(width, height, channels, pixels) {
    if (pixels.length < width * height * channels) return;
    Object.assign(this, { width, height, channels, pixels, stale: true });
  }
}

/** @param {string} name @param {number} size @param {number} offset @returns {Attribute} */
function floats(name, size, offset) { return { name, size, bytes: false, normalised: false, offset }; }
/** @param {string} name @param {boolean} normalised @param {number} offset @returns {Attribute} */
function bytes(name, normalised, offset) { return { name, size: 4, bytes: true, normalised, offset }; }

export class Renderer {
  /** @param {HTMLCanvasElement} canvas @param {() => void} changed called when all is to be drawn again */
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { alpha: false, antialias: true, powerPreference: "high-performance" });
    this.works = this.gl != null;
    this.lost = false;
    this.generation = 0;
    this.clip = new Float32Array(16);
    this.part = new Float32Array(16);
    this.eye = new Float32Array(4);
    this.pixel = 1;
    this.metre_px = 1;
    /** @type {Partial<Record<Kind, Program>>} */ this.programs = {};
    /** @type {Program | null} */ this.current = null;
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
      changed();
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.lost = false;
      this.programs = {};
      this.generation++;
      changed();
    });
  }

  /**
   * @param {number[]} background red, green, blue 0..255 @param {Float64Array} clip clip from world @param {Float32Array} eye
   * @param {number} pixel canvas pixels for one of the page @param {number} metre_px pixels of 1 m in 1 m distance
   */
  begin(background, clip, eye, pixel, metre_px) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    this.clip.set(clip);
    this.eye.set(eye);
    this.pixel = pixel;
    this.metre_px = metre_px;
    this.current = null;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(background[0] / 255, background[1] / 255, background[2] / 255, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** @param {Kind} kind @param {Float32Array} clip @param {Float32Array} eye */
  use(kind, clip, eye) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    const it = this.programs[kind] ??= compiled(gl, kind);
    gl.useProgram(it.program);
    gl.uniformMatrix4fv(it.at.u_clip, false, clip);
    gl.uniform2f(it.at.u_size, this.canvas.width, this.canvas.height);
    gl.uniform4fv(it.at.u_eye, eye);
    gl.uniform1f(it.at.u_pixel, this.pixel);
    return it;
  }

  /** @param {Batch} batch @param {"lines" | "sprites"} kind */
  batch(batch, kind) {
    if (batch.n === 0) return;
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    const it = this.use(kind, this.clip, this.eye);
    if (batch.generation !== this.generation) {
      batch.generation = this.generation;
      batch.array = gl.createVertexArray();
      batch.buffer = gl.createBuffer();
      batch.room = 0;
      batch.stale = true;
      gl.bindVertexArray(batch.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, batch.buffer);
      for (const of of batch.attributes) {
        const place = gl.getAttribLocation(it.program, of.name);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, of.size, of.bytes ? gl.UNSIGNED_BYTE : gl.FLOAT, of.normalised, batch.words * 4, of.offset);
        gl.vertexAttribDivisor(place, 1);
      }
    }
    gl.bindVertexArray(batch.array);
    if (batch.stale) {
      gl.bindBuffer(gl.ARRAY_BUFFER, batch.buffer);
      if (batch.room < batch.numbers.length) {
        batch.room = batch.numbers.length;
        gl.bufferData(gl.ARRAY_BUFFER, batch.room * 4, gl.DYNAMIC_DRAW);
      }
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, batch.numbers, 0, batch.n * batch.words);
      batch.stale = false;
    }
    gl.depthMask(false);
    // What lies within a body or behind it is seen faintly.
    gl.uniform1f(it.at.u_strength, 0.3);
    gl.depthFunc(gl.GREATER);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, batch.n);
    gl.uniform1f(it.at.u_strength, 1);
    gl.depthFunc(gl.LEQUAL);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, batch.n);
    gl.depthMask(true);
  }

  /** @param {Lines} batch */
  lines(batch) { this.batch(batch, "lines"); }
  /** @param {Sprites} batch */
  sprites(batch) { this.batch(batch, "sprites"); }

  /** @param {Cloud} cloud */
  cloud(cloud) {
    if (cloud.n === 0) return;
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl), m = cloud.model, c = this.clip, e = this.eye, part = this.part;
    for (let k = 0; k < 16; k++) {
      const from = k & 12, r = k & 3;
      part[k] = c[r] * m[from] + c[4 + r] * m[from + 1] + c[8 + r] * m[from + 2] + c[12 + r] * m[from + 3];
    }
    const it = this.use(cloud.kind, part, localEye(m, e));
    this.upload(cloud, it);
    gl.bindVertexArray(cloud.array);
    gl.uniform1f(it.at.u_half, cloud.size_m / 2);
    gl.uniform1f(it.at.u_metre_px, (cloud.size_m || 0.005) * this.metre_px);
    gl.uniform1f(it.at.u_least, 1.5 * this.pixel);
    if (cloud.kind === "points") gl.drawArrays(gl.POINTS, 0, cloud.n);
    else if (cloud.kind === "voxels") gl.drawArraysInstanced(gl.TRIANGLES, 0, 18, cloud.n);
    else gl.drawElements(gl.TRIANGLES, cloud.n_corners, gl.UNSIGNED_INT, 0);
  }

  /** @param {Cloud} cloud @param {Program} it */
  upload(cloud, it) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    if (cloud.generation !== this.generation) {
      cloud.generation = this.generation;
      cloud.array = gl.createVertexArray();
      cloud.buffers = [gl.createBuffer(), gl.createBuffer(), gl.createBuffer()];
      cloud.rooms = [0, 0, 0];
      cloud.stale = true;
      gl.bindVertexArray(cloud.array);
      for (const [k, name] of ["a_position", "a_colour"].entries()) {
        const place = gl.getAttribLocation(it.program, name);
        gl.bindBuffer(gl.ARRAY_BUFFER, cloud.buffers[k]);
        gl.enableVertexAttribArray(place);
        if (k === 0) gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
        else gl.vertexAttribPointer(place, 4, gl.UNSIGNED_BYTE, true, 0, 0);
        gl.vertexAttribDivisor(place, cloud.kind === "voxels" ? 1 : 0);
      }
      if (cloud.kind === "meshes") gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, cloud.buffers[2]);
      gl.bindVertexArray(null);
    }
    if (!cloud.stale) return;
    cloud.stale = false;
    this.fill(cloud, 0, gl.ARRAY_BUFFER, 0, cloud.n * 12);
    this.fill(cloud, 1, gl.ARRAY_BUFFER, cloud.n * 12, cloud.n * 4);
    if (cloud.kind !== "meshes") return;
    gl.bindVertexArray(cloud.array);
    this.fill(cloud, 2, gl.ELEMENT_ARRAY_BUFFER, cloud.n * 16, cloud.n_corners * 4);
  }

  /** @param {Cloud} cloud @param {number} k @param {number} target @param {number} from @param {number} length in bytes */
  fill(cloud, k, target, from, length) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    gl.bindBuffer(target, cloud.buffers[k]);
    if (cloud.rooms[k] < length) {
      cloud.rooms[k] = Math.ceil(length * 1.25);
      gl.bufferData(target, cloud.rooms[k], gl.DYNAMIC_DRAW);
    }
    gl.bufferSubData(target, 0, cloud.payload, from, length);
  }

  /** @param {Float32Array} extent x, y least and greatest [m] @param {Float32Array} colour */
  floor(extent, colour) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl), it = this.use("floor", this.clip, this.eye);
    gl.uniform4fv(it.at.u_extent, extent);
    gl.uniform4fv(it.at.u_colour, colour);
    this.flat();
  }

  /** @param {Picture} picture @param {Float32Array} extent left, top, right, bottom in -1..1 */
  picture(picture, extent) {
    if (!picture.pixels) return;
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl), it = this.use("picture", this.clip, this.eye);
    if (picture.generation !== this.generation) {
      picture.generation = this.generation;
      picture.texture = gl.createTexture();
      picture.shape = "";
      picture.stale = true;
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, picture.texture);
    if (picture.stale) this.load(picture);
    gl.uniform1i(it.at.u_texture, 0);
    gl.uniform1f(it.at.u_gray, picture.channels === 1 ? 1 : 0);
    gl.uniform4fv(it.at.u_extent, extent);
    gl.disable(gl.DEPTH_TEST);
    this.flat();
    gl.enable(gl.DEPTH_TEST);
  }

  /** @param {Picture} picture whose texture is bound */
  load(picture) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl), { width, height, channels, pixels } = picture;
    const format = channels === 1 ? gl.RED : gl.RGB, shape = `${width} ${height} ${channels}`;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (picture.shape === shape) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, format, gl.UNSIGNED_BYTE, pixels);
    else gl.texImage2D(gl.TEXTURE_2D, 0, channels === 1 ? gl.R8 : gl.RGB8, width, height, 0, format, gl.UNSIGNED_BYTE, pixels);
    for (const [what, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
                                 [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, what, value);
    }
    picture.shape = shape;
    picture.stale = false;
  }

  flat() {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    gl.bindVertexArray(null);
    gl.depthMask(false);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.depthMask(true);
  }
}

const eyeThere = new Float32Array(4);

/** The eye in the space of a model. @param {Float32Array} m @param {Float32Array} e */
function localEye(m, e) {
  const x = e[0] - m[12] * e[3], y = e[1] - m[13] * e[3], z = e[2] - m[14] * e[3];
  for (let k = 0; k < 3; k++) eyeThere[k] = m[k * 4] * x + m[k * 4 + 1] * y + m[k * 4 + 2] * z;
  eyeThere[3] = e[3];
  return eyeThere;
}

/** @param {WebGL2RenderingContext} gl @param {Kind} kind @returns {Program} */
function compiled(gl, kind) {
  const program = /** @type {WebGLProgram} */ (gl.createProgram());
  for (const [k, text] of SHADERS[kind].entries()) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(`${kind}: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(`${kind}: ${gl.getProgramInfoLog(program)}`);
  /** @type {Record<string, WebGLUniformLocation | null>} */ const at = {};
  const n = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0;
  for (let k = 0; k < n; k++) {
    const name = gl.getActiveUniform(program, k)?.name;
    if (name) at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}
