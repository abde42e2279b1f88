// @ts-check
// The line below the bar of marks: what to do next, or the question for a number in its place.
import { make, write } from "./dom.js";

const MOST = 9999;

/** @param {{begin: () => void, end: () => void}} heard */
export function noteLine(heard) {
  const words = make("span");
  const field = make("input", { type: "number", min: 0, max: MOST, step: 1, required: true });
  const label = make("label", {}, " ", field);
  const form = make("form", { class: "tools", hidden: true }, label, make("button", { type: "submit", class: "tool" }, "Set"), make("button", { type: "button", class: "tool", onclick: leave }, "Leave", make("kbd", {}, "Esc")));
  /** @type {((label: number) => void)|null} */
  let asked = null;

  function leave() {
    form.hidden = true;
    words.hidden = false;
    asked = null;
    heard.end();
  }

  form.addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const number = field.valueAsNumber;
    if (!Number.isInteger(number)) return;
    asked?.(number);
    leave();
  });
  form.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    leave();
  });

  return {
    element: make("div", { class: "camera-note" }, words, form),
    get isAsking() {
      return asked !== null;
    },
    /** @param {string} line */
    write: (line) => write(words, line),
    /** @param {string} question @param {number} proposed @param {(label: number) => void} then */
    ask(question, proposed, then) {
      asked = then;
      write(label.firstChild, `${question} `);
      field.value = String(proposed);
      words.hidden = true;
      form.hidden = false;
      heard.begin();
      field.focus();
      field.select();
    },
  };
}
