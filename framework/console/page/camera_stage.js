// @ts-check
// The pictures of one camera on a canvas that is zoomed and moved by hand: what is common to all views of one camera.
import { make, number, write } from "./dom.js";
import { zoomed } from "./zoom.js";

const ZOOM_STEP = 1.25;
/** Pixels enlarged by more than this are shown as they are. */
const SMOOTH_UP_TO = 2;
const MARKS_FOR_PX = 1000;
const PAN_PX = 60;

/** @type {Record<string, [number, number]>} */
export const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** A button with its key. @param {string} words @param {string} key @param {() => void} act @param {string} [says] */
export const tool = (words, key, act, says = words) => make("button", { type: "button", class: "tool", title: says, "aria-label": says, "aria-keyshortcuts": key, onclick: act }, words, make("kbd", {}, key));

/**
 * @param {import("./main.js").Context} context
 * @param {import("./lookup.js").Served} camera
 * @param {Parameters<typeof zoomed>[2]} heard
 */
export function cameraStage(context, camera, heard) {
  const [width, height] = camera.size;
  const canvas = make("canvas", { tabindex: 0, role: "img", "aria-label": `Pictures of ${camera.name}` });
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  const element = make("div", { class: "stage" }, canvas);
  const zoom = zoomed(canvas, camera.size, heard);
  const zoomWords = make("span", { class: "dim zoom-words" });
  const tools = make("span", { class: "tools" }, tool("−", "-", () => zoom.by(1 / ZOOM_STEP), "Smaller"), tool("+", "+", () => zoom.by(ZOOM_STEP), "Larger"), tool("Fit", "0", () => zoom.fit(), "The whole picture"), tool("1:1", "o", () => zoom.oneToOne(), "A pixel of the camera on a pixel of the screen"), zoomWords);
  const sized = new ResizeObserver(resize);

  function resize() {
    const [w, h] = [element.clientWidth, element.clientHeight].map((side) => Math.max(1, Math.round(side * devicePixelRatio)));
    if (canvas.width !== w || canvas.height !== h) {
      canvas.width = w;
      canvas.height = h;
    }
    if (zoom.isFit) zoom.fit();
    heard.changed();
  }

  return {
    element,
    canvas,
    pen,
    zoom,
    tools,
    resize,
    /** Side of a mark's stroke: larger on large canvases. */
    unit: () => devicePixelRatio * Math.min(Math.max(canvas.clientWidth / MARKS_FOR_PX, 1), 2.5),
    clear() {
      pen.fillStyle = context.css("--void");
      pen.fillRect(0, 0, canvas.width, canvas.height);
    },
    /** @param {CanvasImageSource} layer @param {number[]} place left, top, width, height in camera pixels @param {number} pixel side of one of its pixels */
    lay(layer, [left, top, w, h], pixel) {
      const scale = zoom.scale * devicePixelRatio;
      const [x, y] = zoom.onto(left, top);
      pen.imageSmoothingEnabled = pixel * scale <= SMOOTH_UP_TO;
      pen.drawImage(layer, x, y, w * scale, h * scale);
    },
    /** The border of the picture. */
    border() {
      const scale = zoom.scale * devicePixelRatio;
      const [x, y] = zoom.onto(-0.5, -0.5);
      pen.strokeStyle = context.css("--dim");
      pen.lineWidth = 1;
      pen.strokeRect(x, y, width * scale, height * scale);
    },
    /** Writes how much is zoomed. */
    tell: () => write(zoomWords, `${number(zoom.scale * devicePixelRatio, 2)} ×`),
    /** @type {Record<string, () => void>} */
    keys: {
      "0": () => zoom.fit(),
      o: () => zoom.oneToOne(),
      "+": () => zoom.by(ZOOM_STEP),
      "=": () => zoom.by(ZOOM_STEP),
      "-": () => zoom.by(1 / ZOOM_STEP),
      ...Object.fromEntries(Object.entries(ARROWS).map(([key, [x, y]]) => [key, () => zoom.pan(PAN_PX * x, PAN_PX * y)])),
    },
    show() {
      sized.observe(element);
      resize();
      zoom.fit();
      canvas.focus({ preventScroll: true });
    },
    hide: () => sized.disconnect(),
  };
}
