// @ts-check
// From what the room knows to what is drawn: lines, ellipsoids, names, and the places that a click can choose.
import { AROUND, FILLED, Lines, RING, SQUARE, Sprites, faded } from "./gl.js";
import { TRAIL_S } from "./room_data.js";
import { apply, ellipsoid, fromPose, matrix, project, unit } from "./space.js";

const BONES = [[0, 1], [1, 2, 4, 6], [1, 3, 5, 7], [1, 8, 10, 12], [1, 9, 11, 13], [8, 9]];
const CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
const SIGMAS = 2, NO_AXES = new Float64Array(9);

/** @typedef {import("./room_data.js").RoomData} RoomData */
/** @typedef {import("./room_data.js").Newest} Newest */
/** @typedef {import("./room_labels.js").Labels} Labels */
/** @typedef {{what: "camera" | "target" | "mark", id: number, x: number, y: number, z: number}} Pick */

export class Things {
  /** @param {RoomData} data @param {Labels} labels */
  constructor(data, labels) {
    this.data = data;
    this.labels = labels;
    this.lines = new Lines();
    this.sprites = new Sprites();
    /** @type {Pick[]} */ this.picks = [];
    this.n_picks = 0;
    this.axes = new Float64Array(9);
    this.at = new Float64Array(3);
    this.past = new Float64Array(3);
    this.space = matrix();
    this.joints = new Float64Array(14 * 3);
    this.has = new Uint8Array(14);
    this.size = 0.2;
    this.reach = 4;
    this.through = false;
    this.ends = CORNERS.map(() => new Float64Array(3));
  }

  /**
   * @param {Record<string, boolean>} shown @param {import("./room_palette.js").Palette} palette
   * @param {{camera: number | null, target: number | null, mark: number | null}} chosen
   */
  build(shown, palette, chosen) {
    this.shown = shown;
    this.palette = palette;
    this.chosen = chosen;
    this.lines.clear();
    this.sprites.clear();
    this.labels.clear();
    this.n_picks = 0;
    if (shown.volumes) this.volumes(palette);
    if (shown.scales) this.scales(palette);
    if (shown.cameras) this.cameras(palette, chosen);
    for (const it of this.data.newest.values()) {
      const world = this.data.worldFrom(it);
      if (!world) continue;
      this.space.set(world);
      if (it.what.message === "targets") this.targets(it, palette, chosen);
      else if (it.what.message === "marks" && shown.marks) this.marks(it, palette, chosen);
      else if (it.what.message === "skeletons" && shown.skeletons) this.skeletons(it, palette);
      else if (it.what.message === "sub_region") this.region(it, palette);
      else if (it.what.message === "features" && shown.rays && it.message.camera === chosen.camera) this.rays(it, palette);
      it.fresh = false;
    }
    this.data.sweep();
    if (shown.trails) this.trails(palette);
    this.labels.arrange();
  }

  /** @param {any} palette */
  volumes(palette) {
    const tip = Math.min(1, this.reach / 8);
    this.cross(unit(this.space), tip, palette, 2, 0, 1);
    for (const [k, name] of ["x", "y", "z"].entries()) this.labels.add(k === 0 ? tip : 0, k === 1 ? tip : 0, k === 2 ? tip : 0, name, palette.css[name], 3);
    for (const scale of this.data.hello.scales) {
      if (!scale.volume_m) continue;
      const [low, high] = scale.volume_m, at = [[0, 0, 0], [0, 0, 0]];
      for (let axis = 0; axis < 3; axis++) {
        for (let corner = 0; corner < 4; corner++) {
          for (let r = 0; r < 3; r++) {
            const bit = r === (axis + 1) % 3 ? corner & 1 : corner >> 1;
            at[0][r] = r === axis ? low[r] : bit ? high[r] : low[r];
            at[1][r] = r === axis ? high[r] : bit ? high[r] : low[r];
          }
          this.lines.add(at[0][0], at[0][1], at[0][2], at[1][0], at[1][1], at[1][2], palette.volume, 1);
        }
      }
    }
  }

  /** Three axes. @param {Float64Array} m @param {number} length @param {any} palette @param {number} width @param {number} dash @param {number} alpha */
  cross(m, length, palette, width, dash, alpha) {
    for (const [k, name] of ["x", "y", "z"].entries()) {
      const c = k * 4;
      this.lines.add(m[12], m[13], m[14], m[12] + m[c] * length, m[13] + m[c + 1] * length, m[14] + m[c + 2] * length, faded(palette[name], alpha), width, dash);
    }
  }

  /** A sphere as three circles. @param {Float64Array} m @param {number[]} centre @param {number} radius @param {number} colour @param {number} dash */
  sphere(m, centre, radius, colour, dash) {
    const n = 48, { at, past } = this;
    for (let axis = 0; axis < 3; axis++) {
      for (let k = 0; k <= n; k++) {
        const c = Math.cos(k * 2 * Math.PI / n) * radius, s = Math.sin(k * 2 * Math.PI / n) * radius;
        apply(at, m, centre[0] + (axis === 0 ? 0 : c), centre[1] + (axis === 0 ? c : axis === 1 ? 0 : s), centre[2] + (axis === 2 ? 0 : s));
        if (k) this.lines.add(past[0], past[1], past[2], at[0], at[1], at[2], colour, 1, dash);
        past.set(at);
      }
    }
  }

