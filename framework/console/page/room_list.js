// @ts-check
// The list beside the room: what is drawn, and each scale with its targets and marks in numbers.
import { make, plural, write } from "./dom.js";
import { CLOUDS } from "./room_data.js";
import { sigma } from "./space.js";

const KEPT_AS = "foveate-console-room", MOST_ROWS = 200, EVERY_MS = 75, TURNS = 4;
const GLYPHS = /** @type {Record<string, string>} */ ({ Measured: "●", Predicted: "○", Filled: "■" });

/** What can be shown: key, words, messages that it needs (none: always there), whether it is on at first. @type {[string, string, string[], boolean][]} */
const PARTS = [
  ["floor", "Floor", [], true], ["volumes", "Volume, origin", [], true],
  ["cameras", "Cameras", [], true], ["rays", "Rays of features", ["features"], true],
  ["looks", "Head directions", ["sub_region"], true], ["regions", "Sub-regions", ["sub_region"], true],
  ["targets", "Targets", ["targets"], true], ["trails", "Trails, 3 s", ["targets"], true],
  ["marks", "Marks", ["marks"], true], ["mark_names", "Names of marks", ["marks"], false],
  ["skeletons", "Skeletons", ["skeletons"], true], ["scales", "Spaces of scales", ["scale_space"], true],
  ["clouds", "Clouds, voxels", CLOUDS, true], ["meshes", "Meshes", ["mesh"], true], ["names", "Names", [], true],
];

/** What is shown, as it was left the last time. */
export function keptParts() {
  /** @type {Record<string, boolean>} */ const shown = { list: window.innerWidth > 760 || window.innerHeight > 600 };
  for (const [key, , , on] of PARTS) shown[key] = on;
  try {
    const kept = JSON.parse(localStorage.getItem(KEPT_AS) ?? "{}");
    for (const key of Object.keys(shown)) if (typeof kept[key] === "boolean") shown[key] = kept[key];
  } catch {
    // Then everything is shown that is shown at first.
  }
  return shown;
}

/** @param {Record<string, boolean>} shown */
export function keepParts(shown) {
  try {
    localStorage.setItem(KEPT_AS, JSON.stringify(shown));
  } catch {
    // The choice then holds until the page is closed.
  }
}

/**
 * @param {{hello: any, chosen: any}} context @param {import("./room_data.js").RoomData} data @param {Record<string, boolean>} shown
 * @param {{parts: () => void, choose: (what: object) => void}} acts
 */
