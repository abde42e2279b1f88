// @ts-check
// One picture of a camera: kept as it came, turned into colours when it is drawn, and where it lies in the camera's pixels.

/** @typedef {import("./link.js").Frame} Frame */

/** Colours of gray values, as the four bytes of a pixel. @param {(gray: number) => [number, number, number, number]} colour */
export function palette(colour) {
  const table = new Uint32Array(256);
  const bytes = new Uint8ClampedArray(table.buffer);
  for (let gray = 0; gray < 256; gray++) bytes.set(colour(gray), 4 * gray);
  return table;
}

export const GRAY = palette((gray) => [gray, gray, gray, 255]);

export class Picture {
  /** @type {Frame|null} */
  frame = null;
  canvas = document.createElement("canvas");
  #context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
  /** @type {ImageData|null} */
  #image = null;
  /** @type {Uint32Array} */
  #pixels = new Uint32Array(0);
  /** @type {Frame|null} */
  #painted = null;
  /** @type {Uint32Array|null} */
  #paintedWith = null;

  /** @param {Frame} frame */
  take(frame) {
    const { width, height, channels } = frame.header;
    if (width > 0 && height > 0 && frame.payload.length >= width * height * channels) this.frame = frame;
  }

  /** Where it lies, in camera pixels (the middle of the first is 0): left, top, width, height. */
  place() {
    const { width, height, window, factor } = /** @type {Frame} */ (this.frame).header;
    const pixel = this.pixel();
    return [(window?.left ?? 0) - 0.5, (window?.top ?? 0) - 0.5, width * pixel, height * pixel, factor];
  }

  /** Side of one of its pixels in camera pixels. */
  pixel() {
    const { window, factor } = /** @type {Frame} */ (this.frame).header;
    return (window?.shrink ?? 1) * (factor ?? 1);
  }

  /** The gray value, or red, green and blue, at a point in camera pixels. @param {number} u @param {number} v @returns {number[]|null} */
  at(u, v) {
    if (!this.frame) return null;
    const [left, top] = this.place();
    const { width, height, channels } = this.frame.header;
    const x = Math.floor((u - left) / this.pixel());
    const y = Math.floor((v - top) / this.pixel());
    if (x < 0 || y < 0 || x >= width || y >= height) return null;
    const start = (y * width + x) * channels;
    return Array.from(this.frame.payload.subarray(start, start + channels));
  }

  /** The canvas with the newest picture in it, or null. @param {Uint32Array} [colours] a palette; pictures in colour go by their brightness, unless it is GRAY */
  paint(colours = GRAY) {
    const frame = this.frame;
    if (!frame) return null;
    if (frame === this.#painted && colours === this.#paintedWith) return this.canvas;
    const { width, height, channels } = frame.header;
    if (!this.#image || this.#image.width !== width || this.#image.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.#image = new ImageData(width, height);
      this.#pixels = new Uint32Array(this.#image.data.buffer);
    }
    const bytes = frame.payload;
    const pixels = this.#pixels;
    if (channels === 1) for (let i = 0; i < pixels.length; i++) pixels[i] = colours[bytes[i]];
    else if (colours === GRAY) for (let i = 0, j = 0; i < pixels.length; i++, j += 3) pixels[i] = 0xff000000 | (bytes[j + 2] << 16) | (bytes[j + 1] << 8) | bytes[j];
    else for (let i = 0, j = 0; i < pixels.length; i++, j += 3) pixels[i] = colours[(77 * bytes[j] + 150 * bytes[j + 1] + 29 * bytes[j + 2]) >> 8];
    this.#context.putImageData(/** @type {ImageData} */ (this.#image), 0, 0);
    this.#painted = frame;
    this.#paintedWith = colours;
    return this.canvas;
  }
}
