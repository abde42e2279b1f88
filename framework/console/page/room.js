// @ts-check
// The room in 3D: cameras, targets, marks, spaces and surfaces of all scales.
import { make } from "./dom.js";
import { Picture, Renderer } from "./gl.js";
import { servedCameras } from "./lookup.js";
import { CLOUDS, RoomData } from "./room_data.js";
import { Eye, bindHands } from "./room_eye.js";
import { Labels } from "./room_labels.js";
import { keepParts, keptParts, sideList } from "./room_list.js";
import { palette as paletteOf } from "./room_palette.js";
import { STYLE } from "./room_style.js";
import { Things } from "./room_things.js";
import { toolRow } from "./room_tools.js";

const VALUE_HZ = 15, SHAPE_HZ = 5, STEP = Math.PI / 36, KEPT_TIMES = 240;
const NO_WEBGL = "This browser has no WebGL 2, so the room cannot be drawn. The list still shows every target and mark.";

/** Pictures drawn and the milliseconds of script that each took, for tests. @type {{frames: number, script_ms: number[]}} */
const stats = { frames: 0, script_ms: [] };

/** @type {import("./main.js").ViewModule & {stats: typeof stats}} */
export const view = { id: "room", title: "Room", key: "2", stats, create: (context) => new Room(context).view() };

class Room {
  /** @param {import("./main.js").Context} context */
  constructor(context) {
    this.context = context;
    this.data = new RoomData(context.hello);
    this.shown = keptParts();
    this.canvas = make("canvas", { tabindex: "0", role: "application", "aria-label": "The room in 3D. Arrows turn it, + and - come nearer, Home shows all." });
    const names = make("canvas", { class: "room-names", "aria-hidden": "true" });
    this.absent = make("p", { class: "room-absent", hidden: true }, NO_WEBGL);
    this.stage = make("div", { class: "room-stage" }, this.canvas, names, this.absent);
    this.eye = new Eye();
    this.labels = new Labels(names);
    this.things = new Things(this.data, this.labels);
    this.picture = new Picture();
    this.renderer = new Renderer(this.canvas, () => this.again());
    this.list = sideList(context, this.data, this.shown, { parts: () => this.parts(), choose: (what) => this.choose(what) });
    this.images = servedCameras(context.hello).map((it) => it.image);
    this.palette = paletteOf(context);
    this.theme = context.theme();
    this.picturePlace = { left: 0, top: 0, step: 1 };
    this.extent = new Float32Array(4);
    this.floor = new Float32Array([-5, -5, 5, 5]);
    this.gridColour = new Float32Array(4);
    this.fresh = true;
    this.moved = true;
    this.fitted = false;
    this.follows = false;
    this.wasThrough = false;
    this.side = "";
    this.was = { camera: NaN, target: NaN, mark: NaN };
    this.spent = 0;
    this.pixel = 1;
    this.reported = 0;
    this.times = new Float64Array(KEPT_TIMES);
    this.points = new Float64Array(0);
    this.n_points = 0;
    this.absent.hidden = this.renderer.works;
    this.tools = toolRow({ fit: () => this.fit(), along: (axis) => this.along(axis), parallel: () => this.parallel(), through: () => this.through(), follow: () => this.follow(),
                           list: () => this.toggleList() }, { works: this.renderer.works, list: this.shown.list });
    this.element = make("div", { class: "room" }, make("style", {}, STYLE), make("div", { class: "room-main" }, this.tools.element, this.stage), this.list.element);
    this.list.element.hidden = !this.shown.list;
    this.width = this.height = 0;
    new ResizeObserver(([{ contentRect }]) => {
      this.width = Math.round(contentRect.width);
      this.height = Math.round(contentRect.height);
      this.again();
    }).observe(this.stage);
    bindHands(this.canvas, this.eye, () => this.turned(), (x, y, within) => this.click(x, y, within));
    this.measure();
    this.colours();
  }