export function sideList(context, data, shown, acts) {
  const { hello } = context, here = new Set(hello.topics.map((/** @type {any} */ it) => it.message));
  const checks = PARTS.filter(([, , needs]) => needs.length === 0 || needs.some((it) => here.has(it))).map(([key, words]) => {
    const box = make("input", { type: "checkbox", checked: shown[key], "data-part": key });
    box.addEventListener("change", () => {
      shown[key] = box.checked;
      acts.parts();
    });
    return make("label", {}, box, words);
  });
  const streams = data.streams.all.map((/** @type {number} */ topic) => {
    const box = make("input", { type: "checkbox", checked: data.chosen.has(topic), "data-stream": topic });
    box.addEventListener("change", () => {
      data.stream(topic, box.checked);
      acts.parts();
    });
    return make("label", {}, box, hello.topics[topic].path);
  });
  const key = make("p", { class: "room-key" }, ...["Measured", "Predicted", "Filled"].map((it) => make("span", {}, make("i", { "data-is": it }, GLYPHS[it]), it.toLowerCase())),
    here.has("marks") ? make("span", {}, make("i", { "data-is": "mark" }, "●"), "measured mark") : "");
  const sections = hello.scales.map((/** @type {any} */ scale, /** @type {number} */ index) => scaleSection(scale, index));
  const cameras = data.cameras.map((/** @type {any} */ camera) => {
    const angle = make("span", { class: "room-counts" });
    const row = make("button", { type: "button", class: "room-row room-camera", "aria-pressed": "false", onclick: () => acts.choose({ camera: camera.index }) },
      make("span", { "data-is": camera.on_head ? "head" : "" }, camera.on_head ? "◆" : "▸"), make("span", {}, camera.name), angle);
    return { row, angle, camera };
  });
  const element = make("aside", { class: "room-side", "aria-label": "What is in the room" },
    make("details", { open: window.innerWidth > 760 }, make("summary", {}, "Shown"), make("div", { class: "room-checks" }, ...checks)),
    streams.length > data.streams.main.size ? make("details", {}, make("summary", {}, `Streams (${streams.length})`), make("div", { class: "room-streams" }, ...streams)) : "", key,
    ...sections.map((/** @type {any} */ it) => it.element),
    make("details", {}, make("summary", {}, `Cameras (${cameras.length})`), ...cameras.map((/** @type {any} */ it) => it.row)));
  // A quarter of the rows is written at a time: hundreds of cells at once would hold up a picture.
  let last = -Infinity, due = TURNS, turn = 0, all = true;

  /** @param {any} scale @param {number} index */
  function scaleSection(scale, index) {
    const status = make("span"), head = make("div", { class: "room-head", hidden: true }, ...["", "target", "x", "y", "z", "σ", "cams"].map((it) => make("span", {}, it)));
    const rows = make("div"), counts = make("div");
    return { index, status, head, rows, counts, element: make("section", { "aria-label": `Scale ${scale.name}` }, make("h3", {}, scale.name, status), head, rows, counts) };
  }

  /** @param {any} section */
  function fill(section) {
    let n = 0, n_counts = 0, beyond = 0;
    for (const it of data.newest.values()) {
      if (it.what.message === "targets" && (it.scale ?? 0) === section.index) {
        for (const target of it.message.list) n < MOST_ROWS ? row(section.rows, n++, target) : beyond++;
      }
      if (it.what.message === "marks" && (it.what.scale ?? 0) === section.index) {
        count(section.counts, n_counts++, it);
        const mark = it.message.list.find((/** @type {any} */ one) => one.label === context.chosen.mark);
        if (mark) say(section.counts, n_counts++, `mark ${mark.label}, ${mark.provenance.toLowerCase()}: ${mark.position.map(mm).join(", ")} mm, σ ${mm(sigma(mark.covariance, 3))} mm, ${plural(mark.cameras?.length ?? 0, "camera")}`);
      }
    }
    if (beyond) say(section.counts, n_counts++, `and ${beyond} more targets`);
    for (const [list, used] of [[section.rows, n], [section.counts, n_counts]]) for (let k = used; k < list.children.length; k++) list.children[k].hidden = true;
    section.head.hidden = n === 0;
    write(section.status, standing(section.index, n + beyond));
  }

  /** @param {number} scale @param {number} n */
  function standing(scale, n) {
    const targets = n === 0 ? "no targets" : `${plural(n, "target")}, in mm`;
    if (!data.spaces.isAnchored(scale)) return targets;
    const target = data.spaces.target(scale);
    return target === undefined ? "no space yet" : target === null ? "suspended" : n === 0 ? `on target ${target}` : `on target ${target}, ${targets}`;
  }

  /** @param {HTMLElement} rows @param {number} k @param {import("./room_data.js").Target} target */
  function row(rows, k, target) {
    let it = /** @type {any} */ (rows.children[k]);
    if (!it) {
      it = make("button", { type: "button", class: "room-row", "aria-pressed": "false" }, ...Array.from({ length: 7 }, () => make("span")));
      it.addEventListener("click", () => acts.choose({ target: it.target }));
      rows.append(it);
    }
    const cells = it.children;
    if (!all && k % TURNS !== turn && it.target === target.id && !it.hidden) return;
    it.target = target.id;
    it.hidden = false;
    if (cells[0].dataset.is !== target.provenance) {
      cells[0].dataset.is = target.provenance;
      it.title = target.provenance.toLowerCase();
      write(cells[0], GLYPHS[target.provenance] ?? "·");
    }
    write(cells[1], String(target.id));
    for (let r = 0; r < 3; r++) write(cells[2 + r], (target.position[r] * 1000).toFixed(1));
    const spread = sigma(target.covariance, 6) * 1000;
    write(cells[5], Number.isFinite(spread) ? spread.toFixed(spread < 10 ? 2 : 0) : "–");
    write(cells[6], String(target.cameras?.length ?? 0));
    pressed(it, target.id === context.chosen.target);
  }

  /** @param {HTMLElement} counts @param {number} k @param {any} it */
  function count(counts, k, it) {
    const of = /** @type {Record<string, number>} */ ({ Measured: 0, Predicted: 0, Filled: 0 });
    for (const mark of it.message.list) of[mark.provenance] = (of[mark.provenance] ?? 0) + 1;
    const parts = Object.entries(of).filter(([, n]) => n > 0).map(([name, n]) => `${GLYPHS[name] ?? ""} ${n} ${name.toLowerCase()}`);
    const fit = it.message.fit ? `; fit ${(it.message.fit.rms * 1000).toFixed(2)} mm` : "";
    say(counts, k, `${it.what.path}: ${it.message.list.length} marks${parts.length ? `, ${parts.join(", ")}` : ""}${fit}`);
  }

  /** @param {HTMLElement} counts @param {number} k @param {string} words */
  function say(counts, k, words) {
    const line = /** @type {any} */ (counts.children[k] ?? counts.appendChild(make("p", { class: "room-counts" })));
    line.hidden = false;
    write(line, words);
  }

  return {
    element,
    /** There is something new to write. @param {boolean} at_once */
    touch(at_once) {
      due = TURNS;
      all ||= at_once;
    },
    /** Writes what has changed, a few times a second. @param {number} now_ms */
    update(now_ms) {
      if (due === 0 || element.hidden || (!all && now_ms - last < EVERY_MS)) return;
      last = now_ms;
      due--;
      turn = (turn + 1) % TURNS;
      sections.forEach(fill);
      all = false;
      for (const { row: it, angle, camera } of cameras) {
        pressed(it, camera.index === context.chosen.camera);
        if (camera.on_head) write(angle, camera.angles ? `pan ${degrees(camera.angles[0])}, tilt ${degrees(camera.angles[1])}` : "head");
      }
    },
  };
}

/** @param {HTMLElement} it @param {boolean} is */
function pressed(it, is) {
  const words = String(is);
  if (it.getAttribute("aria-pressed") !== words) it.setAttribute("aria-pressed", words);
}

/** @param {number} metres */
const mm = (metres) => (metres * 1000).toFixed(2);
/** @param {number} radians */
const degrees = (radians) => `${(radians * 180 / Math.PI).toFixed(1)}°`;
