// @ts-check
// Poses, projections, ellipsoids and the spaces of scales over time. Matrices are 4x4, column by column; results go into arrays that the
// caller owns, so that nothing is allocated while pictures are drawn.

/** @typedef {{rotation: number[], translation: number[]}} Pose */
/** @typedef {Float64Array} Matrix */

/** @returns {Matrix} the identity */
export function matrix() {
  const m = new Float64Array(16);
  m[0] = m[5] = m[10] = m[15] = 1;
  return m;
}

/** @param {Matrix} out @param {Pose} pose rotation as [x, y, z, w] */
export function fromPose(out, pose) {
  const [x, y, z, w] = pose.rotation, t = pose.translation;
  out[0] = 1 - 2 * (y * y + z * z); out[1] = 2 * (x * y + z * w); out[2] = 2 * (x * z - y * w); out[3] = 0;
  out[4] = 2 * (x * y - z * w); out[5] = 1 - 2 * (x * x + z * z); out[6] = 2 * (y * z + x * w); out[7] = 0;
  out[8] = 2 * (x * z + y * w); out[9] = 2 * (y * z - x * w); out[10] = 1 - 2 * (x * x + y * y); out[11] = 0;
  out[12] = t[0]; out[13] = t[1]; out[14] = t[2]; out[15] = 1;
  return out;
}

/** @param {Matrix} out not one of the factors @param {Matrix} a @param {Matrix} b */
export function multiply(out, a, b) {
  for (let c = 0; c < 16; c += 4) {
    for (let r = 0; r < 4; r++) out[c + r] = a[r] * b[c] + a[4 + r] * b[c + 1] + a[8 + r] * b[c + 2] + a[12 + r] * b[c + 3];
  }
  return out;
}

/** @param {Matrix} out not `m` @param {Matrix} m a rotation and a translation */
export function invertRigid(out, m) {
  for (let c = 0; c < 3; c++) {
    for (let r = 0; r < 3; r++) out[c * 4 + r] = m[r * 4 + c];
    out[c * 4 + 3] = 0;
  }
  for (let r = 0; r < 3; r++) out[12 + r] = -(m[r * 4] * m[12] + m[r * 4 + 1] * m[13] + m[r * 4 + 2] * m[14]);
  out[15] = 1;
  return out;
}

/** @param {Float64Array} out @param {Matrix} m @param {number} x @param {number} y @param {number} z */
export function apply(out, m, x, y, z) {
  out[0] = m[0] * x + m[4] * y + m[8] * z + m[12];
  out[1] = m[1] * x + m[5] * y + m[9] * z + m[13];
  out[2] = m[2] * x + m[6] * y + m[10] * z + m[14];
  return out;
}

/**
 * Where a point lies in the picture, -1..1 to the right and up; false behind the eye.
 * @param {Float64Array} out @param {Matrix} clip @param {number} x @param {number} y @param {number} z
 */
export function project(out, clip, x, y, z) {
  const w = clip[3] * x + clip[7] * y + clip[11] * z + clip[15];
  const depth = clip[2] * x + clip[6] * y + clip[10] * z + clip[14];
  if (!(depth + w > 0) || !(w > 0)) return false;
  out[0] = (clip[0] * x + clip[4] * y + clip[8] * z + clip[12]) / w;
  out[1] = (clip[1] * x + clip[5] * y + clip[9] * z + clip[13]) / w;
  out[2] = depth / w;
  return true;
}

/** @param {Matrix} out @param {number} tan_x @param {number} tan_y half the field of view @param {number} near @param {number} far */
export function perspective(out, tan_x, tan_y, near, far) {
  out.fill(0);
  out[0] = 1 / tan_x; out[5] = 1 / tan_y;
  out[10] = -(far + near) / (far - near); out[11] = -1; out[14] = -2 * far * near / (far - near);
  return out;
}

/** @param {Matrix} out @param {number} half_x @param {number} half_y @param {number} near @param {number} far [m] */
export function orthographic(out, half_x, half_y, near, far) {
  out.fill(0);
  out[0] = 1 / half_x; out[5] = 1 / half_y; out[10] = -2 / (far - near); out[14] = -(far + near) / (far - near); out[15] = 1;
  return out;
}

/**
 * What a real camera sees, its picture laid onto `rectangle` of a canvas.
 * @param {Matrix} out @param {{focal: number[], principal: number[], size: number[]}} camera
 * @param {{left: number, top: number, scale: number}} rectangle corner of the picture and canvas pixels for one of its pixels
 * @param {number} width @param {number} height of the canvas @param {number} near @param {number} far
 */
export function pinhole(out, camera, rectangle, width, height, near, far) {
  const { left, top, scale } = rectangle;
  perspective(out, 1, 1, near, far);
  out[0] = 2 * scale * camera.focal[0] / width;
  out[5] = 2 * scale * camera.focal[1] / height;
  // The centre of pixel 0 is at 0: the picture begins at -0.5.
  out[8] = 1 - 2 * (left + scale * (camera.principal[0] + 0.5)) / width;
  out[9] = 2 * (top + scale * (camera.principal[1] + 0.5)) / height - 1;
  return out;
}

const symmetric = new Float64Array(9), vectors = new Float64Array(9);

/**
 * Eigenvalues (diagonal of `a`) and eigenvectors (columns of `v`) of a symmetric 3x3 matrix by rotations of Jacobi.
 * @param {Float64Array} a changed @param {Float64Array} v
 */
