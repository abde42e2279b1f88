// @ts-check
// Beside the picture: what is wrong with the marks, what was corrected by hand so far, and tracking again from there.
import { clock, make, number, plural, write } from "./dom.js";

/** @typedef {import("./marks_rows.js").Row} Row */
/** @typedef {import("./marks_rows.js").Problem} Problem */
/** @typedef {import("./marks_rows.js").Marks} Marks */

const STATES = { idle: "", running: "… ", done: "✓ ", failed: "✗ " };
const CSS = { idle: "dim", running: "", done: "good", failed: "bad" };
/** Swaps first: they are wrong data, gaps are only missing data. */
const ORDER = { swap: 0, gap: 1 };

/** @param {Problem[]} problems */
export const inOrder = (problems) => problems.toSorted((a, b) => ORDER[a.kind] - ORDER[b.kind] || a.at_s - b.at_s);

/**
 * @param {import("./main.js").Context} context
 * @param {{problem: (problem: Problem) => void, choose: (row: Row) => void, remove: (row: Row) => void, again: () => void, search: () => void}} act
 */
export function marksList(context, act) {
  const { cameras, rig } = context.hello;
  const isSession = rig.mode === "session";
  const tool = (/** @type {string} */ words, /** @type {string|null} */ key, /** @type {() => void} */ go) => make("button", { type: "button", class: "tool", "aria-keyshortcuts": key, onclick: go }, words, key === null ? null : make("kbd", {}, key));
  const problems = make("ul", { class: "plain marks-list" });
  const rows = make("ul", { class: "plain marks-list" });
  const found = make("p", { class: "dim" });
  const count = make("p", { class: "dim" });
  const search = tool("Look for swaps and gaps", null, act.search);
  const again = tool("Track again", "t", act.again);
  const state = make("p");
  const file = make("p", { class: "dim marks-file" });
  const name = (/** @type {number} */ camera) => cameras[camera]?.name ?? `camera ${camera}`;
  const element = make(
    "div",
    {},
    ...(isSession ? [make("h2", {}, "Problems"), search, found, problems] : []),
    make("h2", {}, "Corrected by hand"),
    count,
    rows,
    ...(isSession ? [again, state] : [make("p", { class: "dim" }, "In a run each row acts at once.")]),
    file,
  );
  let shown = "";

  /** @param {Problem} problem */
  function problemItem(problem) {
    const { kind, camera, mark, other, at_s, frames, reason } = problem;
    const what = kind === "swap" ? `⇄ swap: ${mark} and ${other}` : `▯ gap: ${mark}${frames === undefined ? "" : `, ${plural(frames, "frame")}`}`;
    return make("li", {}, make("button", { type: "button", class: "link", "data-kind": kind, onclick: () => act.problem(problem) }, make("b", {}, what), ` ${name(camera)}, ${clock(at_s, 2)}`, make("span", { class: "dim" }, ` ${reason}`)));
  }

  /** @param {Row} row */
  function rowItem(row) {
    const { camera, mark, frame, u, v } = row;
    const where = u === null ? "not visible" : `u ${number(u, 2)}, v ${number(v, 2)}`;
    return make(
      "li",
      {},
      make("button", { type: "button", class: "link", onclick: () => act.choose(row) }, make("b", {}, `mark ${mark}`), ` ${name(camera)}, from picture ${frame}: ${where}`),
      make("button", { type: "button", class: "quiet", "aria-label": `Remove the row of mark ${mark}, ${name(camera)}, picture ${frame}`, title: "Remove", onclick: () => act.remove(row) }, "✕"),
    );
  }

  return {
    element,
    /** @param {Marks|null} sheet @param {Row[]} all of the node @param {number} node */
    show(sheet, all, node) {
      const own = sheet && sheet.node === node ? sheet : null;
      const now = JSON.stringify([own?.problems, own?.searching, sheet?.again, sheet?.file, all]);
      if (now === shown) return;
      shown = now;
      const list = inOrder(own?.problems ?? []);
      problems.replaceChildren(...list.map(problemItem));
      search.disabled = Boolean(own?.searching);
      write(found, own?.searching ? "looking …" : list.length ? "" : "none known");
      found.hidden = found.textContent === "";
      rows.replaceChildren(...all.map(rowItem));
      write(count, all.length ? plural(all.length, "row") : "no rows yet");
      const { state: word, words } = sheet?.again ?? { state: /** @type {const} */ ("idle"), words: "" };
      again.disabled = word === "running";
      write(state, words ? `${STATES[word]}${words}` : "");
      state.className = CSS[word];
      write(file, sheet?.file ? `File: ${sheet.file}` : "");
    },
  };
}
