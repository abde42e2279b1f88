// @ts-check
// The eye of the room: where it stands, and how pointer and wheel move it.
import { invertRigid, matrix, multiply, orthographic, perspective, pinhole, project } from "./space.js";

const TAN = Math.tan(20 * Math.PI / 180), STEEP = Math.PI / 2;

/** @typedef {{focal: number[], principal: number[], size: number[]}} Lens */

export class Eye {
  constructor() {
    this.yaw = -Math.PI / 2;
    this.pitch = 0.4;
    this.distance = 6;
    this.centre = new Float64Array(3);
    this.parallel = false;
    /** @type {{lens: Lens, from_world: Float64Array} | null} the camera looked through */ this.through = null;
    this.zoom = 1;
    this.shift = [0, 0];
    this.reach = 10;
    this.rectangle = { left: 0, top: 0, scale: 1 };
    this.view = matrix();
    this.projection = matrix();
    this.clip = matrix();
    this.world = matrix();
    this.stand = new Float32Array(4);
    this.metre_px = 1;
  }

  /** Fills the matrices. @param {number} width @param {number} height of the canvas */
  update(width, height) {
    if (this.through) this.lookThrough(this.through, width, height);
    else this.orbit(width, height);
    multiply(this.clip, this.projection, this.view);
    invertRigid(this.world, this.view);
    this.metre_px = 0.5 * height * this.projection[5];
    const parallel = this.parallel && !this.through;
    for (let k = 0; k < 3; k++) this.stand[k] = this.world[(parallel ? 8 : 12) + k];
    this.stand[3] = parallel ? 0 : 1;
  }

  /** @param {number} width @param {number} height */
  orbit(width, height) {
    const cy = Math.cos(this.yaw), sy = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch), v = this.view, c = this.centre;
    v[0] = -sy; v[4] = cy; v[8] = 0;
    v[1] = -sp * cy; v[5] = -sp * sy; v[9] = cp;
    v[2] = cp * cy; v[6] = cp * sy; v[10] = sp;
    for (let r = 0; r < 3; r++) v[12 + r] = -(v[r] * c[0] + v[4 + r] * c[1] + v[8 + r] * c[2]);
    v[14] -= this.distance;
    const far = this.distance + 4 * this.reach, wide = TAN * width / height;
    if (this.parallel) orthographic(this.projection, wide * this.distance, TAN * this.distance, this.distance - 4 * this.reach, far);
    else perspective(this.projection, wide, TAN, Math.max(0.02 * Math.min(this.distance, this.reach), 0.002), far);
  }

  /** @param {{lens: Lens, from_world: Float64Array}} it @param {number} width @param {number} height */
  lookThrough({ lens, from_world }, width, height) {
    const scale = this.zoom * Math.min(width / lens.size[0], height / lens.size[1]), at = this.rectangle;
    at.scale = scale;
    at.left = (width - lens.size[0] * scale) / 2 + this.shift[0] * scale;
    at.top = (height - lens.size[1] * scale) / 2 + this.shift[1] * scale;
    this.view.set(from_world);
    // Cameras have y down and z forward, the eye of WebGL y up and z backward.
    for (let c = 0; c < 16; c += 4) {
      this.view[c + 1] = -from_world[c + 1];
      this.view[c + 2] = -from_world[c + 2];
    }
    pinhole(this.projection, lens, at, width, height, 0.02, 6 * this.reach);
  }

  /** @param {number} right @param {number} up in radians */
  turn(right, up) {
    this.leave();
    this.yaw -= right;
    this.pitch = Math.min(STEEP, Math.max(-STEEP, this.pitch + up));
  }

  /** Moves what is seen. @param {number} right @param {number} up in parts of the height of the view */
  pan(right, up) {
    const step = 2 * TAN * this.distance, v = this.view;
    this.leave();
    for (let k = 0; k < 3; k++) this.centre[k] -= step * (right * v[k * 4] + up * v[k * 4 + 1]);
  }

  /** @param {number} factor above 1: nearer @param {number} x @param {number} y of the place that stays, in canvas pixels from the middle */
  nearer(factor, x, y) {
    if (this.through) {
      const zoom = Math.min(16, Math.max(1, this.zoom * factor));
      const scale = this.rectangle.scale, grown = zoom / this.zoom;
      this.shift[0] += (x / scale) * (1 / grown - 1);
      this.shift[1] += (y / scale) * (1 / grown - 1);
      this.zoom = zoom;
      if (zoom === 1) this.shift = [0, 0];
    } else this.distance = Math.min(1000, Math.max(0.02, this.distance / factor));
  }

  /** Ends looking through a camera; the eye stays about where that camera stands. */
  leave() {
    if (!this.through) return false;
    const m = invertRigid(matrix(), this.through.from_world);
    this.through = null;
    this.zoom = 1;
    this.shift = [0, 0];
    const x = -m[8], y = -m[9], z = -m[10];
    this.pitch = Math.asin(Math.min(1, Math.max(-1, z)));
    if (Math.hypot(x, y) > 1e-6) this.yaw = Math.atan2(y, x);
    this.distance = Math.max(0.3, x * (m[12] - this.centre[0]) + y * (m[13] - this.centre[1]) + z * (m[14] - this.centre[2]));
    for (let k = 0; k < 3; k++) this.centre[k] = m[12 + k] + m[8 + k] * this.distance;
    return true;
  }

  /** Takes in all points. @param {Float64Array} points x, y, z one after another @param {number} n @param {number} width @param {number} height */
  fit(points, n, width, height) {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let k = 0; k < n * 3; k++) {
      low[k % 3] = Math.min(low[k % 3], points[k]);
      high[k % 3] = Math.max(high[k % 3], points[k]);
    }
    if (n === 0) [low.fill(-1), high.fill(1)];
    for (let k = 0; k < 3; k++) this.centre[k] = (low[k] + high[k]) / 2;
    this.reach = Math.max(0.5, Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]));
    // What is near counts for more in perspective, so the middle of the picture is not the middle of the points: a few steps find it.
    for (let step = 0; step < 4; step++) {
      this.distance = this.needed(points, n, width, height);
      this.update(width, height);
      let left = Infinity, right = -Infinity, bottom = Infinity, top = -Infinity;
      for (let k = 0; k < n * 3; k += 3) {
        if (!project(place, this.clip, points[k], points[k + 1], points[k + 2])) continue;
        left = Math.min(left, place[0]);
        right = Math.max(right, place[0]);
        bottom = Math.min(bottom, place[1]);
        top = Math.max(top, place[1]);
      }
      if (left <= right) this.pan(-(left + right) / 4 * width / height, -(bottom + top) / 4);
    }
    this.distance = this.needed(points, n, width, height);
  }

  /** The distance from which all points are seen. @param {Float64Array} points @param {number} n @param {number} width @param {number} height */
  needed(points, n, width, height) {
    this.update(width, height);
    const v = this.view, c = this.centre, wide = TAN * width / height;
    let distance = 0.3;
    for (let k = 0; k < n * 3; k += 3) {
      const x = points[k] - c[0], y = points[k + 1] - c[1], z = points[k + 2] - c[2];
      const right = Math.abs(v[0] * x + v[4] * y + v[8] * z), up = Math.abs(v[1] * x + v[5] * y + v[9] * z), near = v[2] * x + v[6] * y + v[10] * z;
      distance = Math.max(distance, (this.parallel ? 0 : near) + Math.max(right / wide, up / TAN) * 1.1);
    }
    return distance;
  }
}

