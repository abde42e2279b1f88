// @ts-check
// The sheet of keys.
import { make } from "./dom.js";

/** @typedef {[keys: string, what: string]} Help */

/** A sheet that closes by Escape, its button, or "?" again. */
export function helpSheet() {
  const body = make("div", { class: "sheet-body" });
  const close = make("button", { type: "button", class: "tool", onclick: () => dialog.close() }, "Close");
  const dialog = /** @type {HTMLDialogElement} */ (
    make("dialog", { class: "sheet", "aria-label": "Keys" }, make("div", { class: "sheet-head" }, make("h2", {}, "Keys"), close), body)
  );
  document.body.append(dialog);

  /** @param {string} title @param {Help[]} keys */
  function part(title, keys) {
    const rows = keys.map(([key, what]) => make("tr", {}, make("th", { scope: "row" }, ...key.split(" ").map((one) => make("kbd", {}, one))), make("td", {}, what)));
    return make("section", {}, make("h3", {}, title), make("table", {}, make("tbody", {}, ...rows)));
  }

  return {
    get open() {
      return dialog.open;
    },
    close: () => dialog.close(),
    /** @param {{title: string, keys: Help[]}[]} parts */
    show(parts) {
      body.replaceChildren(...parts.filter(({ keys }) => keys.length).map(({ title, keys }) => part(title, keys)));
      dialog.showModal();
    },
  };
}
