// @ts-check
// Where features were found over time: false ones stay where they are and add up, true ones move.
import { palette } from "./picture.js";

const CELL_PX = 4;
/** Blue to white: the threshold view has orange and yellow. */
const HEAT = palette((level) => (level ? [0.9 * level, 100 + 0.6 * level, 190 + 0.25 * level, 110 + 0.55 * level] : [0, 0, 0, 0]));

/** @param {[number, number]} size of the camera */
export function heatMap([width, height]) {
  const across = Math.ceil(width / CELL_PX);
  const down = Math.ceil(height / CELL_PX);
  const counts = new Uint32Array(across * down);
  const canvas = document.createElement("canvas");
  canvas.width = across;
  canvas.height = down;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const image = new ImageData(across, down);
  const pixels = new Uint32Array(image.data.buffer);
  let most = 0;
  let mostAt = 0;
  let changed = true;

  return {
    n: 0,
    pictures: 0,
    cell: CELL_PX,
    canvas,
    /** @param {{centre: [number, number]}[]} features */
    add(features) {
      for (const { centre } of features) {
        const x = Math.floor((centre[0] + 0.5) / CELL_PX);
        const y = Math.floor((centre[1] + 0.5) / CELL_PX);
        if (x < 0 || y < 0 || x >= across || y >= down) continue;
        const at = y * across + x;
        counts[at]++;
        this.n++;
        if (counts[at] > most) {
          most = counts[at];
          mostAt = at;
        }
      }
      changed = true;
    },
    /** The place with most of them. */
    hottest() {
      return { count: most, u: ((mostAt % across) + 0.5) * CELL_PX - 0.5, v: (Math.floor(mostAt / across) + 0.5) * CELL_PX - 0.5 };
    },
    clear() {
      counts.fill(0);
      most = 0;
      this.n = 0;
      this.pictures = 0;
      changed = true;
    },
    /** By the logarithm, so that places hit once are seen beside those hit all the time. */
    paint() {
      if (!changed) return canvas;
      changed = false;
      const unit = 235 / Math.log1p(Math.max(most, 1));
      for (let i = 0; i < counts.length; i++) pixels[i] = counts[i] ? HEAT[20 + Math.round(unit * Math.log1p(counts[i]))] : 0;
      context.putImageData(image, 0, 0);
      return canvas;
    },
  };
}
