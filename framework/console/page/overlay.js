// @ts-check
// What is drawn over a picture: features, masks, silhouettes. Shapes tell them apart, not colour alone.
import { palette } from "./picture.js";

/** @typedef {(u: number, v: number) => [number, number]} Onto From camera pixels to pixels of the canvas. */
/** @typedef {{centre: [number, number], label: number|null}} Feature */

export const SILHOUETTE = palette((value) => (value ? [86, 180, 233, 90] : [0, 0, 0, 0]));

const HALO = "rgba(0, 0, 0, 0.75)";

/** @param {CanvasRenderingContext2D} pen @param {string} colour @param {number} width */
function strokeTwice(pen, colour, width) {
  pen.strokeStyle = HALO;
  pen.lineWidth = 2.5 * width;
  pen.stroke();
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
}

/**
 * Crosses for features, circles for those with a label.
 * @param {CanvasRenderingContext2D} pen @param {Onto} onto @param {Feature[]} features
 * @param {{cross: string, circle: string}} colours @param {number} unit one CSS pixel @param {boolean} isLarge larger, and labels as numbers
 */
export function drawFeatures(pen, onto, features, colours, unit, isLarge) {
  const arm = (isLarge ? 6 : 4) * unit;
  pen.beginPath();
  for (const { centre, label } of features) {
    if (label !== null && label !== undefined) continue;
    const [x, y] = onto(centre[0], centre[1]);
    pen.moveTo(x - arm, y);
    pen.lineTo(x + arm, y);
    pen.moveTo(x, y - arm);
    pen.lineTo(x, y + arm);
  }
  strokeTwice(pen, colours.cross, unit);
  pen.beginPath();
  const named = features.filter(({ label }) => label !== null && label !== undefined);
  for (const { centre } of named) {
    const [x, y] = onto(centre[0], centre[1]);
    pen.moveTo(x + arm, y);
    pen.arc(x, y, arm, 0, 2 * Math.PI);
  }
  strokeTwice(pen, colours.circle, unit);
  if (!isLarge) return;
  pen.font = `${11 * unit}px system-ui, sans-serif`;
  pen.lineWidth = 3 * unit;
  pen.strokeStyle = HALO;
  pen.fillStyle = colours.circle;
  for (const { centre, label } of named) {
    const [x, y] = onto(centre[0], centre[1]);
    pen.strokeText(String(label), x + 7 * unit, y - 5 * unit);
    pen.fillText(String(label), x + 7 * unit, y - 5 * unit);
  }
}

/** @param {CanvasRenderingContext2D} pen @param {Onto} onto @param {[number, number][]} polygon @param {boolean} closed */
export function trace(pen, onto, polygon, closed = true) {
  pen.beginPath();
  polygon.forEach(([u, v], index) => {
    const [x, y] = onto(u, v);
    if (index) pen.lineTo(x, y);
    else pen.moveTo(x, y);
  });
  if (closed) pen.closePath();
}

/** Masks are hatched. @param {CanvasRenderingContext2D} pen @param {Onto} onto @param {[number, number][][]} masks @param {string} colour @param {number} unit @param {number|null} chosen */
export function drawMasks(pen, onto, masks, colour, unit, chosen = null) {
  masks.forEach((polygon, index) => {
    if (!Array.isArray(polygon) || polygon.length < 3) return;
    trace(pen, onto, polygon);
    pen.save();
    pen.clip();
    const corners = polygon.map(([u, v]) => onto(u, v));
    const [x0, x1] = [Math.max(0, Math.min(...corners.map((c) => c[0]))), Math.min(pen.canvas.width, Math.max(...corners.map((c) => c[0])))];
    const [y0, y1] = [Math.max(0, Math.min(...corners.map((c) => c[1]))), Math.min(pen.canvas.height, Math.max(...corners.map((c) => c[1])))];
    pen.beginPath();
    const gap = 7 * unit;
    for (let x = Math.floor((x0 - (y1 - y0)) / gap) * gap; x < x1; x += gap) {
      pen.moveTo(x, y1);
      pen.lineTo(x + (y1 - y0), y0);
    }
    pen.strokeStyle = colour;
    pen.globalAlpha = 0.55;
    pen.lineWidth = unit;
    pen.stroke();
    pen.restore();
    trace(pen, onto, polygon);
    strokeTwice(pen, colour, index === chosen ? 2.5 * unit : unit);
    if (index === chosen) {
      pen.fillStyle = colour;
      for (const [x, y] of corners) pen.fillRect(x - 3 * unit, y - 3 * unit, 6 * unit, 6 * unit);
    }
  });
}