  /** @returns {import("./main.js").View} */
  view() {
    return {
      element: this.element,
      wants: () => this.wants(),
      frame: (frame) => this.accept(frame),
      state() {},
      draw: (now_ms) => this.draw(now_ms),
      show: () => this.again(),
      hide() {},
      key: (event) => this.key(event),
      help: [
        ["drag, arrows", "turn"], ["shift-drag, shift-arrows", "move sideways"], ["wheel, + -", "nearer, farther"], ["Home", "show all"],
        ["x y z", "look along an axis; again: from the other side"], ["o", "perspective or parallel"], ["c", "look through the chosen camera"],
        ["[ ]", "previous, next camera"], ["t", "follow the chosen target"], ["l", "list"], ["click", "choose a target, mark or camera"], ["Escape", "back"],
      ],
    };
  }

  wants() {
    const { chosen, hello } = this.context;
    /** @type {import("./main.js").Subscription[]} */ const list = [];
    for (const [topic, it] of hello.topics.entries()) {
      if (this.data.wants(topic)) list.push({ topic, as: "value", hz: VALUE_HZ });
      else if (it.message === "features" && it.camera != null && it.camera === chosen.camera && this.shown.rays) list.push({ topic, as: "value", hz: VALUE_HZ });
      else if (CLOUDS.includes(it.message) && this.shown.clouds) list.push({ topic, as: "points", hz: SHAPE_HZ });
      else if (it.message === "mesh" && this.shown.meshes) list.push({ topic, as: "mesh", hz: SHAPE_HZ });
    }
    const image = this.eye.through && chosen.camera != null ? this.images[chosen.camera] : null;
    if (image != null) list.push({ topic: image, as: "picture", width: 1280, hz: VALUE_HZ });
    return list;
  }

  /** @param {import("./link.js").Frame} frame */
  accept(frame) {
    const start = performance.now();
    if (frame.kind === "picture") this.takePicture(frame);
    else this.data.accept(frame);
    this.list.touch(false);
    this.fresh = true;
    this.spent += performance.now() - start;
  }

  /** @param {import("./link.js").Frame} frame */
  takePicture({ topic, header, payload }) {
    if (this.context.chosen.camera == null || topic !== this.images[this.context.chosen.camera]) return;
    this.picture.set(header.width, header.height, header.channels, payload);
    this.picturePlace.left = header.window?.left ?? 0;
    this.picturePlace.top = header.window?.top ?? 0;
    this.picturePlace.step = (header.window?.shrink ?? 1) * (header.factor ?? 1);
  }

  /** @param {number} now_ms */
  draw(now_ms) {
    const start = performance.now();
    this.compare();
    const is = this.fresh || this.moved;
    if (is && this.size()) this.picture3d();
    this.list.update(now_ms);
    const done = performance.now();
    if (is) {
      stats.script_ms[stats.frames++ % KEPT_TIMES] = done - start + this.spent;
      this.spent = 0;
    }
    if (now_ms - this.reported >= 500) this.report(now_ms);
  }

  /** Sees what others changed: the choice, the theme. */
  compare() {
    const { chosen } = this.context, { was } = this;
    if (this.theme !== this.context.theme()) {
      this.theme = this.context.theme();
      this.palette = paletteOf(this.context);
      this.colours();
      this.again();
    }
    if (was.camera === chosen.camera && was.target === chosen.target && was.mark === chosen.mark) return;
    if (was.camera !== chosen.camera) {
      this.picture.pixels = null;
      for (const [topic, it] of this.data.newest) if (it.what.message === "features") this.data.newest.delete(topic);
      if (this.eye.through && chosen.camera == null) this.leave();
      else if (this.eye.through) this.lookThrough();
      this.context.changed();
    }
    Object.assign(was, chosen);
    this.list.touch(true);
    this.again();
  }

  /** Gives the canvases the size of their place; false where there is none. */
  size() {
    const names = this.labels.canvas;
    if (this.width < 1 || this.height < 1) return false;
    this.pixel = Math.min(window.devicePixelRatio || 1, 2);
    const wide = Math.round(this.width * this.pixel), high = Math.round(this.height * this.pixel);
    if (this.canvas.width !== wide || this.canvas.height !== high) {
      for (const canvas of [this.canvas, names]) {
        canvas.width = wide;
        canvas.height = high;
      }
      this.moved = true;
    }
    return true;
  }

