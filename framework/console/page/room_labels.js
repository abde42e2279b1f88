// @ts-check
// Names in the room, on a canvas above the picture: the most important first, and none over another.
import { project } from "./space.js";

const HIGH = 15, CELL = 8;

export class Labels {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    /** @type {{x: number, y: number, z: number, text: string, colour: string, rank: number}[]} */ this.list = [];
    this.n = 0;
    this.widths = new Map();
    this.order = new Uint16Array(1024);
    this.taken = new Uint8Array(0);
    this.place = new Float64Array(3);
    this.ground = "rgba(0,0,0,.6)";
    this.font = "";
  }

  clear() { this.n = 0; }

  /** @param {number} x @param {number} y @param {number} z @param {string} text @param {string} colour @param {number} rank 0: the most important, to 9 */
  add(x, y, z, text, colour, rank) {
    if (this.n >= this.order.length) return;
    const it = this.list[this.n] ??= { x, y, z, text, colour, rank };
    it.x = x; it.y = y; it.z = z; it.text = text; it.colour = colour; it.rank = rank;
    this.n++;
  }

  /** Brings them into the order of their rank. */
  arrange() {
    let n = 0;
    for (let rank = 0; rank < 10; rank++) for (let k = 0; k < this.n; k++) if (this.list[k].rank === rank) this.order[n++] = k;
  }

  /** @param {Float64Array} clip @param {number} width @param {number} height in px of the page @param {number} pixel canvas pixels for one of these */
  paint(clip, width, height, pixel) {
    const to = this.context, columns = Math.ceil(width / CELL), rows = Math.ceil(height / CELL);
    const most = Math.max(12, Math.floor(width * height / 9000));
    if (this.taken.length < columns * rows) this.taken = new Uint8Array(columns * rows);
    this.taken.fill(0);
    to.setTransform(pixel, 0, 0, pixel, 0, 0);
    to.clearRect(0, 0, width, height);
    to.font = this.font;
    to.textBaseline = "middle";
    let shown = 0;
    for (let k = 0; k < this.n && shown < most; k++) {
      const it = this.list[this.order[k]];
      if (!project(this.place, clip, it.x, it.y, it.z)) continue;
      const wide = this.width(it.text) + 6, x = (this.place[0] + 1) * width / 2 + 8, y = (1 - this.place[1]) * height / 2 - 9;
      if (x < -4 || y < HIGH / 2 || x + wide > width || y > height - HIGH / 2 || !this.claim(x, y - HIGH / 2, wide, columns, rows)) continue;
      to.fillStyle = this.ground;
      to.fillRect(x, y - HIGH / 2, wide, HIGH);
      to.fillStyle = it.colour;
      to.fillText(it.text, x + 3, y + 0.5);
      shown++;
    }
    return shown;
  }

  /** Takes all names away. */
  wipe() {
    this.context.setTransform(1, 0, 0, 1, 0, 0);
    this.context.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  /** Takes a place if none of it is taken. @param {number} x @param {number} y @param {number} wide @param {number} columns @param {number} rows */
  claim(x, y, wide, columns, rows) {
    const left = Math.max(0, Math.floor(x / CELL)), right = Math.min(columns - 1, Math.floor((x + wide) / CELL));
    const top = Math.max(0, Math.floor(y / CELL)), bottom = Math.min(rows - 1, Math.floor((y + HIGH) / CELL));
    for (let r = top; r <= bottom; r++) for (let c = left; c <= right; c++) if (this.taken[r * columns + c]) return false;
    for (let r = top; r <= bottom; r++) for (let c = left; c <= right; c++) this.taken[r * columns + c] = 1;
    return true;
  }

  /** @param {string} text */
  width(text) {
    let wide = this.widths.get(text);
    if (wide === undefined) {
      if (this.widths.size > 4000) this.widths.clear();
      this.widths.set(text, wide = this.context.measureText(text).width);
    }
    return wide;
  }
}
