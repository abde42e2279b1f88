// @ts-check
// What the room knows: the newest message of each topic, where cameras stand, and the trails of targets.
import { Cloud } from "./gl.js";
import { Spaces, apply, fromPose, invertRigid, matrix } from "./space.js";

/** @typedef {{id: number, position: number[], covariance: number[], cameras: number[], provenance: string}} Target */
/** @typedef {{label: number, position: number[], covariance: number[], cameras: number[], provenance: string}} Mark */
/** @typedef {{topic: number, what: any, scale: number | null, time_s: number, message: any, fresh: boolean}} Newest */
/** @typedef {{times: Float64Array, places: Float64Array, n: number, at: number}} Trail */
/** @typedef {{cloud: Cloud, scale: number | null, time_s: number, pose: any}} Shape */

export const TRAIL_S = 3;
const TRAIL = 64;

/** Messages whose newest value is kept, and how they are subscribed. */
export const VALUES = ["targets", "marks", "skeletons", "scale_space", "head_pose", "sub_region"];
export const CLOUDS = ["point_cloud", "scale_cloud", "voxels", "tracked_surface"];

/** Of these a room may have several at once: what is recovered, what a simulation knows, what another node makes of the same. */
const STREAMS = ["targets", "marks", "skeletons"];

/**
 * Topics of targets, marks and skeletons, and the one of each scale that is shown at first: from the node that comes last on the way from pictures to results.
 * @param {any} hello
 */
export function streams(hello) {
  const rank = (/** @type {any} */ topic) => {
    const node = hello.nodes[hello.instances[topic.instance].node];
    if (node.type.startsWith("sim.")) return 0;
    return topic.port === "predicted" ? 1 : node.role === "model filter" ? 4 : node.role === "integrator" ? 3 : 2;
  };
  /** @type {Map<string, number>} */ const best = new Map();
  const all = hello.topics.map((/** @type {any} */ _, /** @type {number} */ id) => id).filter((/** @type {number} */ id) => STREAMS.includes(hello.topics[id].message));
  for (const id of all) {
    const { scale, message } = hello.topics[id], key = `${scale} ${message}`, other = best.get(key);
    if (other === undefined || rank(hello.topics[id]) > rank(hello.topics[other])) best.set(key, id);
  }
  return { all, main: new Set(best.values()) };
}

export class RoomData {
  /** @param {any} hello */
  constructor(hello) {
    this.hello = hello;
    this.spaces = new Spaces(hello.scales);
    this.streams = streams(hello);
    /** Of them, those that are shown. */
    this.chosen = new Set(this.streams.main);
    /** @type {Map<number, Newest>} */ this.newest = new Map();
    /** @type {Map<number, Shape>} */ this.shapes = new Map();
    /** @type {Map<string, Trail>} */ this.trails = new Map();
    this.cameras = hello.cameras.map((/** @type {any} */ it, /** @type {number} */ index) => {
      const camera = { index, name: String(it.name), lens: it, on_head: Boolean(it.on_head), placed: false, angles: /** @type {number[] | null} */ (null), from_world: matrix(), world_from: matrix() };
      if (it.camera_from_world && it.focal && it.principal && it.size) place(camera, it.camera_from_world);
      return camera;
    });
    this.time_s = NaN;
    this.turn = matrix();
    this.point = new Float64Array(3);
  }

  /** Whose coordinates the message of a topic is in: a scale, or null for the world. @param {any} topic */
  scaleOf(topic) {
    if (topic.owner === "scale") return topic.scale ?? null;
    if (topic.owner === "parent scale") return topic.scale == null ? null : this.hello.scales[topic.scale]?.parent ?? null;
    return null;
  }

  /** @param {{topic: number, kind: string, time_s: number, header: any, payload: Uint8Array}} frame */
  accept(frame) {
    const topic = this.hello.topics[frame.topic];
    if (!topic || (frame.kind === "value" && !this.wants(frame.topic))) return;
    if (frame.time_s < this.time_s - 1) this.trails.clear();
    this.time_s = frame.time_s;
    if (frame.kind === "points" || frame.kind === "mesh") this.shape(frame, topic);
    else if (frame.kind === "value") this.value(frame, topic);
  }

