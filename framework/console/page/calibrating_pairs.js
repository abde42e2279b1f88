// @ts-check
// How the cameras are linked: a pair counts by the frames in which both saw the light at once, and a camera that no pair links cannot be placed.
import { make, plural, write } from "./dom.js";

/** @typedef {import("./calibrating.js").Calibrating} Calibrating */

const NAMED = 4;

/** "a, b and 3 more". @param {string[]} names */
function listed(names) {
  const shown = names.slice(0, NAMED);
  const more = names.length - shown.length;
  if (more) return `${shown.join(", ")} and ${more} more`;
  return shown.length < 2 ? shown.join("") : `${shown.slice(0, -1).join(", ")} and ${shown.at(-1)}`;
}

/** Groups of cameras that pairs with enough frames link to one another, the largest first. @param {Calibrating} now */
function islands({ cameras, common, min_common }) {
  const left = new Set(cameras.keys());
  const found = [];
  for (const start of cameras.keys()) {
    if (!left.delete(start)) continue;
    const island = [start];
    for (const at of island) for (const other of [...left]) if (common[at][other] >= min_common && left.delete(other)) island.push(other);
    found.push(island);
  }
  return found.sort((a, b) => b.length - a.length);
}

/** Which cameras are linked least. @param {Calibrating} now */
export function weakest(now) {
  const { cameras, common, min_common } = now;
  const name = (/** @type {number} */ index) => cameras[index].name;
  if (cameras.length < 2) return "One camera has no pairs.";
  const best = cameras.map((_, at) => {
    const others = [...cameras.keys()].filter((other) => other !== at).sort((a, b) => common[at][b] - common[at][a]);
    return { at, with: others[0], frames: common[at][others[0]] };
  });
  const [, ...apart] = islands(now);
  if (apart.length) {
    const alone = apart.flat().sort((a, b) => best[a].frames - best[b].frames);
    const worst = best[alone[0]];
    const nearest = worst.frames ? `${name(worst.at)} and ${name(worst.with)} have ${worst.frames} of ${min_common} frames` : `${name(worst.at)} has no frame with any other`;
    return `Not linked yet: ${listed(alone.map(name))} (${nearest}). Hold the light where ${alone.length === 1 ? "it" : "each of them"} and another camera see it.`;
  }
  const links = (/** @type {number} */ at) => common[at].filter((frames, other) => other !== at && frames >= min_common).length;
  const [{ at }] = best.toSorted((a, b) => links(a.at) - links(b.at) || a.frames - b.frames);
  return `All are linked. Weakest linked: ${name(at)}, by ${plural(links(at), "pair")}, the best with ${name(best[at].with)} in ${plural(best[at].frames, "frame")}.`;
}

export function pairMatrix() {
  const table = make("table", { class: "pairs", role: "grid", "aria-label": "Frames that two cameras have in common" });
  const box = make("div", { class: "pairs-box" }, table);
  const reading = make("output", { class: "pairs-reading" });
  const sentence = make("p");
  const element = make("div", {}, sentence, box, reading);
  /** @type {HTMLElement[][]} */
  let cells = [];
  let names = "";
  let at = [0, 1];
  let isOver = false;
  /** @type {Calibrating|null} */
  let now = null;

  /** @param {number} row @param {number} column */
  function read(row, column) {
    at = [row, column];
    isOver = true;
    tell();
  }

  function tell() {
    const [row, column] = at;
    if (!now || !isOver) write(reading, "Point at a pair for its numbers.");
    else if (row === column) write(reading, now.cameras[row].name);
    else write(reading, `${now.cameras[row].name} and ${now.cameras[column].name}: ${plural(now.common[row][column], "frame")} at once (${now.min_common} needed)`);
  }

  /** @param {Calibrating} value */
  function build({ cameras }) {
    const heads = cameras.map(({ name }) => make("th", { scope: "col" }, make("span", {}, name)));
    cells = cameras.map((_, row) =>
      cameras.map((_, column) => make("td", { role: "gridcell", tabindex: row === 0 && column === 1 ? 0 : -1, onpointerenter: () => read(row, column), onclick: () => cells[row][column].focus(), onfocus: () => read(row, column) })),
    );
    const rows = cameras.map(({ name }, row) => make("tr", {}, make("th", { scope: "row" }, name), ...cells[row]));
    table.replaceChildren(make("thead", {}, make("tr", {}, make("td"), ...heads)), make("tbody", {}, ...rows));
  }

  table.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    const by = /** @type {Record<string, [number, number]>} */ ({ ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] })[event.key];
    if (!by) return;
    const next = cells[at[0] + by[0]]?.[at[1] + by[1]];
    event.preventDefault();
    event.stopPropagation();
    if (!next) return;
    for (const row of cells) for (const cell of row) cell.tabIndex = cell === next ? 0 : -1;
    next.focus();
  });

  return {
    element,
    /** @param {Calibrating} value */
    show(value) {
      now = value;
      const all = value.cameras.map(({ name }) => name).join("\n");
      if (all !== names) build(value);
      names = all;
      cells.forEach((row, r) =>
        row.forEach((cell, c) => {
          const part = r === c ? -1 : Math.min(1, value.common[r][c] / Math.max(1, value.min_common));
          cell.className = part < 0 ? "self" : part === 0 ? "none" : part < 1 ? "some" : "full";
          cell.style.setProperty("--part", `${Math.round(100 * Math.max(0, part))}%`);
          cell.setAttribute("aria-label", r === c ? value.cameras[r].name : `${value.cameras[r].name} and ${value.cameras[c].name}: ${value.common[r][c]}`);
        }),
      );
      write(sentence, weakest(value));
      tell();
    },
  };
}