  /** @param {any} palette */
  scales(palette) {
    const { spaces, hello } = this.data, zero = [0, 0, 0];
    for (const [k, scale] of hello.scales.entries()) {
      if (!spaces.isAnchored(k) || !spaces.matrix(this.space, k, NaN)) continue;
      const lost = spaces.target(k) == null, m = this.space, radius = scale.radius_m ?? 0.15;
      this.cross(m, radius, palette, 1.5, lost ? 4 : 0, lost ? 0.5 : 1);
      if (scale.radius_m) this.sphere(m, zero, radius, faded(palette.scale, lost ? 0.4 : 0.75), lost ? 4 : 0);
      this.labels.add(m[12], m[13], m[14] + radius, lost ? `${scale.name}: suspended` : scale.name, lost ? palette.css.dim : palette.css.scale, 1);
    }
  }

  /** @param {any} palette @param {any} chosen */
  cameras(palette, chosen) {
    for (const it of this.data.cameras) {
      if (!it.placed) continue;
      const is = it.index === chosen.camera, colour = is ? palette.chosen : it.on_head ? palette.head : palette.camera, m = it.world_from;
      if (!is || !this.through) this.pyramid(it, this.size, colour, is ? 2 : it.on_head ? 1.5 : 1, true);
      if (is) this.pyramid(it, this.reach, faded(palette.chosen, 0.45), 1, false);
      this.labels.add(m[12], m[13], m[14], it.name, is ? palette.css.chosen : palette.css.camera, is ? 0 : 2);
      this.pick("camera", it.index, m[12], m[13], m[14]);
    }
  }

  /** What a camera sees, to a depth. @param {any} camera @param {number} depth @param {number} colour @param {number} width @param {boolean} body */
  pyramid(camera, depth, colour, width, body) {
    const { lens, world_from: m } = camera, { ends, lines } = this;
    const deep = body ? depth * Math.min(1, 1.2 * lens.focal[0] / lens.size[0]) : depth;
    for (const [k, [x, y]] of CORNERS.entries()) {
      const u = (x + 1) / 2 * lens.size[0] - 0.5, v = (y + 1) / 2 * lens.size[1] - 0.5;
      apply(ends[k], m, (u - lens.principal[0]) / lens.focal[0] * deep, (v - lens.principal[1]) / lens.focal[1] * deep, deep);
    }
    for (let k = 0; k < 4; k++) {
      const a = ends[k], b = ends[(k + 1) % 4];
      lines.add(m[12], m[13], m[14], a[0], a[1], a[2], colour, width);
      lines.add(a[0], a[1], a[2], b[0], b[1], b[2], colour, width);
    }
    if (!body) return;
    // A roof shows which edge of the picture is the upper one.
    const [a, b] = ends, tip = 0.2 * deep;
    apply(this.at, m, 0, (-0.5 - lens.principal[1]) / lens.focal[1] * deep - tip, deep);
    lines.add(a[0], a[1], a[2], this.at[0], this.at[1], this.at[2], colour, width);
    lines.add(b[0], b[1], b[2], this.at[0], this.at[1], this.at[2], colour, width);
  }

  /** @param {Newest} it @param {any} palette */
  rays(it, palette) {
    const camera = this.data.cameras[it.message.camera];
    if (!camera?.placed) return;
    const m = camera.world_from, { focal, principal } = camera.lens;
    for (const { centre } of it.message.list) {
      const x = (centre[0] - principal[0]) / focal[0], y = (centre[1] - principal[1]) / focal[1], far = 1.6 * this.reach / Math.hypot(x, y, 1);
      apply(this.at, m, x * far, y * far, far);
      this.lines.add(m[12], m[13], m[14], this.at[0], this.at[1], this.at[2], faded(palette.ray, 0.55), 1);
      // From the camera itself its rays are points.
      if (this.through) this.sprites.add(this.at[0], this.at[1], this.at[2], NO_AXES, palette.ray, RING, 6);
    }
  }

  /** @param {string} provenance @param {any} palette @param {any} it @param {number} stride @param {number} least @param {boolean} chosen */
  spot(provenance, palette, it, stride, least, chosen) {
    const { at, axes } = this;
    apply(at, this.space, it.position[0], it.position[1], it.position[2]);
    ellipsoid(axes, it.covariance, stride, this.space, SIGMAS);
    const shape = provenance === "Predicted" ? RING : provenance === "Filled" ? SQUARE : FILLED;
    this.sprites.add(at[0], at[1], at[2], axes, palette[provenance] ?? palette.Measured, shape, shape === RING ? least + 1 : least);
    if (chosen) this.sprites.add(at[0], at[1], at[2], axes, palette.chosen, AROUND, least + 1);
  }

