// @ts-check
// How marks are drawn, large and under the magnifier: numbered circles, small crosses for what has no number, and what is chosen.
import { drawFeatures } from "./overlay.js";

/** @typedef {import("./marks_rows.js").Dot} Dot */
/** @typedef {import("./overlay.js").Onto} Onto */

const MAGNIFIED = 12;

/**
 * @param {import("./main.js").Context} context @param {CanvasRenderingContext2D} pen @param {Onto} onto @param {number} unit
 * @param {{dots: Dot[], chosen: Dot|null, other: Dot|null, spot: {u: number, v: number}|null}} what
 */
export function drawMarks(context, pen, onto, unit, { dots, chosen, other, spot }) {
  const colours = { cross: context.css("--cross"), circle: context.css("--circle") };
  const features = (/** @type {Dot[]} */ some) => some.map(({ label, u, v }) => ({ label, centre: /** @type {[number, number]} */ ([u, v]) }));
  drawFeatures(pen, onto, features(dots.filter((dot) => dot.label === null)), colours, unit, false);
  drawFeatures(pen, onto, features(dots.filter((dot) => dot.label !== null && dot !== chosen)), colours, unit, true);
  if (chosen) drawFeatures(pen, onto, features([chosen]), { ...colours, circle: context.css("--yellow") }, 1.3 * unit, true);
  /** @param {{u: number, v: number}} at @param {number} half @param {string} colour @param {number[]} dash */
  const frame = ({ u, v }, half, colour, dash) => {
    const [x, y] = onto(u, v);
    pen.setLineDash(dash.map((length) => length * unit));
    pen.strokeStyle = colour;
    pen.lineWidth = 1.5 * unit;
    pen.strokeRect(x - half * unit, y - half * unit, 2 * half * unit, 2 * half * unit);
    pen.setLineDash([]);
  };
  for (const dot of dots) if (dot.byHand) frame(dot, 8, context.css("--pink"), []);
  if (chosen) frame(chosen, 12, context.css("--yellow"), []);
  if (other) frame(other, 12, context.css("--orange"), [4, 3]);
  if (spot) frame(spot, 9, context.css("--yellow"), [3, 2]);
}

/** A part of the picture, enlarged: the point is in the middle. @param {import("./main.js").Context} context @param {HTMLCanvasElement} canvas */
export function magnifier(context, canvas) {
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  return {
    /** @param {import("./picture.js").Picture} picture @param {{u: number, v: number}|null} at @param {Dot[]} dots */
    draw(picture, at, dots) {
      const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * devicePixelRatio)));
      if (canvas.width !== w || canvas.height !== h) {
        canvas.width = w;
        canvas.height = h;
      }
      pen.fillStyle = context.css("--void");
      pen.fillRect(0, 0, w, h);
      if (!at) return;
      const scale = MAGNIFIED * devicePixelRatio;
      const onto = (/** @type {number} */ u, /** @type {number} */ v) => /** @type {[number, number]} */ ([w / 2 + (u - at.u) * scale, h / 2 + (v - at.v) * scale]);
      if (picture.paint()) {
        const [left, top, wide, high] = picture.place();
        const [x, y] = onto(left, top);
        pen.imageSmoothingEnabled = false;
        pen.drawImage(picture.canvas, x, y, wide * scale, high * scale);
      }
      const unit = devicePixelRatio;
      for (const dot of dots) {
        const [x, y] = onto(dot.u, dot.v);
        pen.beginPath();
        pen.arc(x, y, 3 * unit, 0, 2 * Math.PI);
        pen.strokeStyle = context.css(dot.label === null ? "--cross" : "--circle");
        pen.lineWidth = 1.5 * unit;
        pen.stroke();
      }
      pen.strokeStyle = context.css("--yellow");
      pen.lineWidth = unit;
      pen.beginPath();
      for (const [from, to] of [[8, 60], [-60, -8]]) {
        pen.moveTo(w / 2 + from * unit, h / 2);
        pen.lineTo(w / 2 + to * unit, h / 2);
        pen.moveTo(w / 2, h / 2 + from * unit);
        pen.lineTo(w / 2, h / 2 + to * unit);
      }
      pen.stroke();
    },
  };
}
