// @ts-check
// The colours of the room: custom properties of the page where they are set, else those of Okabe and Ito.
import { packed } from "./gl.js";

/** @typedef {Record<string, any>} Palette */

// Of each: custom properties in the order in which they are tried, then the colour on dark and on light ground.
const COLOURS = /** @type {const} */ ({
  ground: [["--plot-background", "--background", "--ground"], "#15181c", "#ffffff"],
  ink: [["--text", "--foreground"], "#e8eaed", "#1b1f24"],
  dim: [["--dim"], "#9aa1aa", "#5b6470"],
  grid: [["--room-grid"], "#6b7480", "#8b94a0"],
  volume: [["--room-volume"], "#8a94a1", "#6d7783"],
  camera: [["--room-camera"], "#b8c0ca", "#4a535e"],
  head: [["--room-head"], "#2bc79a", "#007a5a"],
  chosen: [["--room-chosen"], "#F0E442", "#000000"],
  ray: [["--room-ray"], "#F0E442", "#a06a00"],
  scale: [["--room-scale"], "#E69F00", "#9a6a00"],
  region: [["--room-region"], "#D55E00", "#c04f00"],
  bone: [["--room-bone"], "#d9dde2", "#3b434d"],
  trail: [["--room-trail"], "#56B4E9", "#0072B2"],
  x: [["--axis-x"], "#e8743b", "#D55E00"],
  y: [["--axis-y"], "#22b88c", "#009E73"],
  z: [["--axis-z"], "#56B4E9", "#0072B2"],
  Measured: [["--room-measured"], "#56B4E9", "#0072B2"],
  Predicted: [["--room-predicted"], "#E69F00", "#b35f00"],
  Filled: [["--room-filled"], "#CC79A7", "#a8407c"],
  mark: [["--room-mark"], "#3fd0a8", "#00805d"],
});

/** @param {{css: (name: string) => string, theme: () => string}} context @returns {Palette} */
export function palette(context) {
  const light = context.theme() === "light";
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 1;
  const to = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
  /** @type {Palette} */ const it = { css: {}, rgb: {}, light };
  for (const [name, [properties, onDark, onLight]] of Object.entries(COLOURS)) {
    const given = properties.map((property) => context.css(property)).find((value) => value && CSS.supports("color", value));
    const text = given ?? (light ? onLight : onDark);
    to.clearRect(0, 0, 1, 1);
    to.fillStyle = text;
    to.fillRect(0, 0, 1, 1);
    const [r, g, b] = to.getImageData(0, 0, 1, 1).data;
    it[name] = packed(r, g, b, 255);
    it.css[name] = text;
    it.rgb[name] = [r, g, b];
  }
  it.marks = { ...it, Measured: it.mark };
  const [r, g, b] = it.rgb.ground;
  it.cover = `rgba(${r}, ${g}, ${b}, 0.72)`;
  return it;
}