  picture3d() {
    const { eye, renderer, things, context, shown, palette } = this;
    if (!this.fitted) {
      this.fitted = true;
      this.fit();
    }
    if (this.fresh) {
      if (this.follows) this.stepAfter();
      things.through = eye.through != null;
      things.build(shown, palette, context.chosen);
    }
    this.fresh = this.moved = false;
    eye.update(this.canvas.width, this.canvas.height);
    if (!renderer.works || renderer.lost) return;
    renderer.begin(palette.rgb.ground, eye.clip, eye.stand, this.pixel, eye.metre_px);
    if (eye.through) this.behind();
    if (shown.floor) renderer.floor(this.floor, this.gridColour);
    for (const it of this.data.shapes.values()) {
      if (!(it.cloud.kind === "meshes" ? shown.meshes : shown.clouds) || !this.data.placeShape(it)) continue;
      renderer.cloud(it.cloud);
    }
    renderer.lines(things.lines);
    renderer.sprites(things.sprites);
    if (shown.names) this.labels.paint(eye.clip, this.width, this.height, this.pixel);
    else this.labels.wipe();
  }

  /** The camera's own picture, where the camera sees it. */
  behind() {
    const at = this.eye.rectangle, { left, top, step } = this.picturePlace, { width, height } = this.canvas;
    const x = at.left + left * at.scale, y = at.top + top * at.scale;
    this.extent[0] = 2 * x / width - 1;
    this.extent[1] = 1 - 2 * y / height;
    this.extent[2] = 2 * (x + this.picture.width * step * at.scale) / width - 1;
    this.extent[3] = 1 - 2 * (y + this.picture.height * step * at.scale) / height;
    this.renderer.picture(this.picture, this.extent);
  }

  again() {
    this.fresh = this.moved = true;
  }

  turned() {
    this.moved = true;
    const through = this.eye.through != null;
    if (this.wasThrough !== through) {
      this.fresh = true;
      this.context.changed();
    }
    this.wasThrough = through;
    this.press();
  }

  press() {
    this.tools.write({ parallel: this.eye.parallel, through: this.eye.through != null, follow: this.follows, list: this.shown.list });
  }

  /** The points that the whole view takes in. */
  measure() {
    /** @type {number[]} */ const list = [];
    for (const it of this.data.cameras) if (it.placed) list.push(...it.world_from.subarray(12, 15));
    for (const { volume_m } of this.context.hello.scales) {
      if (volume_m) for (let k = 0; k < 8; k++) list.push(volume_m[k & 1][0], volume_m[k >> 1 & 1][1], volume_m[k >> 2][2]);
    }
    if (list.length < 6) list.push(-1, -1, 0, 1, 1, 1);
    this.points = Float64Array.from(list);
    this.n_points = list.length / 3;
    for (let side = 0; side < 2; side++) {
      const values = list.filter((_, k) => k % 3 === side);
      this.floor[side] = Math.floor(Math.min(...values)) - 1;
      this.floor[side + 2] = Math.ceil(Math.max(...values)) + 1;
    }
    const low = [0, 1, 2].map((r) => Math.min(...list.filter((_, k) => k % 3 === r)));
    const reach = Math.hypot(...low.map((it, r) => Math.max(...list.filter((_, k) => k % 3 === r)) - it));
    this.things.reach = Math.min(6, Math.max(0.3, reach * 0.5));
    this.things.size = Math.min(0.4, Math.max(0.02, reach * 0.035));
  }

  colours() {
    const { palette } = this, [r, g, b] = palette.rgb.grid;
    this.gridColour.set([r / 255, g / 255, b / 255, palette.light ? 0.5 : 0.55]);
    this.labels.ground = palette.cover;
    this.labels.font = `12px ${getComputedStyle(document.body).fontFamily || "sans-serif"}`;
    this.labels.widths.clear();
    for (const name of ["ground", "Measured", "Predicted", "Filled", "mark", "head"]) this.element.style.setProperty(`--r-${name}`, palette.css[name]);
  }

  fit() {
    this.leave();
    this.follows = false;
    this.eye.fit(this.points, this.n_points, Math.max(this.canvas.width, 1), Math.max(this.canvas.height, 1));
    this.turned();
  }

  /** @param {"x" | "y" | "z"} axis */
  along(axis) {
    this.leave();
    const other = this.side === axis, { eye } = this;
    this.side = other ? "" : axis;
    eye.pitch = axis === "z" ? (other ? -Math.PI / 2 : Math.PI / 2) : 0;
    eye.yaw = axis === "x" ? (other ? Math.PI : 0) : axis === "y" ? (other ? Math.PI / 2 : -Math.PI / 2) : -Math.PI / 2;
    this.turned();
  }