export function eigen(a, v) {
  v.fill(0);
  v[0] = v[4] = v[8] = 1;
  for (let sweep = 0; sweep < 12; sweep++) {
    const off = Math.abs(a[3]) + Math.abs(a[6]) + Math.abs(a[7]);
    if (!(off > 1e-14 * (Math.abs(a[0]) + Math.abs(a[4]) + Math.abs(a[8])))) return;
    for (let p = 0; p < 2; p++) for (let q = p + 1; q < 3; q++) rotate(a, v, p, q);
  }
}

/** @param {Float64Array} a @param {Float64Array} v @param {number} p @param {number} q */
function rotate(a, v, p, q) {
  const apq = a[q * 3 + p];
  if (apq === 0) return;
  const theta = (a[q * 4] - a[p * 4]) / (2 * apq);
  const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
  const c = 1 / Math.sqrt(t * t + 1), s = t * c;
  for (let k = 0; k < 3; k++) {
    const kp = a[p * 3 + k], kq = a[q * 3 + k];
    a[p * 3 + k] = c * kp - s * kq;
    a[q * 3 + k] = s * kp + c * kq;
  }
  for (let k = 0; k < 3; k++) {
    const pk = a[k * 3 + p], qk = a[k * 3 + q];
    a[k * 3 + p] = c * pk - s * qk;
    a[k * 3 + q] = s * pk + c * qk;
    const vp = v[p * 3 + k], vq = v[q * 3 + k];
    v[p * 3 + k] = c * vp - s * vq;
    v[q * 3 + k] = s * vp + c * vq;
  }
}

/**
 * The half axes of the ellipsoid of `sigmas` standard deviations, turned by `turn` into the world: three vectors one after another.
 * @param {Float64Array} out nine numbers @param {number[] | null | undefined} covariance column by column
 * @param {number} stride numbers in a column: 3, or 6 where position and velocity stand together @param {Matrix} turn @param {number} sigmas
 */
export function ellipsoid(out, covariance, stride, turn, sigmas) {
  let sum = 0;
  for (let c = 0; c < 3; c++) {
    for (let r = 0; r < 3; r++) sum += symmetric[c * 3 + r] = covariance ? (covariance[c * stride + r] + covariance[r * stride + c]) / 2 : 0;
  }
  if (!Number.isFinite(sum)) symmetric.fill(0);
  eigen(symmetric, vectors);
  for (let k = 0; k < 3; k++) {
    const length = sigmas * Math.sqrt(Math.max(symmetric[k * 4], 0));
    const x = vectors[k * 3] * length, y = vectors[k * 3 + 1] * length, z = vectors[k * 3 + 2] * length;
    for (let r = 0; r < 3; r++) out[k * 3 + r] = turn[r] * x + turn[4 + r] * y + turn[8 + r] * z;
  }
  return out;
}

/** The root of the mean variance over the three axes [m]. @param {number[] | null | undefined} covariance @param {number} stride */
export function sigma(covariance, stride) {
  return covariance ? Math.sqrt(Math.max(covariance[0] + covariance[stride + 1] + covariance[2 * (stride + 1)], 0) / 3) : NaN;
}

const KEPT = 16;

/** Where the spaces of scales were in the last moments: what is shown of one time is placed by the space of that time. */
export class Spaces {
  /** @param {{parent: number | null, anchor: string | null}[]} scales */
  constructor(scales) {
    this.scales = scales;
    this.past = scales.map(() => Array.from({ length: KEPT }, () => ({ time_s: NaN, target: /** @type {number | null} */ (null), pose: matrix() })));
    this.newest = scales.map(() => -1);
    this.steps = [matrix(), matrix()];
  }

  /** @param {{scale: number, target: number | null, parent_from_scale: Pose}} message @param {number} time_s */
  accept(message, time_s) {
    const past = this.past[message.scale];
    if (!past) return;
    const place = this.newest[message.scale] = (this.newest[message.scale] + 1) % KEPT;
    past[place].time_s = time_s;
    past[place].target = message.target ?? null;
    fromPose(past[place].pose, message.parent_from_scale);
  }

  /** Whether a scale moves with a target. @param {number} scale */
  isAnchored(scale) {
    const it = this.scales[scale];
    return it != null && it.parent != null && it.anchor != null;
  }

  /** The target that carries a scale now; null: suspended, undefined: no space came yet. @param {number} scale */
  target(scale) {
    const newest = this.newest[scale];
    return newest >= 0 ? this.past[scale][newest].target : undefined;
  }

  /**
   * world from the space of a scale at a time (NaN: the newest); false where that is not known yet.
   * @param {Matrix} out @param {number | null} scale @param {number} time_s
   */
  matrix(out, scale, time_s) {
    const [chain, next] = this.steps;
    unit(chain);
    let at = scale;
    while (at != null && this.scales[at]) {
      if (this.isAnchored(at)) {
        const pose = this.near(at, time_s);
        if (!pose) return false;
        multiply(next, pose, chain);
        chain.set(next);
      }
      at = this.scales[at].parent;
    }
    out.set(chain);
    return true;
  }

  /** @param {number} scale @param {number} time_s */
  near(scale, time_s) {
    const newest = this.newest[scale];
    if (newest < 0) return null;
    let best = this.past[scale][newest];
    if (Number.isFinite(time_s)) {
      for (const it of this.past[scale]) if (Math.abs(it.time_s - time_s) < Math.abs(best.time_s - time_s)) best = it;
    }
    return best.pose;
  }
}

/** @param {Matrix} m */
export function unit(m) {
  m.fill(0);
  m[0] = m[5] = m[10] = m[15] = 1;
  return m;
}
