// @ts-check
// Elements made in one expression, and numbers written as people read them.

/**
 * An element: `make("button", { class: "tool", onclick: go }, "Go")`. Names that start with "on" are handlers, true is an empty attribute; null and false are left out.
 * @param {string} tag
 * @param {Record<string, any>} [attributes]
 * @param {...(Node|string|number|null)} children
 * @returns {any}
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.filter((child) => child !== null).map((child) => (typeof child === "number" ? String(child) : child)));
  return element;
}

/**
 * Sets text only where it differs: a text that is set again is laid out again, and read out again.
 * @param {Node} element
 * @param {string} words
 */
export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

/** @param {number|null|undefined} value @param {number} [digits] */
export function number(value, digits = 1) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits);
}

/** Milliseconds: three digits at most. @param {number|null|undefined} value */
export function ms(value) {
  return number(value, value !== null && value !== undefined && Math.abs(value) < 10 ? 1 : 0);
}

/** A time of the run: 12.3 s, or 2:03.4 from a minute on. @param {number|null|undefined} seconds @param {number} [digits] */
export function clock(seconds, digits = 1) {
  if (seconds === null || seconds === undefined) return "–";
  // Rounded first, so that 59.96 is 1:00.0 and not 0:60.0.
  const unit = 10 ** digits;
  const all = Math.round(Math.abs(seconds) * unit) / unit;
  const sign = seconds < 0 ? "−" : "";
  if (all < 60) return `${sign}${all.toFixed(digits)} s`;
  const rest = (all % 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return `${sign}${Math.floor(all / 60)}:${rest}`;
}

/** "1 gap", "3 gaps". @param {number} n @param {string} thing @param {string} [things] */
export function plural(n, thing, things = `${thing}s`) {
  return `${n} ${n === 1 ? thing : things}`;
}
