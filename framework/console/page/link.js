// @ts-check
// The page's link to the program: texts and frames one way, commands with their answers the other, and a new attempt when the link is gone.

/** @typedef {{rotation: [number, number, number, number], translation: [number, number, number]}} Pose */
/** @typedef {{name: string, kind: "integer"|"number"|"boolean"|"text"|"choice"|"json", unit: string|null, help: string, value: any, default: any, min: number|null, max: number|null, choices: string[]|null, live: boolean}} Setting */
/** @typedef {{name: string, type: string, role: string, summary: string, scale: number, instances: number[], settings: Setting[]}} RigNode */
/** @typedef {{path: string, node: number, camera: number|null}} Instance */
/** @typedef {{path: string, instance: number, port: string, message: string, camera: number|null, scale: number, owner: string, unit: string, portable: boolean}} Topic */
/** @typedef {{age_ms: number|null, rate_hz: number|null, sigma: number|null, loss: number|null}} Requirement */
/** @typedef {{name: string, from: [number, number], to: [number, number], topic: number, input: string, feedback: boolean, require: Requirement|null}} Edge */
/** @typedef {{name: string, size: [number, number], focal: [number, number], principal: [number, number], on_head: boolean, camera_from_world: Pose}} Camera */
/** @typedef {{name: string, parent: number|null, anchor: string|null, volume_m: [number[], number[]]|null, radius_m: number|null}} Scale */
/** @typedef {{pause: boolean, step: boolean, seek: boolean, loop: boolean, speed: boolean, save: boolean, record: boolean, correct: boolean, set: boolean, bookmark: boolean, stop: boolean}} Can */
/** @typedef {{say: "hello", version: number, rig: {name: string, path: string, mode: string, duration_s: number|null, can: Can}, scales: Scale[], cameras: Camera[], nodes: RigNode[], instances: Instance[], topics: Topic[], edges: Edge[], budgets: {from: string, to: string, age_ms: number}[]}} Hello */
/** @typedef {[number, number|null, number|null, boolean, number|null, number|null, number|null, number|null, number|null, number|null]} EdgeState Of a session, most is not known. */
/** @typedef {{say: "state", phase: string, now_s: number, wall_s: number|null, speed: number|null, viewers: number, edges: EdgeState[], faults: {who: string, what: string, at_s: number}[], n_faults: number, recording: {path: string}|null, unsaved: string[], span_s?: [number, number], loop?: [number, number]|null}} State */
/** @typedef {{topic: number, kind: "value"|"picture"|"points"|"mesh", time_s: number, sequence: number, source: number, header: any, payload: Uint8Array}} Frame */
/** @typedef {{ok: boolean, words: string}} Answer */
/** @typedef {{topic: number, as: "value"|"picture"|"points"|"mesh", width?: number, hz: number}} Subscription */

/**
 * @typedef {object} Heard
 * @property {(hello: Hello) => void} hello
 * @property {(state: State) => void} state
 * @property {(node: number, values: Record<string, any>) => void} settings
 * @property {(name: string, value: any) => void} sheet
 * @property {(words: string) => void} refused The program shows nothing to this window.
 * @property {(frame: Frame) => void} frame
 * @property {() => void} lost
 */

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4000;
const ANSWER_WITHIN_MS = 10_000;
const HEAD_BYTES = 32;
const KINDS = /** @type {const} */ ([null, "value", "picture", "points", "mesh"]);
const utf8 = new TextDecoder();

/**
 * A binary frame, its payload not copied. Null for what is none: another version's, or cut short.
 * @param {ArrayBuffer} buffer
 * @returns {Frame|null}
 */
export function decode(buffer) {
  if (buffer.byteLength < HEAD_BYTES) return null;
  const view = new DataView(buffer);
  const kind = KINDS[view.getUint32(4, true)];
  const length = view.getUint32(28, true);
  if (!kind || HEAD_BYTES + length > buffer.byteLength) return null;
  let header;
  try {
    header = JSON.parse(utf8.decode(new Uint8Array(buffer, HEAD_BYTES, length)));
  } catch {
    return null;
  }
  return {
    topic: view.getUint32(0, true),
    kind,
    time_s: view.getFloat64(8, true),
    sequence: view.getFloat64(16, true),
    source: view.getUint32(24, true),
    header,
    payload: new Uint8Array(buffer, HEAD_BYTES + length),
  };
}

/** @param {Heard} heard */
export function connect(heard) {
  /** @type {WebSocket|null} */
  let socket = null;
  let wait = FIRST_WAIT_MS;
  let next = 1;
  /** @type {Map<number, (answer: Answer) => void>} */
  const asked = new Map();

  /** @param {number} n @param {Answer} answer */
  function settle(n, answer) {
    asked.get(n)?.(answer);
    asked.delete(n);
  }

  /** @param {string} text */
  function take(text) {
    let words;
    try {
      words = JSON.parse(text);
    } catch {
      return;
    }
    if (words?.say === "hello") heard.hello(words);
    else if (words?.say === "state") heard.state(words);
    else if (words?.say === "settings") heard.settings(words.node, words.values ?? {});
    else if (words?.say === "sheet") heard.sheet(String(words.name), words.value);
    else if (words?.say === "refused") heard.refused(String(words.words ?? ""));
    else if (words?.say === "answer") settle(words.n, { ok: Boolean(words.ok), words: String(words.words ?? "") });
  }

  function open() {
    const opened = new WebSocket(new URL("socket", location.href).href.replace(/^http/, "ws"));
    opened.binaryType = "arraybuffer";
    socket = opened;
    opened.onopen = () => {
      wait = FIRST_WAIT_MS;
    };
    opened.onmessage = ({ data }) => {
      if (typeof data === "string") {
        take(data);
        return;
      }
      const frame = decode(data);
      if (frame) heard.frame(frame);
    };
    opened.onclose = () => {
      for (const n of [...asked.keys()]) settle(n, { ok: false, words: "the program does not answer" });
      heard.lost();
      setTimeout(open, wait);
      wait = Math.min(2 * wait, LONGEST_WAIT_MS);
    };
  }

  /** Sends what needs no answer. @param {object} words */
  function tell(words) {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(words));
    return true;
  }

  /** Sends a command; the promise never fails: its answer says why not. @param {object} words @returns {Promise<Answer>} */
  function command(words) {
    const n = next++;
    return new Promise((resolve) => {
      if (!tell({ ...words, n })) {
        resolve({ ok: false, words: "the program does not answer" });
        return;
      }
      asked.set(n, resolve);
      setTimeout(() => settle(n, { ok: false, words: "no answer has come" }), ANSWER_WITHIN_MS);
    });
  }

  open();
  return { tell, command };
}