  /** @param {Newest} it @param {any} palette @param {any} chosen */
  targets(it, palette, chosen) {
    for (const target of it.message.list) {
      const is = target.id === chosen.target;
      if (this.shown?.targets) {
        this.spot(target.provenance, palette, target, 6, 4.5, is);
        this.labels.add(this.at[0], this.at[1], this.at[2], String(target.id), is ? palette.css.chosen : palette.css[target.provenance] ?? palette.css.ink, is ? 0 : 5);
        this.pick("target", target.id, this.at[0], this.at[1], this.at[2]);
      } else apply(this.at, this.space, target.position[0], target.position[1], target.position[2]);
      if (it.fresh) this.data.trail(`${it.topic}/${target.id}`, it.time_s, this.at);
    }
  }

  /** @param {Newest} it @param {any} palette @param {any} chosen */
  marks(it, palette, chosen) {
    if (it.message.world_from_marks) fromPose(this.space, it.message.world_from_marks);
    for (const mark of it.message.list) {
      const is = mark.label === chosen.mark;
      this.spot(mark.provenance, palette.marks, mark, 3, 3, is);
      if (is || this.shown?.mark_names) this.labels.add(this.at[0], this.at[1], this.at[2], String(mark.label), is ? palette.css.chosen : palette.css.mark, is ? 0 : 8);
      this.pick("mark", mark.label, this.at[0], this.at[1], this.at[2]);
    }
  }

  /** @param {Newest} it @param {any} palette */
  skeletons(it, palette) {
    const { joints, has, at, lines } = this;
    for (const skeleton of it.message.list) {
      has.fill(0);
      for (const joint of skeleton.joints) {
        if (joint.joint >= 14) continue;
        this.spot(joint.provenance, palette, joint, 6, 2.5, false);
        joints.set(at, joint.joint * 3);
        has[joint.joint] = joint.provenance === "Measured" ? 2 : 1;
      }
      for (const chain of BONES) {
        let from = -1;
        for (const to of chain) {
          if (!has[to]) continue;
          if (from >= 0) {
            const a = from * 3, b = to * 3, sure = has[from] + has[to] === 4;
            lines.add(joints[a], joints[a + 1], joints[a + 2], joints[b], joints[b + 1], joints[b + 2], palette.bone, 2.5, sure ? 0 : 5);
          }
          from = to;
        }
      }
      if (has[0]) this.labels.add(joints[0], joints[1], joints[2], `person ${skeleton.id}`, palette.css.bone, 4);
    }
  }

  /** The part that heads follow, and where each of them looks. @param {Newest} it @param {any} palette */
  region(it, palette) {
    const { at, lines } = this, { centre, radius } = it.message;
    if (this.shown?.regions) {
      this.sphere(this.space, centre, radius, palette.region, 0);
      apply(at, this.space, centre[0], centre[1], centre[2] + radius);
      this.labels.add(at[0], at[1], at[2], "sub-region", palette.css.region, 6);
    }
    if (!this.shown?.looks) return;
    apply(at, this.space, centre[0], centre[1], centre[2]);
    for (const camera of this.data.cameras) {
      if (!camera.on_head || !camera.placed) continue;
      const m = camera.world_from, far = m[8] * (at[0] - m[12]) + m[9] * (at[1] - m[13]) + m[10] * (at[2] - m[14]);
      if (far > 0) lines.add(m[12], m[13], m[14], m[12] + m[8] * far, m[13] + m[9] * far, m[14] + m[10] * far, faded(palette.head, 0.7), 1, 6);
    }
  }

  /** @param {any} palette */
  trails(palette) {
    const { data, lines } = this;
    for (const it of data.trails.values()) {
      const size = it.times.length, p = it.places;
      for (let k = 0; k + 1 < it.n; k++) {
        const to = (it.at - k + size) % size, from = (to - 1 + size) % size, age = data.time_s - it.times[from];
        if (age > TRAIL_S || it.times[to] - it.times[from] > 0.5) break;
        const a = from * 3, b = to * 3;
        lines.add(p[a], p[a + 1], p[a + 2], p[b], p[b + 1], p[b + 2], faded(palette.trail, 0.55 - 0.5 * age / TRAIL_S), 1.25);
      }
    }
  }

  /** @param {Pick["what"]} what @param {number} id @param {number} x @param {number} y @param {number} z */
  pick(what, id, x, y, z) {
    const it = this.picks[this.n_picks] ??= { what, id, x, y, z };
    it.what = what; it.id = id; it.x = x; it.y = y; it.z = z;
    this.n_picks++;
  }

  /**
   * What lies nearest to a place in the picture.
   * @param {Float64Array} clip @param {number} width @param {number} height @param {number} x @param {number} y @param {number} within px
   */
  nearest(clip, width, height, x, y, within) {
    let best = null, least = within;
    for (let k = 0; k < this.n_picks; k++) {
      const it = this.picks[k];
      if (!project(this.at, clip, it.x, it.y, it.z)) continue;
      const away = Math.hypot((this.at[0] + 1) * width / 2 - x, (1 - this.at[1]) * height / 2 - y);
      if (away < least) [best, least] = [it, away];
    }
    return best;
  }
}
