// @ts-check
// Painting the regions that a detector does not search: polygons, corner by corner.
import { trace } from "./overlay.js";

/** @typedef {[number, number]} Corner */

const round = (/** @type {number} */ value) => Math.round(value * 10) / 10;

/** Whether a point lies in a polygon: it does when a ray from it crosses the border an odd number of times. @param {Corner[]} polygon @param {number} u @param {number} v */
export function contains(polygon, u, v) {
  let inside = false;
  for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i++) {
    const [ui, vi] = polygon[i];
    const [uj, vj] = polygon[j];
    if (vi > v !== vj > v && u < ((uj - ui) * (v - vi)) / (vj - vi) + ui) inside = !inside;
  }
  return inside;
}

/**
 * @param {() => Corner[][]} masks
 * @param {(masks: Corner[][]) => void} set
 */
export function maskPainter(masks, set) {
  /** @type {Corner[]} */
  let open = [];
  /** @type {number|null} */
  let chosen = null;

  function close() {
    if (open.length >= 3) set([...masks(), open]);
    open = [];
  }

  return {
    get chosen() {
      return chosen !== null && chosen < masks().length ? chosen : null;
    },
    get isOpen() {
      return open.length > 0;
    },
    /** @param {number} u @param {number} v @param {number} near how far a click may miss a corner [px] @param {boolean} isSecond of a double click */
    click(u, v, near, isSecond) {
      if (open.length >= 3 && (isSecond || Math.hypot(u - open[0][0], v - open[0][1]) < near)) {
        close();
        return;
      }
      if (isSecond) return;
      if (!open.length) {
        const hit = masks().findLastIndex((polygon) => contains(polygon, u, v));
        chosen = hit < 0 ? null : hit;
        if (hit >= 0) return;
      }
      open.push([round(u), round(v)]);
    },
    close,
    /** The last corner, or the chosen mask. */
    removeCorner: () => void open.pop(),
    removeChosen() {
      if (chosen === null) return;
      const left = masks().filter((_, index) => index !== chosen);
      chosen = null;
      set(left);
    },
    /** Whether there was something to give up. */
    giveUp() {
      const had = open.length > 0 || chosen !== null;
      open = [];
      chosen = null;
      return had;
    },
    /** @param {number} by */
    chooseNext(by) {
      const n = masks().length;
      if (n) chosen = chosen === null ? (by > 0 ? 0 : n - 1) : (chosen + by + n) % n;
    },
    words() {
      if (open.length) return `${open.length} ${open.length === 1 ? "corner" : "corners"}: ${open.length < 3 ? "click the next one" : "Enter or a double click closes the mask"}, Backspace takes the last one back, Escape gives up.`;
      if (chosen !== null) return "Delete removes the chosen mask; Escape leaves it.";
      return "Click the corners of a region that is not to be searched, or click a mask to choose it.";
    },
    /**
     * @param {CanvasRenderingContext2D} pen @param {import("./overlay.js").Onto} onto
     * @param {Corner|null} pointer @param {string} colour @param {number} unit
     */
    draw(pen, onto, pointer, colour, unit) {
      if (!open.length) return;
      trace(pen, onto, pointer ? [...open, pointer] : open, false);
      pen.setLineDash([5 * unit, 3 * unit]);
      pen.strokeStyle = colour;
      pen.lineWidth = 1.5 * unit;
      pen.stroke();
      pen.setLineDash([]);
      pen.fillStyle = colour;
      for (const corner of open) {
        const [x, y] = onto(...corner);
        pen.fillRect(x - 3 * unit, y - 3 * unit, 6 * unit, 6 * unit);
      }
    },
  };
}