  parallel() {
    this.leave();
    this.eye.parallel = !this.eye.parallel;
    this.turned();
  }

  through() {
    if (this.eye.through) return this.leave();
    if (this.context.chosen.camera == null) this.next(1);
    this.lookThrough();
    return true;
  }

  lookThrough() {
    const it = this.data.cameras[this.context.chosen.camera ?? -1];
    if (!it?.placed) return void this.context.say("That camera's place is not known, so there is no look through it.");
    this.eye.through = it;
    this.eye.zoom = 1;
    this.eye.shift = [0, 0];
    this.turned();
    this.again();
  }

  leave() {
    if (!this.eye.leave()) return false;
    this.turned();
    return true;
  }

  /** @param {number} by */
  next(by) {
    const n = this.data.cameras.length;
    if (n) this.choose({ camera: ((this.context.chosen.camera ?? (by > 0 ? -1 : 0)) + by + n) % n });
  }

  follow() {
    if (!this.follows && this.context.chosen.target == null) return this.context.say("Choose a target first: click it in the room or in the list.");
    this.follows = !this.follows;
    if (this.follows) this.leave();
    this.again();
    this.press();
  }

  stepAfter() {
    const { target } = this.context.chosen, place = target == null ? null : this.data.target(target);
    if (place) this.eye.centre.set(place);
    if (target != null) return;
    this.follows = false;
    this.press();
  }

  /** @param {number} x @param {number} y @param {number} within px */
  click(x, y, within) {
    const it = this.things.nearest(this.eye.clip, this.width, this.height, x, y, within);
    this.choose(it ? { [it.what]: it.id } : { target: null, mark: null });
  }

  /** @param {Partial<import("./main.js").Chosen>} what */
  choose(what) {
    this.context.choose({ ...this.context.chosen, ...what });
    this.again();
  }

  parts() {
    keepParts(this.shown);
    this.context.changed();
    this.again();
  }

  toggleList() {
    this.shown.list = !this.shown.list;
    this.list.element.hidden = !this.shown.list;
    this.press();
    this.parts();
  }

  /** One step back; false where there is none. */
  back() {
    if (this.leave()) return true;
    const { camera, target, mark } = this.context.chosen;
    if (this.follows) this.follow();
    else if (camera == null && target == null && mark == null) return false;
    else this.choose({ camera: null, target: null, mark: null });
    return true;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const arrow = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] })[event.key];
    const inList = event.target instanceof Node && this.list.element.contains(event.target);
    if (arrow && !inList) {
      if (event.shiftKey) this.eye.pan(-arrow[0] * 0.05, -arrow[1] * 0.05);
      else this.eye.turn(-arrow[0] * STEP, arrow[1] * STEP);
      this.turned();
      return true;
    }
    const act = /** @type {Record<string, () => any>} */ ({
      "+": () => this.nearer(1.2), "=": () => this.nearer(1.2), "-": () => this.nearer(1 / 1.2), Home: () => this.fit(),
      x: () => this.along("x"), y: () => this.along("y"), z: () => this.along("z"), o: () => this.parallel(), c: () => this.through(),
      "[": () => this.next(-1), "]": () => this.next(1), t: () => this.follow(), l: () => this.toggleList(),
    })[event.key];
    if (event.key === "Escape") return this.back();
    if (!act || (inList && event.key === "Home")) return false;
    act();
    return true;
  }

  /** @param {number} factor */
  nearer(factor) {
    this.eye.nearer(factor, 0, 0);
    this.turned();
  }

  /** @param {number} now_ms */
  report(now_ms) {
    this.reported = now_ms;
    this.element.dataset.frames = String(stats.frames);
    const n = Math.min(60, stats.frames, KEPT_TIMES);
    if (n === 0) return;
    const last = this.times.subarray(0, n);
    for (let k = 0; k < n; k++) last[k] = stats.script_ms[(stats.frames - 1 - k) % KEPT_TIMES];
    last.sort();
    this.element.dataset.scriptMs = last[n >> 1].toFixed(2);
  }
}
