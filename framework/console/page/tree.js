// @ts-check
// Any message as a tree that opens and closes, and is filled in place as newer ones come: what is open stays open, and the focus where it is.
import { make, write } from "./dom.js";

const MOST = 50;
const DEEPEST_OPEN = 1;

const isTree = (/** @type {any} */ value) => value !== null && typeof value === "object";
/** Lists of a few numbers are read best on one line. @param {any} value */
const isLine = (value) => Array.isArray(value) && value.length <= 6 && value.every((it) => typeof it === "number");

/** @param {any} value */
function leaf(value) {
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(7)));
  if (isLine(value)) return `[${value.map(leaf).join(", ")}]`;
  return JSON.stringify(value) ?? "–";
}

/** @param {any} value */
function summary(value) {
  if (Array.isArray(value)) return value.length > MOST ? `[${value.length}, the first ${MOST} are shown]` : `[${value.length}]`;
  return `{${Object.keys(value).length}}`;
}

/** @param {any} value @returns {[string, any][]} */
function entries(value) {
  return Array.isArray(value) ? value.slice(0, MOST).map((it, index) => [String(index), it]) : Object.entries(value);
}

/** @param {string} name @param {any} value @param {number} depth @returns {{element: HTMLElement, isBranch: boolean, update: (value: any) => void}} */
function branch(name, value, depth) {
  const count = make("span", { class: "dim" });
  const list = make("div", { class: "branch" });
  const element = make("details", { open: depth < DEEPEST_OPEN }, make("summary", {}, make("span", { class: "tree-name" }, name), " ", count), list);
  let shown = value;
  /** @type {Map<string, ReturnType<typeof node>>} */
  const children = new Map();

  function fill() {
    write(count, summary(shown));
    if (!element.open) return;
    const now = entries(shown);
    const names = new Set(now.map(([key]) => key));
    for (const [key, child] of children) {
      if (names.has(key)) continue;
      child.element.remove();
      children.delete(key);
    }
    for (const [key, it] of now) {
      const child = children.get(key);
      if (child && child.isBranch === (isTree(it) && !isLine(it))) {
        child.update(it);
        continue;
      }
      const made = node(key, it, depth + 1);
      if (child) child.element.replaceWith(made.element);
      else list.append(made.element);
      children.set(key, made);
    }
  }

  element.addEventListener("toggle", fill);
  fill();
  return {
    element,
    isBranch: true,
    update(next) {
      shown = next;
      fill();
    },
  };
}

/** @param {string} name @param {any} value @param {number} depth @returns {{element: HTMLElement, isBranch: boolean, update: (value: any) => void}} */
function node(name, value, depth) {
  if (isTree(value) && !isLine(value)) return branch(name, value, depth);
  const text = make("span", { class: "tree-value" }, leaf(value));
  return { element: make("div", {}, make("span", { class: "tree-name" }, name), " ", text), isBranch: false, update: (next) => write(text, leaf(next)) };
}

/** A tree that shows one message at a time. */
export function tree() {
  const element = make("div", { class: "tree" });
  /** @type {ReturnType<typeof node>|null} */
  let root = null;
  return {
    element,
    clear() {
      root = null;
      element.replaceChildren();
    },
    /** @param {string} name @param {any} value */
    show(name, value) {
      if (root && root.isBranch === (isTree(value) && !isLine(value))) {
        root.update(value);
        return;
      }
      root = node(name, value, 0);
      element.replaceChildren(root.element);
    },
  };
}
