// @ts-check
// Collecting pictures for a calibration, for the person who waves a light or a board: what to do next, where each camera has seen it, and when it is enough.
import { make, number, write } from "./dom.js";
import { cameraMaps } from "./calibrating_maps.js";
import { pairMatrix } from "./calibrating_pairs.js";

/**
 * What the program shows of a calibration.
 * @typedef {object} Calibrating
 * @property {"capturing"|"solving"|"checking"|"done"} phase
 * @property {number} columns Of the cells of each picture.
 * @property {number} rows
 * @property {number} full_cell So often the light was in a cell that counts.
 * @property {number} min_frames
 * @property {number} min_common
 * @property {number} min_share
 * @property {boolean} board
 * @property {Progress[]} cameras
 * @property {number[][]} common Frames in which two cameras saw it at once.
 * @property {boolean} enough
 * @property {{words: string, needed: boolean}[]} missing The most important first.
 * @property {number|null} volume_share
 * @property {{level: string, text: string}|null} verdict
 */
/** @typedef {{name: string, frames: number, share: number, cells: number[], done: boolean, partners: number, depth_m: [number, number]|null}} Progress */

const PHASES = /** @type {const} */ (["capturing", "solving", "checking", "done"]);
const PHASE_WORDS = { capturing: "Capturing", solving: "Solving", checking: "Checking", done: "Done" };
/** What is to be done in a phase in which nothing is missing. */
const BUSY = { capturing: "Nothing has come yet", solving: "You can rest: the cameras are being solved", checking: "You can rest: the result is being checked", done: "Done" };
/** Longer words may break: they would stick out of a phone. */
const LONGEST_WHOLE = 12;
const VERDICTS = /** @type {Record<string, [sign: string, words: string, css: string]>} */ ({
  good: ["✓", "Good", "good"],
  usable: ["△", "Usable", "warn"],
  redo: ["↺", "Do it again", "bad"],
  failed: ["✗", "Failed", "bad"],
});

export const percent = (/** @type {number|null|undefined} */ share) => (share === null || share === undefined ? "–" : `${number(100 * share, 0)} %`);

/** Words of which none breaks at a hyphen, as names of cameras would. @param {HTMLElement} element @param {string} words */
function writeWhole(element, words) {
  if (element.textContent === words) return;
  element.replaceChildren(...words.split(/(\s+)/).map((word) => (word.trim() && word.length <= LONGEST_WHOLE ? make("span", { class: "whole" }, word) : word)));
}

/** Rows of words, as many as there are. @param {HTMLElement} list @param {[words: string, css: string][]} lines */
function fill(list, lines) {
  while (list.children.length < lines.length) list.append(make("li"));
  while (list.children.length > lines.length) list.lastChild?.remove();
  lines.forEach(([words, css], index) => {
    write(list.children[index], words);
    list.children[index].className = css;
  });
}

/** The rule in words. @param {Calibrating} now */
function stopRule({ board, min_frames, min_share, min_common }) {
  const what = board ? "board" : "light";
  return `Enough when each camera saw the ${what} in ${min_frames} frames and in ${percent(min_share)} of the cells of its picture, and is linked to the others by pairs that saw it at once in ${min_common} frames.`;
}

/** The largest words: what to do now, or that it is over. @param {Calibrating} now @returns {[words: string, css: string]} */
function first({ phase, enough, missing, verdict }) {
  if (verdict) {
    const [sign, words, css] = VERDICTS[verdict.level] ?? ["•", verdict.level, ""];
    return [`${sign} ${words}`, css];
  }
  if (phase !== "capturing") return [BUSY[phase], ""];
  if (enough) return ["✓ Enough: you can stop", "good"];
  const [most] = missing;
  return most ? [most.words, most.needed ? "needed" : "helps"] : [BUSY.capturing, "helps"];
}

/** @type {import("./main.js").ViewModule} */
export const view = {
  id: "calibrating",
  title: "Calibrating",
  key: "4",
  isThere: (_, sheets) => sheets.has("calibrating"),
  opensWith: "calibrating",
  create(context) {
    const steps = PHASES.map((phase) => make("li", {}, PHASE_WORDS[phase]));
    const kind = make("p", { class: "dim" });
    const most = make("p", { class: "calibrating-first" });
    const next = make("ul", { class: "plain calibrating-next" });
    const verdict = make("pre", { class: "verdict", tabindex: 0, "aria-label": "Verdict" });
    const maps = cameraMaps(context);
    const pairs = pairMatrix();
    const rule = make("p");
    const volume = make("p", { class: "dim" });
    const element = make(
      "div",
      { class: "calibrating" },
      make("section", { class: "calibrating-head", "aria-label": "What to do" }, make("ol", { class: "stepper", "aria-label": "Phases" }, ...steps), kind, most, next, verdict),
      make("section", { "aria-label": "Cameras" }, make("h2", {}, "Where each camera has seen it"), maps.legend, maps.element),
      make("section", { class: "calibrating-pairs", "aria-label": "Pairs" }, make("h2", {}, "Pairs that saw it at once"), pairs.element, make("h2", {}, "When it is enough"), rule, volume),
    );

    /** @param {Calibrating} now */
    function showWords(now) {
      const at = PHASES.indexOf(now.phase);
      steps.forEach((step, index) => {
        step.className = index < at || now.phase === "done" ? "past" : "";
        if (index === at) step.setAttribute("aria-current", "step");
        else step.removeAttribute("aria-current");
      });
      const [words, css] = first(now);
      write(kind, css === "needed" ? "needed now:" : css === "helps" && now.missing.length ? "would help:" : "");
      writeWhole(most, words);
      most.className = `calibrating-first ${css}`;
      // What the largest words already say is not said twice.
      const rest = now.missing.filter((it) => it.words !== words);
      const isCapturing = now.phase === "capturing" && !now.verdict;
      fill(next, isCapturing ? rest.map((it) => [`${it.needed ? "needed: " : "would help: "}${it.words}`, it.needed ? "needed" : "helps"]) : []);
      next.hidden = next.children.length === 0;
      write(verdict, now.verdict?.text ?? "");
      verdict.hidden = !now.verdict?.text;
      write(rule, stopRule(now));
      write(volume, now.volume_share === null ? "" : `${percent(now.volume_share)} of the room's volume was reached.`);
    }

    return {
      element,
      wants: () => [],
      frame() {},
      state() {},
      sheet(name, value) {
        if (name !== "calibrating") return;
        showWords(value);
        maps.show(value);
        pairs.show(value);
      },
      draw: () => maps.draw(),
      show: () => maps.listen(true),
      hide: () => maps.listen(false),
      help: [["← → ↑ ↓", "in the table of pairs: to another pair"]],
      key: () => false,
    };
  },
};
