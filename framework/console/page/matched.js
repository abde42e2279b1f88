// @ts-check
// What was found in a picture arrives after it, and not with the same ones: the frame that belongs to the picture on the screen is the nearest in capture time.

/** @typedef {import("./link.js").Frame} Frame */

const KEPT = 8;

export class Matched {
  /** @type {Frame[]} */
  #kept = [];
  /** @type {Frame|null} */
  shown = null;

  /** The one that is shown, or the newest where none belongs to a picture yet. */
  get best() {
    return this.shown ?? this.#kept.at(-1) ?? null;
  }

  /** @param {Frame} frame */
  take(frame) {
    this.#kept.push(frame);
    if (this.#kept.length > KEPT) this.#kept.shift();
  }

  /** Whether another frame is to be shown now; the newest where there is no picture. @param {number|undefined} time_s of the picture */
  match(time_s) {
    const before = this.shown;
    const newest = this.#kept.at(-1) ?? null;
    const off = (/** @type {Frame} */ frame) => Math.abs(frame.time_s - /** @type {number} */ (time_s));
    // Of two that are as near, the newer came last, after a seek in a recording.
    this.shown = time_s === undefined ? newest : this.#kept.reduce((best, frame) => (best && off(best) < off(frame) ? best : frame), /** @type {Frame|null} */ (null));
    return this.shown !== before;
  }
}