const place = new Float64Array(3);

/**
 * Pointers and wheel on a canvas.
 * @param {HTMLElement} canvas @param {Eye} eye @param {() => void} moved @param {(x: number, y: number, within: number) => void} clicked in px of the page
 */
export function bindHands(canvas, eye, moved, clicked) {
  /** @type {Map<number, {x: number, y: number}>} */ const down = new Map();
  let travelled = 0, pans = false;
  canvas.addEventListener("pointerdown", (event) => {
    if (down.size === 0) travelled = 0;
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    pans = event.button === 2 || event.button === 1 || event.shiftKey;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    event.preventDefault();
  });
  canvas.addEventListener("pointermove", (event) => {
    const it = down.get(event.pointerId);
    if (!it) return;
    const dx = event.clientX - it.x, dy = event.clientY - it.y, height = canvas.clientHeight || 1;
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < 4) return;
    if (down.size === 2) {
      const other = [...down].find(([id]) => id !== event.pointerId)?.[1] ?? it;
      const before = Math.hypot(it.x - other.x, it.y - other.y), now = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (before > 8 && now > 8) eye.nearer(now / before, 0, 0);
      if (!eye.through) eye.pan(dx / height / 2, -dy / height / 2);
    } else if (pans) eye.pan(dx / height, -dy / height);
    else eye.turn(dx * 0.006, dy * 0.006);
    it.x = event.clientX;
    it.y = event.clientY;
    moved();
  });
  /** @param {PointerEvent} event */
  const up = (event) => {
    const it = down.get(event.pointerId);
    down.delete(event.pointerId);
    if (!it || down.size || travelled >= 4 || event.type !== "pointerup" || event.button !== 0) return;
    const box = canvas.getBoundingClientRect();
    clicked(event.clientX - box.left, event.clientY - box.top, event.pointerType === "touch" ? 22 : 12);
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = canvas.getBoundingClientRect(), dpr = box.width ? /** @type {HTMLCanvasElement} */ (canvas).width / box.width : 1;
    const lines = event.deltaMode === 1 ? 30 : 1;
    eye.nearer(Math.exp(-event.deltaY * lines * 0.0012), (event.clientX - box.left - box.width / 2) * dpr, (event.clientY - box.top - box.height / 2) * dpr);
    moved();
  }, { passive: false });
}