  /** Whether the messages of a topic are wanted. @param {number} topic */
  wants(topic) {
    return VALUES.includes(this.hello.topics[topic].message) && (this.chosen.has(topic) || !this.streams.all.includes(topic));
  }

  /** Shows a stream of targets, marks or skeletons, or not any more. @param {number} topic @param {boolean} is */
  stream(topic, is) {
    if (is) this.chosen.add(topic);
    else if (this.chosen.delete(topic)) this.newest.delete(topic);
  }

  /** @param {any} frame @param {any} topic */
  value(frame, topic) {
    const message = frame.header;
    if (topic.message === "scale_space") this.spaces.accept(message, frame.time_s);
    else if (topic.message === "head_pose") {
      const camera = this.cameras[message.camera];
      if (camera && message.camera_from_world) {
        place(camera, message.camera_from_world);
        camera.angles = message.angles ?? null;
      }
    } else {
      const it = this.newest.get(frame.topic);
      if (it) Object.assign(it, { time_s: frame.time_s, message, fresh: true });
      else this.newest.set(frame.topic, { topic: frame.topic, what: topic, scale: this.scaleOf(topic), time_s: frame.time_s, message, fresh: true });
    }
  }

  /** @param {any} frame @param {any} topic */
  shape(frame, topic) {
    const header = frame.header, mesh = frame.kind === "mesh";
    const kind = mesh ? "meshes" : header.size_m ? "voxels" : "points";
    let it = this.shapes.get(frame.topic);
    if (!it || it.cloud.kind !== kind) this.shapes.set(frame.topic, it = { cloud: new Cloud(kind), scale: null, time_s: 0, pose: null });
    it.cloud.size_m = header.size_m ?? 0;
    it.cloud.set(mesh ? header.vertices : header.n, frame.payload, mesh ? header.triangles * 3 : 0);
    it.scale = header.space === "scale" ? header.scale ?? topic.scale : null;
    it.pose = mesh ? header.pose : null;
    it.time_s = frame.time_s;
  }

  /** world from the space that a message lies in; null where that is not known yet. @param {Newest} it */
  worldFrom(it) {
    return this.spaces.matrix(this.turn, it.scale, it.time_s) ? this.turn : null;
  }

  /** The same of a cloud, into its model. @param {Shape} it */
  placeShape(it) {
    if (it.pose) fromPose(this.turn, it.pose);
    else if (!this.spaces.matrix(this.turn, it.scale, it.time_s)) return false;
    it.cloud.model.set(this.turn);
    return true;
  }

  /** Where a target, by its identity, is in the world now. @param {number} id */
  target(id) {
    for (const it of this.newest.values()) {
      if (it.what.message !== "targets") continue;
      for (const target of it.message.list) {
        const world = target.id === id ? this.worldFrom(it) : null;
        if (world) return apply(this.point, world, target.position[0], target.position[1], target.position[2]);
      }
    }
    return null;
  }

  /** Adds where a target is to its trail. @param {string} key @param {number} time_s @param {Float64Array} place */
  trail(key, time_s, place) {
    let it = this.trails.get(key);
    if (!it) this.trails.set(key, it = { times: new Float64Array(TRAIL), places: new Float64Array(TRAIL * 3), n: 0, at: 0 });
    it.at = (it.at + 1) % TRAIL;
    it.n = Math.min(it.n + 1, TRAIL);
    it.times[it.at] = time_s;
    it.places.set(place, it.at * 3);
  }

  /** Forgets trails that have ended. */
  sweep() {
    for (const [key, it] of this.trails) if (this.time_s - it.times[it.at] > TRAIL_S) this.trails.delete(key);
  }
}

/** @param {any} camera @param {import("./space.js").Pose} pose */
function place(camera, pose) {
  fromPose(camera.from_world, pose);
  invertRigid(camera.world_from, camera.from_world);
  camera.placed = true;
}
